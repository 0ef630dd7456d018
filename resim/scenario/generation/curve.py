"""A path as a curve of a parameter, asked by the way along it: position, heading and curvature in closed form.

Kaefer 2022, Section 4.4: the path is "parameterized by the distance travelled along the path". The way is the integral
of the curve's speed by Gauss's rule; nothing is differenced.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from functools import cached_property, lru_cache
from typing import Protocol

import numpy as np
from scipy.interpolate import CubicSpline

from resim.core.errors import ResimError
from resim.core.geometry import Floats

NODE = 2.0
"""Most of the parameter between two nodes of the table of the way."""
FEWEST = 4
"""Points that a route by points has at least: a cubic needs four (Kaefer 2022, Section 4.4)."""
_GAUSS = np.polynomial.legendre.leggauss(8)
_EXACT = 1e-10
_STEPS = 40
_HAIR = 1e-9


class CurvePiece(Hashable, Protocol):
    """A smooth piece of a curve."""

    @property
    def length(self) -> float:
        """Where its parameter ends, which begins at 0."""
        ...

    def at(self, q: Floats) -> Floats:
        """Give x, y and their first and second derivatives (6, K) at parameters q (K,)."""
        ...


class RouteCurve:
    """Pieces one after the other, asked by the way [m] from the start of the first."""

    def __init__(self, pieces: Sequence[CurvePiece]) -> None:
        self.pieces = tuple(pieces)
        self._q0 = np.concatenate([[0.0], np.cumsum([piece.length for piece in pieces])])

    @property
    def length(self) -> float:
        """Its whole way [m]."""
        return float(self._ways[-1])

    def at(self, way: Floats) -> Floats:
        """Give x, y [m], heading [rad, not wrapped] and curvature [1/m] (4, K) at ways (K,) [m], within its length."""
        x, y, dx, dy, ddx, ddy = self._derivatives(self.parameter(way))
        speed = np.hypot(dx, dy)
        heading = np.unwrap(np.arctan2(dy, dx)) if len(way) else np.zeros(0)
        return np.stack([x, y, heading, (dx * ddy - dy * ddx) / speed**3])

    def parameter(self, way: Floats) -> Floats:
        """Give the parameters (K,), counted over all pieces, at ways (K,) [m], by Newton's method."""
        q, known = self._nodes, self._ways
        row = np.clip(np.searchsorted(known, way, side="right") - 1, 0, len(q) - 2)
        low, high = q[row], q[row + 1]
        share = (way - known[row]) / np.maximum(known[row + 1] - known[row], _HAIR)
        at = low + np.clip(share, 0.0, 1.0) * (high - low)
        for _ in range(_STEPS):
            off = known[row] + self._integral(low, at) - way
            if np.abs(off).max(initial=0.0) < _EXACT:
                break
            at = np.clip(at - off / np.maximum(self._speed(at), _HAIR), low, high)
        return at

    def way(self, q: float) -> float:
        """Give the way [m] at a parameter, counted over all pieces."""
        row = int(np.clip(np.searchsorted(self._nodes, q, side="right") - 1, 0, len(self._nodes) - 2))
        more = self._integral(self._nodes[row : row + 1], np.array([q]))
        return float(self._ways[row] + more[0])

    @cached_property
    def _nodes(self) -> Floats:
        tables = [_way_table(piece) for piece in self.pieces]
        parts = [q0 + nodes[:-1] for q0, (nodes, _) in zip(self._q0[:-1], tables, strict=True)]
        return np.concatenate([*parts, self._q0[-1:]])

    @cached_property
    def _ways(self) -> Floats:
        steps = [steps for _, steps in map(_way_table, self.pieces)]
        return np.concatenate([[0.0], np.cumsum(np.concatenate(steps))])

    def _integral(self, low: Floats, high: Floats) -> Floats:
        """The way (K,) [m] between two parameters (K,) of one piece."""
        return _gauss(self._speed, low, high)

    def _speed(self, q: Floats) -> Floats:
        _, _, dx, dy, _, _ = self._derivatives(q)
        return np.asarray(np.hypot(dx, dy))

    def _derivatives(self, q: Floats) -> Floats:
        out = np.empty((6, len(q)))
        own = np.clip(np.searchsorted(self._q0, q, side="right") - 1, 0, len(self.pieces) - 1)
        for k in np.unique(own).tolist():
            rows = own == k
            out[:, rows] = self.pieces[k].at(q[rows] - self._q0[k])
        return out


def _gauss(speed: Callable[[Floats], Floats], low: Floats, high: Floats) -> Floats:
    """The integrals (K,) of a speed between parameters (K,), by Gauss's rule with eight points."""
    x, weight = _GAUSS
    half = 0.5 * (high - low)
    at = (low + half)[:, None] + half[:, None] * x
    return np.asarray(half * (speed(at.ravel()).reshape(at.shape) * weight).sum(axis=1))


@lru_cache(maxsize=20_000)
def _way_table(piece: CurvePiece) -> tuple[Floats, Floats]:
    """Parameters of nodes (K,) of a piece, and the ways between them (K - 1,) [m]; kept, as lanes are shared."""
    nodes = np.linspace(0.0, piece.length, max(int(np.ceil(piece.length / NODE)), 1) + 1)

    def speed(q: Floats) -> Floats:
        _, _, dx, dy, _, _ = piece.at(q)
        return np.asarray(np.hypot(dx, dy))

    return nodes, _gauss(speed, nodes[:-1], nodes[1:])


class SplinePiece:
    """The cubic spline through points, over the length of the lines between them."""

    def __init__(self, points: Floats) -> None:
        steps = np.hypot(*np.diff(points, axis=0).T)
        if len(points) < FEWEST or not (steps > 0.0).all():
            raise ResimError(
                f"a route by points has {FEWEST} or more points, each apart from the one before it"
            )
        self._spline = CubicSpline(np.concatenate([[0.0], np.cumsum(steps)]), points)
        self.length = float(steps.sum())

    def at(self, q: Floats) -> Floats:
        """Give x, y and their first and second derivatives (6, K) at q (K,) [m] along the lines."""
        return np.concatenate([self._spline(q).T, self._spline(q, 1).T, self._spline(q, 2).T])
