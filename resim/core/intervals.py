"""95 % intervals of shares and of means, where the runs of one point are no independent evidence.

A sweep does each point of its plan with several seeds. What two seeds of one point say about a parameter is the same
thing twice, so that the points are what is counted, not the runs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betaincinv, ndtri, stdtrit

from resim.core.geometry import Bools, Floats

Ints = NDArray[np.signedinteger[Any]]

CONFIDENCE = 0.95


@dataclass(frozen=True, eq=False)
class GroupMean:
    """A mean (G,) of each group with its 95 % interval low to high, NaN where there is none.

    points, runs (G,): how many there are in the group.
    """

    mean: Floats
    low: Floats
    high: Floats
    points: Ints
    runs: Ints


def wilson(count: ArrayLike, of: ArrayLike) -> tuple[Floats, Floats]:
    """Give the 95 % interval (low, high) of a share of which `count` of `of` were seen; arrays, fractions allowed.

    E. B. Wilson, Probable inference, J. Am. Stat. Assoc. 22 (1927); NaN where `of` is 0.
    """
    n = np.where(np.asarray(of) > 0, of, np.nan).astype(float)
    p = np.asarray(count, dtype=float) / n
    z = ndtri(0.5 + 0.5 * CONFIDENCE)
    centre = (2.0 * n * p + z**2) / (2.0 * (n + z**2))
    half = z / (2.0 * (n + z**2)) * np.sqrt(4.0 * n * p * (1.0 - p) + z**2)
    return np.where(p == 0.0, 0.0, centre - half), np.where(p == 1.0, 1.0, centre + half)


def exact(share: ArrayLike, of: ArrayLike, *, confidence: float = CONFIDENCE) -> tuple[Floats, Floats]:
    """Give the interval (low, high) of a share seen in `of`, arrays, that holds its level whatever the true share.

    C. J. Clopper and E. S. Pearson, The use of confidence or fiducial limits, Biometrika 26 (1934), continued to
    fractions by the beta distribution; NaN where `of` is 0.
    """
    n = np.where(np.asarray(of) > 0, of, np.nan).astype(float)
    c, tail = np.asarray(share, dtype=float) * n, 0.5 - 0.5 * confidence
    with np.errstate(invalid="ignore"):
        low = betaincinv(np.maximum(c, 1e-12), n - c + 1.0, tail)
        high = betaincinv(c + 1.0, np.maximum(n - c, 1e-12), 1.0 - tail)
    return np.where(c == 0.0, 0.0, low), np.where(c == n, 1.0, high)


def shares(y: Floats, group: Ints, groups: int, *, drawn: bool = True) -> GroupMean:
    """Give the share of runs with y = 1 in each group of points.

    y (K, S): 0 or 1 by point and seed, NaN where there is no run; group (K,): of each point, -1 for none. The interval
    is exact, of as many as there are points where these were drawn: seeds of one point are a cluster, and a few
    clusters do not tell how much they differ from those that were not drawn. Where the points are all that there is
    (drawn: False), it is Wilson's, of as many independent runs as give the variance that is seen
    between points (Kish 1965, design effect): all runs at most, and at least the points; of a lone point its seeds.
    """
    points, n, c, counted = _sums(y, group, groups)
    share = np.divide(c, n, out=np.full(groups, np.nan), where=n > 0)
    independent = points.astype(float)
    if not drawn:
        off = np.where(counted, (np.nansum(y, axis=1) - share[group] * np.isfinite(y).sum(axis=1)) ** 2, 0.0)
        spread = np.bincount(group[counted], off[counted], groups)
        with np.errstate(invalid="ignore", divide="ignore"):
            variance = points / (points - 1.0) * spread / n**2
            effective = share * (1.0 - share) / variance
        least = np.where(points == 1, n, points)
        independent = np.clip(np.where(np.isfinite(effective), effective, least), least, n)
    low, high = exact(share, independent) if drawn else wilson(share * independent, independent)
    return GroupMean(share, low, high, points, n.astype(int))


def means(y: Floats, group: Ints, groups: int, *, drawn: bool = True) -> GroupMean:
    """Give the mean of y (K, S) in each group of points: of the points' means, with Student's t interval over them.

    Where a group is a single point, and no other could have been drawn, it is over its seeds; else NaN, as where there
    is one run alone.
    """
    n = np.isfinite(y).sum(axis=1)
    of_point = np.divide(np.nansum(y, axis=1), n, out=np.full(len(y), np.nan), where=n > 0)
    points, runs, _, counted = _sums(y, group, groups)
    mean, error = _mean_and_error(of_point[counted], group[counted], groups)
    single = (points == 1) & (not drawn)
    seeds, of = y[counted], np.broadcast_to(group[counted][:, None], y[counted].shape)
    known = np.isfinite(seeds)
    error = np.where(single, _mean_and_error(seeds[known], of[known], groups)[1], error)
    units = np.where(single, runs, points)
    half = error * stdtrit(np.maximum(units - 1.0, 1.0), 0.5 + 0.5 * CONFIDENCE)
    return GroupMean(mean, mean - half, mean + half, points, runs.astype(int))


def _sums(y: Floats, group: Ints, groups: int) -> tuple[Ints, Floats, Floats, Bools]:
    """Points and runs of each group, their sum, and which points count."""
    n = np.isfinite(y).sum(axis=1)
    counted = (group >= 0) & (n > 0)
    of = group[counted]
    return (
        np.bincount(of, minlength=groups),
        np.asarray(np.bincount(of, n[counted], groups), dtype=float),
        np.asarray(np.bincount(of, np.nansum(y, axis=1)[counted], groups), dtype=float),
        counted,
    )


def _mean_and_error(values: Floats, group: Ints, groups: int) -> tuple[Floats, Floats]:
    """Mean and standard error of the values (K,) of each group."""
    n = np.bincount(group, minlength=groups).astype(float)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.bincount(group, values, groups) / n
        square = np.bincount(group, (values - mean[group]) ** 2, groups)
        return mean, np.sqrt(square / (n - 1.0) / n)
