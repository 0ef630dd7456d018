"""A simulator's own models as drivers of objects that were handed over."""

from __future__ import annotations

from typing import Protocol

from resim.simulation.reactive.drivers import TrafficDriver
from resim.simulation.reactive.lanes import Side


class Deciders(Protocol):
    """What decides for objects that were handed over; they have the rows of a stage."""

    def take(self, row: int, driver: TrafficDriver) -> None:
        """Decide for an object from now on, with its driver's parameters."""

    def give_back(self, row: int) -> None:
        """Decide for an object no longer."""

    def acceleration(self, row: int, v: float, gap: float, lead_v: float) -> float:
        """Give what an object does [m/s²] at v [m/s], `gap` [m, infinite for nobody] behind who drives lead_v [m/s]."""

    def sides(self, row: int) -> tuple[Side, ...]:
        """Give the sides to which an object wants to change lanes, and could."""
