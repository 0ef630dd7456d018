"""Polynomial curves (poly3, paramPoly3): from the distance along the curve to its parameter and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resim.core.geometry import Floats
from resim.road.opendrive.model import Geometry

NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)
NODES, WEIGHTS = 0.5 * (NODES + 1.0), 0.5 * WEIGHTS  # on [0, 1]
SPACING = 1.0
INTERVALS = 256
CLOSE, REACHED = 1e-6, 1e-7
FEWEST, MOST = 8, 8192
Coefficients = tuple[float, float, float, float]


def powers(coefficients: Floats, p: Floats, order: int = 0) -> Floats:
    """Give the polynomials' (..., 4; a, b, c, d) derivative of this order at p."""
    a, b, c, d = (coefficients[..., k] for k in range(4))
    if order == 0:
        return np.asarray(a + p * (b + p * (c + p * d)))
    if order == 1:
        return np.asarray(b + p * (2.0 * c + 3.0 * p * d))
    return np.asarray(2.0 * c + 6.0 * p * d if order == 2 else 6.0 * d + 0.0 * p)


@dataclass(frozen=True)
class Inversion:
    """Parameter at evenly spaced distances: nodes `step` [m] apart, parameter p and dp/ds there."""

    step: float
    p: Floats
    slope: Floats

    def between(self) -> Floats:
        """Give the parameter in the middle between the nodes, by cubic Hermite interpolation."""
        bow = 0.125 * self.step * (self.slope[:-1] - self.slope[1:])
        return np.asarray(0.5 * (self.p[:-1] + self.p[1:]) + bow)


def invert(geometry: Geometry) -> Inversion:
    """Tabulate the parameter over the distance along a polynomial element.

    arcLength: the parameter is the distance (OpenDRIVE 1.8, 9.6.1). poly3: u follows from the arc length.
    normalized: p follows from the arc length, scaled so that p = 1 stands at the element's length. Nodes are
    as dense as it takes for values between them to be good to 1e-7 m.
    """
    if geometry.kind == "paramPoly3" and not geometry.normalized:
        return Inversion(geometry.length, np.array([0.0, geometry.length]), np.ones(2))
    u, v = geometry.u, geometry.v
    end = 1.0 if geometry.normalized else geometry.length
    grid = np.linspace(0.0, end, INTERVALS + 1)
    cumulated = np.concatenate([[0.0], np.cumsum(_arc(u, v, grid[:-1], grid[1:]))])
    scale = cumulated[-1] / geometry.length if geometry.normalized else 1.0
    count = int(np.clip(np.ceil(geometry.length / SPACING), FEWEST, MOST))
    while True:
        p = _parameters(u, v, grid, cumulated, np.linspace(0.0, geometry.length, 2 * count + 1) * scale)
        step, slope = 0.5 * geometry.length / count, scale / _speed(u, v, p)
        off = np.abs(Inversion(2.0 * step, p[::2], slope[::2]).between() - p[1::2]) * _speed(u, v, p[1::2])
        if off.max() < CLOSE or count >= MOST:  # twice as dense is 16 times closer
            return Inversion(step, p, slope)
        count *= 2


def _parameters(u: Coefficients, v: Coefficients, grid: Floats, cumulated: Floats, target: Floats) -> Floats:
    """The parameters at which the arc length from 0 is `target`, by Newton from a table over `grid`."""
    p = np.interp(target, cumulated, grid)
    end = grid[-1]
    for _ in range(6):
        cell = np.minimum((p * (INTERVALS / end)).astype(int), INTERVALS - 1)
        off = cumulated[cell] + _arc(u, v, grid[cell], p) - target
        p = np.minimum(np.maximum(p - off / _speed(u, v, p), 0.0), end)
        if np.abs(off).max() < REACHED:
            break
    return p


def _speed(u: Coefficients, v: Coefficients, p: Floats) -> Floats:
    du, dv = (w[1] + p * (2.0 * w[2] + 3.0 * w[3] * p) for w in (u, v))
    return np.maximum(np.sqrt(du * du + dv * dv), 1e-9)


def _arc(u: Coefficients, v: Coefficients, start: Floats, end: Floats) -> Floats:
    p = start[:, None] + (end - start)[:, None] * NODES
    return np.asarray((end - start) * (_speed(u, v, p) @ WEIGHTS))
