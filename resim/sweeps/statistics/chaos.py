"""Polynomial chaos: an outcome as polynomials of its parameters, from which Sobol indices are read.

B. Sudret, Global sensitivity analysis using polynomial chaos expansions, Reliab. Eng. Syst. Saf. 93 (2008). The
parameters are taken as shares of their distributions, uniform from 0 to 1, so that Legendre's polynomials are
orthonormal.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations_with_replacement

import numpy as np
from numpy.polynomial.legendre import legvander

from resim.core.geometry import Floats
from resim.core.intervals import CONFIDENCE, Ints
from resim.sweeps.statistics.indices import Sensitivity

DEGREE, TERMS = 14, 200
"""Largest degree, and number of polynomials, that are tried."""
LARGEST = 4_000_000
"""Points times polynomials up to which they are tried."""
WORSE = 2
"""How many degrees in turn may be no better before no more are tried."""
DRAWS, PART = 200, 50
"""Bootstrap draws, and how many of them at once."""


@dataclass(frozen=True, eq=False)
class _ChaosFit:
    """A fit to the points: exponents (T, P), coefficients (T,), solver (T, K), residual where left out (K,)."""

    exponents: Ints
    coefficients: Floats
    solver: Floats
    left_out: Floats

    @property
    def error(self) -> float:
        """The mean square of the residuals where left out."""
        return float(np.mean(self.left_out**2))


def chaos(share: Floats, y: Floats) -> Sensitivity | None:
    """Fit polynomials of share (K, P) to the points' means of y (K, S); None with too few points for degree 1.

    The degree is the one with the least error where each point is left out (Q2 is 1 less that error as a share of the
    variance). Of each index the noise of its coefficients is taken off; intervals are a wild bootstrap over points, of
    the residuals where each is left out. What polynomials leave unexplained, as at a sharp edge, may belong to any
    parameter: each upper end is higher by it. A parameter with one value has no polynomials, and indices of 0.
    """
    varied = np.ptp(share, axis=0) > 0.0
    n = np.isfinite(y).sum(axis=1)
    mean = np.nansum(y, axis=1) / n
    free = int((n - 1).sum())
    each = np.nansum((y - mean[:, None]) ** 2, axis=1)
    noise = float(each.sum()) / free if free > 0 else 0.0
    doubt = float(np.std(each - noise * (n - 1))) * np.sqrt(len(each)) / free if free > 0 else 0.0
    fit = _best(share[:, varied], mean) if varied.any() else None
    if fit is None:
        return None
    rest = fit.error
    between = max(rest - noise * float(np.mean(1.0 / n)), 0.0)
    (first, total), intervals, left = (np.zeros((2, len(varied), *end)) for end in ((), (2,), ()))
    (first[varied], total[varied]), intervals[:, varied], left = _indices(fit, noise + between, doubt)
    of_noise = noise / (noise + between) if noise + between > 0.0 else 0.0
    unexplained = (1.0 - of_noise) * float(left[0])
    intervals[:, varied, 1] = np.minimum(intervals[:, varied, 1] + unexplained, 1.0)
    return Sensitivity(
        first, intervals[0], total, intervals[1],
        of_noise * float(left[0]) if free > 0 else float("nan"), unexplained, "chaos",
        max(1.0 - rest / float(np.var(mean)), 0.0) if np.ptp(mean) > 0.0 else 0.0, int(fit.exponents.sum(axis=1).max()),
    )  # fmt: skip


def _best(share: Floats, mean: Floats) -> _ChaosFit | None:
    """The fit with the least error, of rising degrees until they get no better."""
    best, worse = None, 0
    for fit in _fits(share, mean):
        if best is None or fit.error < best.error:
            best, worse = fit, 0
        elif (worse := worse + 1) == WORSE:
            break
    return best


def _fits(share: Floats, mean: Floats) -> Iterator[_ChaosFit]:
    """Fits of rising degree, as long as there are two points or more for each polynomial."""
    raw = np.ascontiguousarray(share).tobytes()
    for degree in range(1, DEGREE + 1):
        made = _basis(raw, share.shape[1], degree)
        if made is None:
            return
        exponents, basis, solver, lever = made
        coefficients = solver @ mean
        yield _ChaosFit(exponents, coefficients, solver, (mean - basis @ coefficients) / (1.0 - lever))


@lru_cache(maxsize=DEGREE)
def _basis(raw: bytes, parameters: int, degree: int) -> tuple[Ints, Floats, Floats, Floats] | None:
    """Exponents (T, P), polynomials at the points (K, T), their solver (T, K) and leverages (K,).

    The outcomes of a sweep share them, so they are kept. None with too few points, or too few levels.
    """
    share = np.frombuffer(raw).reshape(-1, parameters)
    points = len(share)
    exponents = _exponents(parameters, degree)
    if len(exponents) > min(TERMS, points // 2, max(LARGEST // points, parameters + 1)):
        return None
    basis = np.ones((points, len(exponents)))
    for i in range(parameters):
        one = legvander(2.0 * share[:, i] - 1.0, degree) * np.sqrt(2.0 * np.arange(degree + 1) + 1.0)
        basis *= one[:, exponents[:, i]]
    q, r = np.linalg.qr(basis)
    if np.abs(np.diag(r)).min() < 1e-8 * np.abs(np.diag(r)).max():
        return None
    return exponents, basis, np.linalg.solve(r, q.T), np.minimum(np.sum(q**2, axis=1), 1.0 - 1e-9)


def _exponents(parameters: int, degree: int) -> Ints:
    """All exponents (T, P) of this total degree or less, the constant first."""
    out = [
        np.bincount(np.array(chosen, dtype=int), minlength=parameters)
        for total in range(degree + 1)
        for chosen in combinations_with_replacement(range(parameters), total)
    ]
    return np.array(out, dtype=np.int64)


def _indices(fit: _ChaosFit, rest: float, doubt: float) -> tuple[Floats, Floats, Floats]:
    """First order and total indices (2, P), their intervals (2, P, 2), and the share (1,) of what is left.

    rest: variance that is left; doubt: its standard error.
    """
    parameters = fit.exponents.shape[1]
    patterns, of = np.unique(fit.exponents > 0, axis=0, return_inverse=True)
    size = np.sum(patterns, axis=1)
    alone = patterns.T & (size == 1)
    sums = np.concatenate([alone, patterns.T, (size > 0)[None]]).astype(
        float
    )  # of the patterns: first, total, all

    def of_patterns(squares: Floats) -> Floats:
        out = np.zeros((len(patterns), *squares.shape[1:]))
        np.add.at(out, of.ravel(), squares)
        return out

    def shares(parts: Floats, rest: Floats) -> Floats:
        found = np.maximum(sums @ parts, 0.0)
        found[parameters:-1] = np.maximum(found[parameters:-1], found[:parameters])
        whole = found[-1] + rest
        return np.asarray(np.concatenate([found[:-1], np.broadcast_to(rest, whole.shape)[None]]) / whole)

    squares = of_patterns(fit.coefficients**2)
    noise = of_patterns(fit.solver**2 @ fit.left_out**2)
    shrink = np.sqrt(np.maximum(1.0 - noise / np.where(squares > 0.0, squares, np.inf), 0.0))
    centre = fit.coefficients * shrink[of.ravel()]
    rng = np.random.default_rng(0)
    drawn = []
    for _ in range(DRAWS // PART):
        signs = 2.0 * rng.integers(0, 2, (len(fit.left_out), PART)) - 1.0
        moved = centre[:, None] + fit.solver @ (fit.left_out[:, None] * signs)
        left = np.maximum(rest + doubt * rng.standard_normal(PART), 0.0)
        drawn.append(shares(of_patterns(moved**2) - noise[:, None], left))
    tails = [0.5 - 0.5 * CONFIDENCE, 0.5 + 0.5 * CONFIDENCE]
    interval = np.quantile(np.concatenate(drawn, axis=1), tails, axis=1).T
    found = shares(squares - noise, np.asarray(rest))
    interval = np.stack([np.minimum(interval[:, 0], found), np.maximum(interval[:, 1], found)], axis=1)
    return found[:-1].reshape(2, parameters), interval[:-1].reshape(2, parameters, 2), found[-1:]
