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
from resim.core.intervals import Ints

NODE = 2.0
"""Most of the parameter between two nodes of the table of the way."""
FEWEST = 4
"""Points that a route by points has at least: a cubic needs four (Kaefer 2022, Section 4.4)."""
_GAUSS = np.polynomial.legendre.leggauss(8)
_AND_END = np.append(_GAUSS[0], 1.0)
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
        x, y, dx, dy, ddx, ddy = self.derivatives(self.parameter(way))
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
        left = np.arange(len(at))
        for _ in range(_STEPS):
            more, speed = self._integral(low[left], at[left])
            off = known[row[left]] + more - way[left]
            far = np.abs(off) >= _EXACT
            left, off, speed = left[far], off[far], speed[far]
            if not len(left):
                break
            at[left] = np.clip(at[left] - off / np.maximum(speed, _HAIR), low[left], high[left])
        return at

    def way(self, q: float) -> float:
        """Give the way [m] at a parameter, counted over all pieces."""
        row = int(np.clip(np.searchsorted(self._nodes, q, side="right") - 1, 0, len(self._nodes) - 2))
        more, _ = self._integral(self._nodes[row : row + 1], np.array([q]))
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

    def derivatives(self, q: Floats) -> Floats:
        """Give x, y and their first and second derivatives (6, K) at parameters q (K,), counted over all pieces."""
        own, inside = self.inside(q)
        out = np.empty((6, len(q)))
        for k in np.unique(own).tolist():
            rows = own == k
            out[:, rows] = self.pieces[k].at(inside[rows])
        return out

    def inside(self, q: Floats) -> tuple[Ints, Floats]:
        """Give the numbers (K,) of the pieces of parameters q (K,), and the parameters in them."""
        own = np.clip(np.searchsorted(self._q0, q, side="right") - 1, 0, len(self.pieces) - 1)
        return own, q - self._q0[own]

    def _integral(self, low: Floats, high: Floats) -> tuple[Floats, Floats]:
        """The way (K,) [m] between two parameters (K,) of one piece, and the speed at the second."""
        return _gauss(self.derivatives, low, high)


def _gauss(derivatives: Callable[[Floats], Floats], low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """The ways (K,) between parameters (K,), by Gauss's rule with eight points, and the speeds (K,) at `high`."""
    half = 0.5 * (high - low)
    at = (low + half)[:, None] + half[:, None] * _AND_END
    _, _, dx, dy, _, _ = derivatives(at.ravel())
    speed = np.hypot(dx, dy).reshape(at.shape)
    return half * (speed[:, :-1] * _GAUSS[1]).sum(axis=1), speed[:, -1]


@lru_cache(maxsize=20_000)
def _way_table(piece: CurvePiece) -> tuple[Floats, Floats]:
    """Parameters of nodes (K,) of a piece, and the ways between them (K - 1,) [m]; kept, as lanes are shared."""
    nodes = np.linspace(0.0, piece.length, max(int(np.ceil(piece.length / NODE)), 1) + 1)
    return nodes, _gauss(piece.at, nodes[:-1], nodes[1:])[0]


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
