"""Which parameters an outcome depends on: Sobol indices, as shares of the variance of all runs.

I. M. Sobol, Global sensitivity indices, Math. Comput. Simul. 55 (2001): the variance of an outcome is the sum of parts
that each belong to a set of parameters. First order: the part of one parameter alone; total: all parts that it is in.
What seeds do is a part of its own.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.special import stdtrit

from resim.core.geometry import Bools, Floats
from resim.core.intervals import CONFIDENCE
from resim.sweeps.statistics.chaos import chaos
from resim.sweeps.statistics.indices import Sensitivity

MOST = 12
"""Parameters of a grid up to which its variance is taken apart."""
LEAST_SEEDS = 3
"""Seeds from which on leaving one out says something."""


def sensitivity(share: Floats, y: Floats, *, grid: bool) -> Sensitivity | None:
    """Give the Sobol indices of an outcome; None where it does not vary, or where there are too few points to tell.

    share (K, P): of each parameter's distribution that lies below the point; y (K, S): the outcome by point and seed,
    NaN where there is none. grid: that the points are to be all combinations of their levels; where points are missing,
    they are taken as drawn.
    """
    known = np.isfinite(y).any(axis=1)
    share, y = share[known], y[known]
    if not len(y) or np.nanmax(y) - np.nanmin(y) <= 1e-12 * np.nanmax(np.abs(y)):
        return None
    if grid and share.shape[1] <= MOST and (shape := full_grid(share)) is not None:
        order = np.lexsort(share.T[::-1])
        return anova(y[order].reshape(*shape, -1))
    return chaos(share, y)


def full_grid(x: Floats) -> tuple[int, ...] | None:
    """Give how many levels each parameter has, if the points x (K, P) are all their combinations, once each."""
    shape = tuple(len(np.unique(column)) for column in x.T)
    whole = len(x) == np.prod(shape, dtype=float) and len(np.unique(x, axis=0)) == len(x)
    return shape if whole else None


def anova(y: Floats) -> Sensitivity:
    """Take the variance on a full grid apart, exactly; y (L1, ..., LP, S): by level of each parameter, and seed.

    From each part the noise of the seeds is taken off that its degrees of freedom let in (epsilon squared, T. L.
    Kelley, 1935). The grid is no sample, so what is uncertain is what seeds did: intervals are by leaving out one seed
    at a time (jackknife, Student's t), and there are none with fewer than three seeds. A cell that has that seed alone
    keeps it.
    """
    parameters, seeds = y.ndim - 1, y.shape[-1]
    first, total, noise = _indices(y)
    intervals = np.full((2, parameters, 2), np.nan)
    if seeds >= LEAST_SEEDS:
        without = np.array([np.stack(_indices(_without(y, s))[:2]) for s in range(seeds)])
        error = np.sqrt((seeds - 1.0) * without.var(axis=0))
        half = error * stdtrit(seeds - 1.0, 0.5 + 0.5 * CONFIDENCE)
        middle = np.stack([first, total])
        intervals = np.clip(np.stack([middle - half, middle + half], axis=-1), 0.0, 1.0)
    return Sensitivity(first, intervals[0], total, intervals[1], noise, 0.0, "anova")


def _without(y: Floats, seed: int) -> Floats:
    """The runs y (L1, ..., LP, S) less those of a seed, but for cells that would be left with none."""
    out = np.delete(y, seed, axis=-1)
    alone = ~np.isfinite(out).any(axis=-1)
    out[alone, 0] = y[alone, seed]
    return out


def _indices(y: Floats) -> tuple[Floats, Floats, float]:
    """First order (P,), total (P,), and the share of the noise, NaN with one run a point."""
    parameters = y.ndim - 1
    n = np.isfinite(y).sum(axis=-1)
    cells = np.nansum(y, axis=-1) / np.maximum(n, 1)
    free = int((n - 1).sum())
    variance = float(np.nansum((y - cells[..., None]) ** 2)) / free if free > 0 else 0.0
    of_mean = variance * float(np.mean(1.0 / np.maximum(n, 1)))
    first, total, whole = np.zeros(parameters), np.zeros(parameters), variance
    for size in range(1, parameters + 1):
        for mine in combinations(range(parameters), size):
            freedom = float(np.prod([y.shape[i] - 1 for i in mine]))
            part = max(_part(cells, mine) - freedom / cells.size * of_mean, 0.0)
            whole += part
            total[list(mine)] += part
            if size == 1:
                first[mine[0]] = part
    whole = whole or 1.0
    return first / whole, total / whole, variance / whole if free > 0 else float("nan")


def _part(cells: Floats, mine: tuple[int, ...]) -> float:
    """The variance of the means (L1, ..., LP) that belongs to these parameters together."""
    for axis in range(cells.ndim):
        mean = cells.mean(axis=axis, keepdims=True)
        cells = cells - mean if axis in mine else mean
    return float(np.mean(cells**2))


def ranges(means: list[Floats]) -> Floats:
    """Give of each parameter how far its levels' means reach (P,): all that one at a time can tell."""
    return np.array([float(np.nanmax(m) - np.nanmin(m)) if np.isfinite(m).any() else np.nan for m in means])


def ranking(total: Floats, varies: Bools) -> list[int]:
    """Give the parameters that are varied, the most influential first."""
    order = np.argsort(-np.nan_to_num(total), kind="stable")
    return [int(i) for i in order if varies[i]]
