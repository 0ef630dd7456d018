"""Keeps the lane and the speed it started with, whatever stands in the way: the least function there is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from adfunc.lane_keeping import Lanes, alone
from resim.simulation.function.batch import CommandBatch, Keys, PerceivedBatch
from resim.simulation.function.interface import Command, Perceived, Setup


class ConstantVelocity:
    """Blind to traffic."""

    def reset(self, setup: Setup) -> None:
        """Look up the lane."""
        self.keys = Keys(1)
        self.reset_batch([setup])

    def step(self, perceived: Perceived) -> Command:
        """Hold lane and speed."""
        return alone(self, perceived, self.keys)

    def reset_batch(self, setups: Sequence[Setup]) -> None:
        """Look up the lanes."""
        self.lanes, self.v = Lanes(setups), np.array([setup.start.v for setup in setups])

    def step_batch(self, perceived: PerceivedBatch) -> CommandBatch:
        """Hold lanes and speeds."""
        v = perceived.ego[:, 3]
        self.lanes.place(perceived.ego)
        return CommandBatch(1.0 * (self.v - v), self.lanes.steer(v))

    def close(self) -> None:
        """Nothing to end."""
