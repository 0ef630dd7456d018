"""A second opinion on how drift and noise share the errors: the variogram, which looks at long lags as well.

Derived quantities are smoother than an autoregression: the likelihood then follows their small changes from list to
list, and finds them to last too long. Where the variogram surely says otherwise it is believed. Differences within a
track need no mean, so finite records do not bias it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats
from resim.perception.training.clusters import FEWEST, certain
from resim.perception.training.spread import SpreadProblem, Spreads

LONGEST, LAGS = 3.0, 24
"""Lags [s] that are looked at, and how many."""
FARTHEST = 10.0
"""Correlation times over the longest lag that can be told from ones for good."""
SURE = 3.0
"""Standard errors, of many drives, by which the logarithms of both correlation times differ, for the variogram to be
believed."""


def reconsidered(spreads: Spreads, problem: SpreadProblem) -> Spreads:
    """Give the spreads, of the variogram where the errors are surely no autoregression with white noise."""
    if spreads.drift is None:
        return spreads
    drift, noise = spreads.levels(problem.features)
    total = np.sqrt(drift**2 + noise**2)
    z = np.where(problem.known, problem.residual / np.where(total > 0.0, total, 1.0), np.nan)
    step = float(np.median(problem.steps[:, 1:])) if z.shape[1] > 1 else 0.0
    most = min(int(LONGEST / step), z.shape[1] // 2) if step > 0.0 else 0
    groups = np.unique(problem.group, return_inverse=True)[1]
    if most < 4 or groups.max() + 1 < FEWEST:
        return spreads
    lags = np.unique(np.round(np.geomspace(1, most, LAGS)).astype(int))
    sums, counts = _differences(z, lags, groups)
    squares = np.stack(
        [np.bincount(groups, np.nansum(z**2, axis=1)), np.bincount(groups, np.isfinite(z).sum(axis=1))]
    )
    sums_all, counts_all, squares_all = sums.sum(axis=0), counts.sum(axis=0), squares.sum(axis=1)
    every, n = _fit(sums_all, counts_all, squares_all, lags * step), len(sums)
    left_out = np.array([
        _fit(sums_all - sums[k], counts_all - counts[k], squares_all - squares[:, k], lags * step) for k in range(n)
    ])  # fmt: skip
    se = np.sqrt((n - 1) / n * ((left_out - left_out.mean(axis=0)) ** 2).sum(axis=0))
    tau, share, scale = np.exp(every)
    likely = min(
        np.log(spreads.tau), np.log(FARTHEST * lags[-1] * step)
    )  # beyond it the variogram sees no time
    if abs(every[0] - likely) <= certain(SURE, n) * np.hypot(se[0], spreads.se.get("tau", 0.0)):
        return spreads
    was = float(np.mean((drift**2 / total**2)[problem.known]))
    errors = {**spreads.se, "tau": float(se[0]), "drift": float(np.hypot(se[1] / 2.0, se[2] / 2.0))}
    level = spreads.drift + 0.5 * float(np.log(scale * share / was))
    if spreads.noise is None or share > 1.0 - 1e-6:
        return replace(spreads, drift=level, noise=None, noise_by={}, tau=float(tau), se=errors)
    rest = spreads.noise + 0.5 * float(np.log(scale * (1.0 - share) / (1.0 - was)))
    return replace(spreads, drift=level, noise=rest, tau=float(tau), se=errors)


def _differences(z: Floats, lags: NDArray[np.intp], groups: NDArray[np.intp]) -> tuple[Floats, Floats]:
    """Give (D, L) half the summed squared differences over each lag and their number, by drive."""
    sums, counts = [], []
    for lag in lags.tolist():
        square = 0.5 * (z[:, lag:] - z[:, :-lag]) ** 2
        sums.append(np.bincount(groups, np.nansum(square, axis=1)))
        counts.append(np.bincount(groups, np.isfinite(square).sum(axis=1)))
    return np.stack(sums, axis=1), np.stack(counts, axis=1)


def _fit(sums: Floats, counts: Floats, squares: Floats, lags: Floats) -> Floats:
    """Give log of correlation time, of the drift's share, and of the whole variance: variance - variogram = share *
    variance * exp(-lag / tau), weighted least squares on a grid of tau."""
    variance = float(squares[0] / squares[1])
    covariance = variance - sums / np.maximum(counts, 1.0)
    taus = np.geomspace(0.5 * lags[0], FARTHEST * lags[-1], 400)
    shape = np.exp(-lags / taus[:, None])
    weight = np.gradient(lags) * (counts > 0)
    level = np.clip(
        (shape * covariance * weight).sum(axis=1) / (shape**2 * weight).sum(axis=1), 1e-6, variance
    )
    cost = (weight * (covariance - level[:, None] * shape) ** 2).sum(axis=1)
    k = int(np.argmin(cost))
    return np.log([taus[k], level[k] / variance, variance])
