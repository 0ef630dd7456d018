"""The adaptive plan: points where an outcome changes, until the boundary is known to a stated width.

Bisection in as many dimensions as there are parameters: a grid to begin with, and every cell in which some points pass
and some do not is halved along all sides that are wider than asked for. A point that a finer neighbour has on a cell's
side is the cell's too, so that a boundary is followed wherever it goes. What lies within one cell of the first grid
and touches none of its corners is not found (`Lattice.missed`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import prod

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Bools, Floats
from resim.sweeps.plans.parameter import SweepParameter
from resim.sweeps.plans.registry import PLANS, SweepPlan, as_many_as_asked

Places = NDArray[np.intp]
_CELLS = 512
"""Cells looked at together: bounds memory."""


PLANS.add(
    SweepPlan(
        name="adaptive", words="adaptive, where an outcome changes", layout="grown", design=None,
        count=as_many_as_asked,
    )
)  # fmt: skip


@dataclass(frozen=True)
class Lattice:
    """Where points may be: each parameter's range in `first` cells, that are halved `halvings` times (P,)."""

    low: tuple[float, ...]
    high: tuple[float, ...]
    first: tuple[int, ...]
    halvings: tuple[int, ...]

    @classmethod
    def over(cls, parameters: Sequence[SweepParameter]) -> Lattice:
        """Give the lattice of parameters with low, high and width: steps - 1 cells, and as fine as their width asks."""
        ranges = [
            (float(p.low or 0.0), float(p.high or 0.0), p.steps - 1, float(p.width or 0.0))
            for p in parameters
        ]
        halvings = [
            max(0, int(np.ceil(np.log2((high - low) / n / width) - 1e-9))) for low, high, n, width in ranges
        ]
        low, high, first, _ = zip(*ranges, strict=True)
        return cls(low, high, first, tuple(halvings))

    @cached_property
    def counts(self) -> Places:
        """Finest cells (P,) along each parameter."""
        counts: Places = np.array(self.first) << np.array(self.halvings)
        return counts

    def missed(self, size: float) -> float:
        """Give the probability that no point of the first grid lies in an island, so that it is not found.

        size: the island's share of each range, more than 0 and less than 1. It is a box somewhere within the ranges,
        all places alike; one that the boundary of something else leads to may be found all the same.
        """
        return 1.0 - prod(min(1.0, (cells - 1) * size / (1.0 - size)) for cells in self.first)

    def values(self, places: Places) -> Floats:
        """Give the values (R, P) of lattice points (R, P)."""
        low, high = np.array(self.low), np.array(self.high)
        return np.asarray(low + (high - low) * places / self.counts)

    def numbers(self, places: Places) -> NDArray[np.int64]:
        """Give each lattice point (R, P) its number, the same in every sweep of these parameters."""
        strides = np.cumprod([1, *(self.counts + 1)[:0:-1]], dtype=np.int64)[::-1]
        out: NDArray[np.int64] = places.astype(np.int64) @ strides
        return out


def wanted(lattice: Lattice, places: Places, passed: Bools) -> Places:
    """Give the points (R, P) to try next, in order; none where the boundary is known to the width.

    places: (K, P) the points that were tried, passed: (K,) what came of them.
    """
    corners = [_corners(cells, size) for cells, size in _levels(lattice, places, passed)]
    every = np.unique(np.concatenate(corners), axis=0)
    return np.asarray(every[~np.isin(lattice.numbers(every), lattice.numbers(places))])


def boundary(lattice: Lattice, places: Places, passed: Bools) -> tuple[Places, Places]:
    """Give the cells in which the outcome changes, in order: their lowest and highest corners, each (C, P).

    The finest ones, and larger ones where points that would halve them have not been tried.
    """
    tried, (cells, size), found = lattice.numbers(places), _first(lattice), []
    while True:
        cells = cells[_mixed(cells, size, places, passed)]
        if not len(cells) or (size == 1).all():
            break
        parts, half = _halved(cells, size)
        known = np.isin(lattice.numbers(_corners(parts, half)), tried).reshape(-1, len(cells)).all(axis=0)
        found.append((cells[~known], size))
        cells, size = _halved(cells[known], size)
    found.append((cells, size))
    low = np.concatenate([lowest for lowest, _ in found])
    high = np.concatenate([lowest + step for lowest, step in found])
    order = np.lexsort(low.T[::-1])
    return low[order], high[order]


def _levels(lattice: Lattice, places: Places, passed: Bools) -> Iterator[tuple[Places, Places]]:
    """From the first cells to the finest, where the outcome changes: lowest corners (C, P), and size (P,)."""
    cells, size = _first(lattice)
    yield cells, size
    while not (size == 1).all():
        cells, size = _halved(cells[_mixed(cells, size, places, passed)], size)
        yield cells, size


def _first(lattice: Lattice) -> tuple[Places, Places]:
    """The cells (C, P) of the first grid, and their size (P,)."""
    size = 1 << np.array(lattice.halvings)
    starts = (step * np.arange(n) for step, n in zip(size.tolist(), lattice.first, strict=True))
    return np.array(list(product(*starts)), dtype=np.intp), size


def _halved(cells: Places, size: Places) -> tuple[Places, Places]:
    """The parts (S C, P) of cells that are halved along all sides longer than 1, and their size (P,)."""
    half = np.maximum(size // 2, 1)
    sides = [(0, h) if s > h else (0,) for s, h in zip(size.tolist(), half.tolist(), strict=True)]
    return np.concatenate([cells + np.array(side) for side in product(*sides)]), half


def _corners(cells: Places, size: Places) -> Places:
    """The corners (C 2^P, P) of cells."""
    return np.concatenate([cells + np.array(corner) for corner in product(*((0, s) for s in size.tolist()))])


def _mixed(cells: Places, size: Places, places: Places, passed: Bools) -> Bools:
    """Say (C,) in which cells, their sides with them, points both pass and do not."""
    out = np.zeros(len(cells), dtype=bool)
    for first in range(0, len(cells), _CELLS):
        low = cells[first : first + _CELLS, None]
        inside = ((places >= low) & (places <= low + size)).all(axis=2)
        out[first : first + _CELLS] = (inside & passed).any(axis=1) & (inside & ~passed).any(axis=1)
    return out
