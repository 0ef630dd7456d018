"""How alike two partitions are."""

from __future__ import annotations

import numpy as np

from resim.space.traces import Ints


def adjusted_rand(one: Ints, two: Ints) -> float:
    """Give the adjusted Rand index of two labellings (N,) (Hubert and Arabie 1985): 1 alike, about 0 by chance."""
    _, a = np.unique(one, return_inverse=True)
    _, b = np.unique(two, return_inverse=True)
    cells = np.unique(np.stack([a, b]), axis=1, return_counts=True)[1]
    both, rows, columns = (_pairs(counts) for counts in (cells, np.bincount(a), np.bincount(b)))
    whole = len(a) * (len(a) - 1) / 2.0
    if not whole:
        return 1.0
    expected, most = rows * columns / whole, 0.5 * (rows + columns)
    return 1.0 if most == expected else float((both - expected) / (most - expected))


def _pairs(counts: Ints) -> float:
    return float((counts * (counts - 1.0) / 2.0).sum())
