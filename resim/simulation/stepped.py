"""A drive whose EGO is driven from outside, step by step, in the loop that a function drives in."""

from __future__ import annotations

import numpy as np

from resim.core.errors import ResimError
from resim.simulation.case import Case, Collision, End
from resim.simulation.function.interface import Perceived
from resim.simulation.loop import ClosedLoop


class SteppedDrive:
    """A drive of a case, from the scenario's start on; the case's build and engine are not asked.

    Attributes:
        perceived: What is seen now.
        end: What ended it; "duration" as long as nothing has.
    """

    def __init__(self, case: Case) -> None:
        perception = case.perception.together((), [np.random.default_rng(case.seed)])
        if perception is None:
            raise ResimError(f"the perception {case.perception.hash} cannot be simulated")
        self._loop = ClosedLoop([case], perception)
        self._asks = self._loop.ask(1)
        self._last = len(self._loop.plan.t)
        nothing = np.zeros((1, 2))
        seen, counts = next(self._asks)
        while not counts:  # the lead-in, in which the EGO is guided
            seen, counts = self._asks.send(nothing)
        self.perceived: Perceived = seen.of(0)
        self.end: End = "duration"

    @property
    def is_over(self) -> bool:
        """Whether it has ended, or the recording has."""
        return self.end != "duration" or self._loop.steps >= self._last

    @property
    def position(self) -> tuple[float, float]:
        """Where the EGO is in truth: x, y [m] in the map."""
        x, y = self._loop.ego[self._loop.steps - 1, 0, :2].tolist()
        return x, y

    @property
    def collisions(self) -> tuple[Collision, ...]:
        """With whom the EGO collided, and when."""
        return tuple(self._loop.runs[0].collisions)

    def step(self, acceleration: float, curvature: float) -> None:
        """Drive a step [m/s², 1/m]. Raises ResimError where it is over."""
        if self.is_over:
            raise ResimError("the drive is over: begin another")
        seen, _ = self._asks.send(np.array([[acceleration, curvature]]))
        self.perceived = seen.of(0)
        self._loop.look()
        self.end = self._loop.runs[0].end

    def close(self) -> None:
        """Let go of it."""
        self._asks.close()
