"""Linear and nonlinear correlation of many signals with each other (Wagner 2021, B.2).

Readings taken: of N values in order, the k-th (from 0) is of rank floor(k b / N), so that ranks are equally full even
where b does not divide N; equal values are ranked in the order in which they come. b is named with every result, as the
coefficient depends on it: two independent signals give about `independent_nonlinear(N, b)`, not 0.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ndtr

from resim.core.geometry import Floats

RANKS = 10
"""b, with which the pattern of Fig. B.4 comes out (N = 10,000); the source gives none."""


def pearson(signals: Floats) -> Floats:
    """Give Pearson's coefficients (F, F) of signals (N, F); 0 beside one that is constant, whose own is 1."""
    centred = signals - signals.mean(axis=0)
    length = np.sqrt(np.square(centred).sum(axis=0))
    unit = np.divide(
        centred, length, out=np.zeros_like(centred), where=length > 1e-12 * (1.0 + length.max(initial=0))
    )
    out = unit.T @ unit
    np.fill_diagonal(out, 1.0)
    return np.asarray(np.clip(out, -1.0, 1.0))


def nonlinear(signals: Floats, ranks: int = RANKS) -> Floats:
    """Give the nonlinear correlation coefficients (F, F) of signals (N, F), from 0 to about 1 (Eq. B.10).

    ranks: b. Where it does not divide N, ranks are not equally full, and a signal with itself gives slightly more than
    1. Raises ValueError for fewer samples than ranks.
    """
    samples, count = signals.shape
    if not 2 <= ranks <= samples:
        raise ValueError(f"expected from 2 to {samples} ranks for {samples} samples, got {ranks}")
    order = np.argsort(signals, axis=0, kind="stable")
    rank = np.empty((samples, count), dtype=np.intp)
    np.put_along_axis(rank, order, (np.arange(samples) * ranks // samples)[:, None], axis=0)
    full = np.zeros((samples, count * ranks), dtype=np.float32)
    full[np.arange(samples)[:, None], np.arange(count) * ranks + rank] = 1.0
    share = (full.T @ full).astype(float) / samples  # counts below 2^24 are exact
    terms = np.where(share > 0.0, share * np.log(np.where(share > 0.0, share, 1.0)), 0.0) / math.log(ranks)
    return np.asarray(2.0 + terms.reshape(count, ranks, count, ranks).sum(axis=(1, 3)))


def independent_nonlinear(samples: int, ranks: int = RANKS) -> float:
    """Give the coefficient that independent signals have on average: (b - 1)² / (2 N ln b)."""
    return (ranks - 1) ** 2 / (2.0 * samples * math.log(ranks))


def uncorrelated_pearson(trained: int, samples: int, count: int) -> float:
    """Give the largest coefficient that `count` components have on average which are uncorrelated in truth.

    Coefficients of N samples scatter with 1 / N, and as much with the axes, which are of a sample as well (`trained`,
    N_t): of normal components each has the variance 1 / N + 1 / N_t. Largest: of all pairs, in absolute value.
    """
    x = np.linspace(0.0, 10.0, 2001)
    exceeds = 1.0 - (2.0 * ndtr(x) - 1.0) ** (count * (count - 1) // 2)
    return float(np.trapezoid(exceeds, x)) * math.sqrt(1.0 / samples + 1.0 / trained) if count > 1 else 0.0
