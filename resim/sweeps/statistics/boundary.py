"""Where over two parameters an outcome passes and fails: the share of passing runs on a map, and its boundary."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resim.core.geometry import Floats
from resim.core.intervals import shares, wilson
from resim.sweeps.statistics.response import Levels

MESH = 25
"""Places along each parameter at which drawn points are smoothed."""
WIDTHS = (0.02, 0.03, 0.05, 0.08, 0.12, 0.2, 0.3)
"""Widths of the kernel that are tried, as shares of the parameters' distributions."""
TRIED = 1500
"""Points by which the width is chosen."""
ENOUGH = 12.0
"""Points that a kernel must reach on the whole, for a quarter of them in a corner to be NEAR enough."""
NEAR, LEAST = 3.0, 0.5
"""Points that a place of the map must have, and the kernel's weight of them together; else it is left open."""


@dataclass(frozen=True, eq=False)
class ShareMap:
    """Share of runs that pass over two parameters, (B, A), with its 95 % interval; NaN where nothing is known.

    a (A,), b (B,): values of the parameters. width: of the kernel where drawn points were smoothed, None on a grid.
    """

    a: Floats
    b: Floats
    share: Floats
    low: Floats
    high: Floats
    width: float | None = None


@dataclass(frozen=True)
class Crossing:
    """Where along the first parameter, at a value b of the second, the share passes `demanded`.

    at, between two levels, is interpolated; below, above: those levels. low, high: the same of the interval's bounds,
    so that the crossing lies between them, None where they do not get there. rises: whether more runs pass above it.
    """

    b: float
    at: float
    below: float
    above: float
    low: float | None
    high: float | None
    rises: bool


def grid_map(y: Floats, a: Levels, b: Levels) -> ShareMap:
    """Give the map on the levels of two parameters; y (K, S): 1 where a run passes, by point and seed."""
    shape = len(b), len(a)
    found = shares(
        y, np.where((a.of >= 0) & (b.of >= 0), b.of * len(a) + a.of, -1), len(a) * len(b), drawn=False
    )
    share, low, high = (part.reshape(shape) for part in (found.mean, found.low, found.high))
    return ShareMap(a.centre, b.centre, share, low, high)


def smooth_map(y: Floats, u: Floats, a: Floats, b: Floats, at: tuple[Floats, Floats]) -> ShareMap:
    """Give the map of drawn points, smoothed by a Gaussian kernel (Nadaraya 1964, Watson 1964) on a mesh.

    y (K, S): 1 where a run passes; u (K, 2): the points as shares of the parameters' distributions; a (A,), b (B,): the
    mesh likewise; at: the values there. The width is that by which points are best told from the others, or more where
    too few would be near; the interval is Wilson's, with as many points as the kernel's weights come to (Kish 1965). It
    is of the smoothed share, the mean of the true one over the kernel: it leaves out what smoothing changes.
    """
    known = np.isfinite(y).any(axis=1)
    passed, u = np.nanmean(y[known], axis=1), u[known]
    least = float(np.sqrt(ENOUGH / (4.0 * np.pi * len(u))))
    width = max(_width(u[:TRIED], passed[:TRIED]), least)
    over_a, over_b = (_kernel(mesh[:, None] - u[:, k], width) for k, mesh in enumerate((a, b)))
    weight = over_b @ over_a.T
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.clip((over_b * passed) @ over_a.T / weight, 0.0, 1.0)
        points = weight**2 / (over_b**2 @ (over_a**2).T)
    share = np.where((points >= NEAR) & (weight >= LEAST), share, np.nan)
    low, high = wilson(share * points, points)
    return ShareMap(*at, share, low, high, width)


def _width(u: Floats, passed: Floats) -> float:
    """The width of the kernel with the least error where each point is told from the others."""
    square = np.sum((u[:, None] - u[None]) ** 2, axis=-1)

    def error(width: float) -> float:
        weight = np.exp(-0.5 * square / width**2)
        np.fill_diagonal(weight, 0.0)
        told = (weight @ passed + 1e-6 * passed.mean()) / (weight.sum(axis=1) + 1e-6)
        return float(np.mean((told - passed) ** 2))

    return min(WIDTHS, key=error)


def _kernel(off: Floats, width: float) -> Floats:
    return np.exp(-0.5 * (off / width) ** 2)


def crossings(found: ShareMap, demanded: float) -> list[Crossing]:
    """Give where the share of passing runs gets to `demanded` and falls below it, along the first parameter."""
    out = []
    for k, b in enumerate(found.b):
        rows = [_changes(found.a, row, demanded) for row in (found.share[k], found.low[k], found.high[k])]
        for at, rises, i in rows[0]:
            bounds = [
                min((x for x, r, _ in row if r == rises), key=lambda x: abs(x - at), default=None)
                for row in rows[1:]
            ]
            low, high = bounds[::-1] if rises else bounds
            out.append(Crossing(float(b), at, float(found.a[i]), float(found.a[i + 1]), low, high, rises))
    return out


def _changes(a: Floats, share: Floats, demanded: float) -> list[tuple[float, bool, int]]:
    """Where a row of the map crosses, whether upwards, and after which level."""
    enough = share >= demanded
    known = np.isfinite(share[1:]) & np.isfinite(share[:-1])
    out = []
    for i in np.flatnonzero(known & (enough[1:] != enough[:-1])).tolist():
        part = (demanded - share[i]) / (share[i + 1] - share[i])
        out.append((float(a[i] + part * (a[i + 1] - a[i])), bool(enough[i + 1]), i))
    return out
