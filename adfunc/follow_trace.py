"""An oracle: drives the recorded trace through the vehicle model.

Its simulation error is the floor that the vehicle model sets.
"""

from __future__ import annotations

import math

from resim.simulation.function.interface import Command, EgoState, Perceived, Setup


class FollowTrace:
    """Feed-forward of the recorded acceleration and curvature, feedback on what is off.

    preview [s] makes up for the actuators' lags.
    """

    needs_truth = True

    def __init__(self, *, preview: float = 0.12) -> None:
        self.preview = preview

    def reset(self, setup: Setup) -> None:
        """Take the record."""
        assert setup.recorded is not None
        self.recorded = setup.recorded

    def step(self, perceived: Perceived) -> Command:
        """Steer and accelerate towards where the record is."""
        now, soon = self.recorded(perceived.t), self.recorded(perceived.t + self.preview)
        ego = perceived.ego
        along, across = _off(now, ego)
        v = max(ego.v, 2.0)
        turn = math.remainder(now.heading - ego.heading, 2.0 * math.pi)
        acceleration = soon.a + 2.0 * (now.v - ego.v) + 1.5 * along
        bend = soon.yaw_rate / max(soon.v, 1.0)
        return Command(acceleration, bend + (1.5 * across + 2.2 * v * math.sin(turn)) / (v * v))

    def close(self) -> None:
        """Nothing to end."""


def _off(wanted: EgoState, ego: EgoState) -> tuple[float, float]:
    dx, dy = wanted.x - ego.x, wanted.y - ego.y
    c, s = math.cos(ego.heading), math.sin(ego.heading)
    return c * dx + s * dy, c * dy - s * dx
