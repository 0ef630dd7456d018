"""The plans of sweeps: each says at which values the parameters are tried."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

from resim.core.geometry import Floats
from resim.core.registry import Registry
from resim.sweeps.plans.parameter import SweepParameter

Design = Callable[[Sequence[SweepParameter], int, int], Floats]
"""From parameters (P,), `points` and `seed` of the sweep's file to values (R, P), a row a point of the plan."""

Layout = Literal["grid", "axes", "drawn", "grown"]


@dataclass(frozen=True)
class SweepPlan:
    """A plan, by the name that a sweep's file has for it.

    words: what reports call it. design: gives all points; the same arguments give the same points. None: the plan
    grows, its points follow from results (`resim.sweeps.file` knows one such plan, the adaptive one).
    count: how many points that are at most, from parameters and `points`, without making them.
    layout: how its points lie, which decides what the report can say of them. "drawn": as the parameters'
    distributions, each point by itself, so that shares and means over points are those over the distributions.
    "grid": all combinations of some values of each parameter. "axes": one parameter varies at a time. "grown": by
    results, so that shares over points mean nothing.
    """

    name: str
    words: str
    layout: Layout
    design: Design | None
    count: Callable[[Sequence[SweepParameter], int], int]

    @property
    def grows(self) -> bool:
        """Whether what to run next follows from results."""
        return self.design is None


PLANS: Registry[SweepPlan] = Registry("sweep plan")
"""Every plan, added by its own file."""


def as_many_as_asked(parameters: Sequence[SweepParameter], points: int) -> int:
    """Give how many points a plan has that makes `points` of them."""
    return points
