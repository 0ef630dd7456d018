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


def powers(coefficients: Floats, p: Floats, order: int = 0) -> Floats:
    """Give the polynomials' (..., 4; a, b, c, d) derivative of this order at p."""
    a, b, c, d = np.moveaxis(coefficients, -1, 0)
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


def invert(geometry: Geometry) -> Inversion:
    """Tabulate the parameter over the distance along a polynomial element.

    arcLength: the parameter is the distance (OpenDRIVE 1.8, 9.6.1). poly3: u follows from the arc length.
    normalized: p follows from the arc length, scaled so that p = 1 stands at the element's length.
    """
    if geometry.kind == "paramPoly3" and not geometry.normalized:
        return Inversion(geometry.length, np.array([0.0, geometry.length]), np.ones(2))
    u, v = np.array(geometry.u), np.array(geometry.v)
    end = 1.0 if geometry.normalized else geometry.length
    grid = np.linspace(0.0, end, INTERVALS + 1)
    cumulated = np.concatenate([[0.0], np.cumsum(_arc(u, v, grid[:-1], grid[1:]))])
    nodes = int(np.clip(np.ceil(geometry.length / SPACING), 16, 4096)) + 1
    scale = cumulated[-1] / geometry.length if geometry.normalized else 1.0
    target = np.linspace(0.0, geometry.length, nodes) * scale
    p = np.interp(target, cumulated, grid)
    for _ in range(6):
        cell = np.clip((p / end * INTERVALS).astype(int), 0, INTERVALS - 1)
        reached = cumulated[cell] + _arc(u, v, grid[cell], p)
        p = np.clip(p - (reached - target) / _speed(u, v, p), 0.0, end)
    return Inversion(geometry.length / (nodes - 1), p, scale / _speed(u, v, p))


def _speed(u: Floats, v: Floats, p: Floats) -> Floats:
    return np.maximum(np.hypot(powers(u, p, 1), powers(v, p, 1)), 1e-9)


def _arc(u: Floats, v: Floats, start: Floats, end: Floats) -> Floats:
    p = start[:, None] + (end - start)[:, None] * NODES
    return np.asarray((end - start) * (_speed(u, v, p) @ WEIGHTS))
