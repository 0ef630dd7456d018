"""The natural cubic spline as a linear map of its knot values, with its derivative by knot times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resim.core.geometry import Floats


@dataclass(frozen=True, eq=False)
class Natural:
    """Natural cubic spline over knot times (K,), evaluated at fixed nodes (T,): s = basis @ values.

    For segment i with u = t - tau_i, w = tau_i+1 - t, h = u + w and second derivatives M at the knots:
    s = y_i w/h + y_i+1 u/h + M_i (w³/h - h w)/6 + M_i+1 (u³/h - h u)/6 and A M = R y.
    """

    knots: Floats
    nodes: Floats
    basis: Floats
    second: Floats  # (K, K): values -> second derivatives at the knots
    _left: Floats
    _right: Floats
    _segment: np.ndarray[tuple[int], np.dtype[np.intp]]
    _inverse: Floats

    @classmethod
    def over(cls, knots: Floats, nodes: Floats) -> Natural:
        """Build the basis of the natural spline with these knots at these nodes."""
        k, rows = len(knots), np.arange(len(nodes))
        h = np.diff(knots)
        i = np.clip(np.searchsorted(knots, nodes, side="right") - 1, 0, k - 2)
        u, w, hi = nodes - knots[i], knots[i + 1] - nodes, h[i]
        left, right = (w * w / hi - hi) * w / 6.0, (u * u / hi - hi) * u / 6.0
        matrix, rhs = np.eye(k), np.zeros((k, k))
        j = np.arange(1, k - 1)
        matrix[j, j - 1], matrix[j, j], matrix[j, j + 1] = h[:-1], 2.0 * (h[:-1] + h[1:]), h[1:]
        rhs[j, j - 1], rhs[j, j], rhs[j, j + 1] = 6.0 / h[:-1], -6.0 / h[:-1] - 6.0 / h[1:], 6.0 / h[1:]
        inverse = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
        second = inverse @ rhs
        basis = left[:, None] * second[i] + right[:, None] * second[i + 1]
        basis[rows, i] += w / hi
        basis[rows, i + 1] += u / hi
        return cls(knots, nodes, basis, second, left, right, i, inverse)

    def by_knot_times(self, values: Floats) -> Floats:
        """Give the derivatives (T, K - 2) of the spline at the nodes by the times of its inner knots.

        Moving knot j lets s(tau_j) slide along the curve and moves the jump of the third derivative, so the
        derivative is -s'(tau_j) times the basis function of knot j, plus the piecewise cubic that vanishes at
        all knots and whose second derivative jumps by s'''_j-1 - s'''_j at knot j.
        """
        k, h, m = len(self.knots), np.diff(self.knots), self.second @ values
        j = np.arange(1, k - 1)
        slope = (values[j + 1] - values[j]) / h[j] - h[j] * (2.0 * m[j] + m[j + 1]) / 6.0
        third = np.diff(m) / h
        jump = third[j - 1] - third[j]
        rhs = np.zeros((k, k - 2))
        rhs[j, j - 1] = -2.0 * h[j] * jump
        inner = j < k - 2
        rhs[j[inner] + 1, j[inner] - 1] = -h[j[inner]] * jump[inner]
        moved = self._inverse @ rhs
        i = self._segment
        out = self._left[:, None] * moved[i] + self._right[:, None] * moved[i + 1]
        out -= self.basis[:, 1:-1] * slope
        own = np.flatnonzero(i >= 1)
        out[own, i[own] - 1] += self._left[own] * jump[i[own] - 1]
        return out
