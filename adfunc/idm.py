"""The Intelligent Driver Model in its lane (Treiber, Hennecke, Helbing 2000)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from adfunc.lane_keeping import Lanes, alone, in_corridor
from resim.simulation.function.batch import CommandBatch, Keys, PerceivedBatch
from resim.simulation.function.interface import Command, Perceived, Setup


class Idm:
    """Follows the lane and the vehicle ahead in it: a (1 - (v/v0)^4 - (s*/s)²).

    desired_speed v0 [m/s]: if not given, the map's limit, and where it has none the speed at the start.
    time_gap [s], standstill_gap [m], acceleration a and comfortable braking b [m/s²] as in the source.
    """

    def __init__(
        self,
        *,
        desired_speed: float | None = None,
        time_gap: float = 1.2,
        standstill_gap: float = 2.0,
        acceleration: float = 1.4,
        braking: float = 2.0,
    ) -> None:
        self.desired_speed, self.time_gap, self.standstill_gap = desired_speed, time_gap, standstill_gap
        self.acceleration, self.braking = acceleration, braking

    def reset(self, setup: Setup) -> None:
        """Look up the lane."""
        self.keys = Keys(1)
        self.reset_batch([setup])

    def step(self, perceived: Perceived) -> Command:
        """Keep the lane and the gap."""
        return alone(self, perceived, self.keys)

    def reset_batch(self, setups: Sequence[Setup]) -> None:
        """Look up the lanes."""
        self.lanes = Lanes(setups)
        self.half_length, self.half_width = 0.5 * setups[0].length, 0.5 * setups[0].width
        self.start_speed = np.array([max(setup.start.v, 1.0) for setup in setups])

    def step_batch(self, perceived: PerceivedBatch) -> CommandBatch:
        """Keep the lanes and the gaps."""
        v, most = perceived.ego[:, 3], self.acceleration
        self.lanes.place(perceived.ego)
        ratio = v / self.lanes.limited(self.desired_speed, self.start_speed)
        free = most * (1.0 - np.array([r**4 for r in ratio.tolist()]))  # as precise alone as with others
        others = self.lanes.locate(perceived, behind=0.0)
        ahead = (others.s > 0.0) & in_corridor(others.d, others, self.half_width)
        led = np.flatnonzero(ahead.any(axis=1))
        lead = ahead.argmax(axis=1)[led] if len(led) else led
        s, v_s, half_length = (column[led, lead] for column in (others.s, others.v_s, others.half_length))
        gap = np.maximum(s - half_length - self.half_length, 0.1)
        own = v[led]
        wanted = own * self.time_gap + own * (own - v_s) / (2.0 * math.sqrt(most * self.braking))
        short = (self.standstill_gap + np.maximum(wanted, 0.0)) / gap
        free[led] -= most * short**2
        return CommandBatch(np.maximum(free, -9.0), self.lanes.steer(v))

    def close(self) -> None:
        """Nothing to end."""
