"""How far a verified scenario can be varied in simulation until a KPI flips (Groh 2018, III.C)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

POINTS = 8
"""Equal steps to each side in which it is looked whether anything flips, so that what flips and flips back is seen."""


@dataclass(frozen=True)
class Unlike:
    """What is not as measured when a parameter is changed by an amount; it is true where anything is.

    flips: criteria whose KPIs flip. others: what else ends the interval, such as that the EGO collides.
    """

    flips: tuple[str, ...] = ()
    others: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.flips or self.others)


Flips = Callable[[float], Unlike]
"""Gives what is not as measured when the parameter is changed by an amount."""


@dataclass(frozen=True)
class IntervalEnd:
    """One end of the interval. amount: the last at which no KPI flips; flips: which do `resolution` further on.

    others: what else ends it there, such as that the EGO collides. Neither where the search ended first.
    """

    amount: float
    flips: tuple[str, ...]
    others: tuple[str, ...] = ()


@dataclass(frozen=True)
class ValidityInterval:
    """Within which changes of a parameter of an object all KPIs stay as they are in simulation; low <= 0 <= high.

    No more than that: a real drive at an end of it would legitimise the simulation in between, and nothing beyond.
    agreement: more than this share of seeds keeps every KPI at each change that was simulated, by the test of the
    verdict; None where one run was simulated at each.
    """

    parameter: str
    unit: str
    object: str
    low: IntervalEnd
    high: IntervalEnd
    resolution: float
    tried: int
    agreement: float | None = None


def search(flips: Flips, most: float, resolution: float) -> tuple[IntervalEnd, IntervalEnd, int]:
    """Give both ends of the interval around 0 in which nothing flips, and how many amounts were tried.

    Steps of most / POINTS outwards until something flips, then halves the last step down to the resolution.
    """
    tried = 0

    def at(amount: float) -> Unlike:
        nonlocal tried
        tried += 1
        return flips(amount)

    low, high = (_end(at, sign * most, resolution) for sign in (-1.0, 1.0))
    return low, high, tried


def _end(flips: Flips, most: float, resolution: float) -> IntervalEnd:
    good: float = 0.0
    bad: float | None = None
    unlike = Unlike()
    for k in range(1, POINTS + 1):
        amount = most * k / POINTS
        if unlike := flips(amount):
            bad = amount
            break
        good = amount
    while bad is not None and abs(bad - good) > resolution * (1.0 + 1e-9):
        middle = 0.5 * (good + bad)
        if found := flips(middle):
            bad, unlike = middle, found
        else:
            good = middle
    return IntervalEnd(good, unlike.flips, unlike.others)
