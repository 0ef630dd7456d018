"""Stretches of samples for which something holds."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Bools, Floats
from resim.mining.samples import Ints


def changes(*columns: NDArray[np.generic]) -> Ints:
    """Count the samples (K,) at which any of the columns (K,) changes."""
    new = np.zeros(len(columns[0]), dtype=bool)
    for column in columns:
        new[1:] |= column[1:] != column[:-1]
    return np.cumsum(new)


def bounds(group: NDArray[np.generic]) -> Ints:
    """Give where the groups (K,) begin, and K behind the last: (G + 1,), of one sample or more."""
    return np.concatenate([[0], np.flatnonzero(np.diff(group)) + 1, [len(group)]])


def stretches(holds: Bools, group: NDArray[np.generic]) -> tuple[Ints, Ints]:
    """Give the first and last samples (R,), (R,) of the longest stretches that hold and are of one group (K,)."""
    if not len(holds):
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    new = np.ones(len(holds), dtype=bool)
    new[1:] = group[1:] != group[:-1]
    begin = holds & (new | np.r_[True, ~holds[:-1]])
    end = holds & (np.r_[new[1:], True] | np.r_[~holds[1:], True])
    return np.flatnonzero(begin), np.flatnonzero(end)


def joined(
    first: Ints, last: Ints, t: Floats, group: NDArray[np.generic], join: float, shortest: float
) -> Iterator[tuple[int, int]]:
    """Give stretches as (first, last), of one group joined where less than `join` [s] lies between, and of those the
    ones that last `shortest` [s] or longer.
    """
    if not len(first):
        return
    apart = (group[first[1:]] != group[last[:-1]]) | (t[first[1:]] - t[last[:-1]] > join + 1e-9)
    begin, end = first[np.r_[True, apart]], last[np.r_[apart, True]]
    keep = t[end] - t[begin] >= shortest - 1e-9
    yield from zip(begin[keep].tolist(), end[keep].tolist(), strict=True)
