"""How an outcome answers to one parameter: by the levels of a grid, or by bins of what was drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resim.core.geometry import Bools, Floats
from resim.core.intervals import Ints

LEVELS = 64
"""Different values of a parameter up to which each one is a level."""
LEAST = 8
"""Points that a level needs to be told from others, where points differ in other parameters too."""


@dataclass(frozen=True, eq=False)
class Levels:
    """The levels of a parameter, in order: centre, and the lowest and highest value in each (G,); of (K,) each point's.

    binned: whether a level is a bin of several values.
    """

    centre: Floats
    low: Floats
    high: Floats
    of: Ints
    binned: bool

    def __len__(self) -> int:
        return len(self.centre)


def levels(x: Floats, bins: int, used: Bools | None = None, others: Floats | None = None) -> Levels:
    """Give the levels of a parameter's values x (K,) at the points; used (K,): which points count, all if None.

    Few different values are a level each; many are put in `bins` of as many points each, the centre their median.
    others (K, Q): the other parameters. Unless each value meets the same of these (a grid, or one at a time), what
    sets two levels apart may be theirs, so that a level holds LEAST points or more: bins as many as let it, or one.
    """
    mine = np.ones(len(x), dtype=bool) if used is None else used
    values, counts = np.unique(x[mine], return_counts=True)
    least = 1
    if others is not None and counts.min(initial=LEAST) < LEAST:
        same = len(np.unique(others[mine], axis=0)) * len(values) == np.count_nonzero(mine)
        least = 1 if same else LEAST
    few = len(values) <= min(LEVELS, max(bins, int(np.count_nonzero(mine)) // 2))
    if len(values) < 2 or (few and counts.min() >= least):
        return Levels(values, values, values, np.where(mine, np.searchsorted(values, x), -1), False)
    for count in range(bins, 0, -1):
        found = _bins(x, mine, count)
        if np.bincount(found.of[mine]).min() >= least:
            break
    return found


def _bins(x: Floats, mine: Bools, bins: int) -> Levels:
    """Bins of the values x (K,) at the points that are mine (K,)."""
    edges = np.unique(np.quantile(x[mine], np.linspace(0.0, 1.0, bins + 1)))
    of = np.where(mine, np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2), -1)
    inside = [x[of == g] for g in range(len(edges) - 1)]
    inside = [part for part in inside if len(part)]
    low, centre, high = (np.array([f(part) for part in inside]) for f in (np.min, np.median, np.max))
    return Levels(centre, low, high, np.where(mine, np.searchsorted(high, x), -1), True)
