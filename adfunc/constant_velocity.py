"""Keeps the lane and the speed it started with, whatever stands in the way: the least function there is."""

from __future__ import annotations

from adfunc.lane_keeping import Lane
from resim.simulation.function.interface import Command, Perceived, Setup


class ConstantVelocity:
    """Blind to traffic."""

    def reset(self, setup: Setup) -> None:
        """Look up the lane."""
        self.lane, self.v = Lane(setup.road, setup.start, setup.route), setup.start.v

    def step(self, perceived: Perceived) -> Command:
        """Hold lane and speed."""
        self.lane.place(perceived.ego)
        return Command(1.0 * (self.v - perceived.ego.v), self.lane.steer(perceived.ego.v))

    def close(self) -> None:
        """Nothing to end."""
