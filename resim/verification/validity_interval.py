"""How far a verified scenario can be varied in simulation until a KPI flips (Groh 2018, III.C)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

POINTS = 8
"""Equal steps to each side in which it is looked whether anything flips, so that what flips and flips back is seen."""

Flips = Callable[[float], tuple[str, ...]]
"""Gives the criteria whose KPIs flip when the parameter is changed by an amount."""


@dataclass(frozen=True)
class IntervalEnd:
    """One end of the interval. amount: the last at which no KPI flips; flips: which do `resolution` further on, none
    where the search ended first.
    """

    amount: float
    flips: tuple[str, ...]


@dataclass(frozen=True)
class ValidityInterval:
    """Within which changes of a parameter of an object all KPIs stay as they are in simulation; low <= 0 <= high.

    No more than that: a real drive at an end of it would legitimise the simulation in between, and nothing beyond.
    """

    parameter: str
    unit: str
    object: str
    low: IntervalEnd
    high: IntervalEnd
    resolution: float
    tried: int


def search(flips: Flips, most: float, resolution: float) -> tuple[IntervalEnd, IntervalEnd, int]:
    """Give both ends of the interval around 0 in which nothing flips, and how many amounts were tried.

    Steps of most / POINTS outwards until something flips, then halves the last step down to the resolution.
    """
    tried = 0

    def at(amount: float) -> tuple[str, ...]:
        nonlocal tried
        tried += 1
        return flips(amount)

    low, high = (_end(at, sign * most, resolution) for sign in (-1.0, 1.0))
    return low, high, tried


def _end(flips: Flips, most: float, resolution: float) -> IntervalEnd:
    good: float = 0.0
    bad: float | None = None
    names: tuple[str, ...] = ()
    for k in range(1, POINTS + 1):
        amount = most * k / POINTS
        if names := flips(amount):
            bad = amount
            break
        good = amount
    while bad is not None and abs(bad - good) > resolution * (1.0 + 1e-9):
        middle = 0.5 * (good + bad)
        if found := flips(middle):
            bad, names = middle, found
        else:
            good = middle
    return IntervalEnd(good, names)
