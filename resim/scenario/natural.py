"""The natural cubic spline as a linear map of its knot values, with its derivative by knot times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from resim.core.geometry import Floats


@dataclass(frozen=True, eq=False)
class Natural:
    """Natural cubic spline over knot times (K,), evaluated at fixed nodes (T,): s = values @ basis.

    For segment i with u = t - tau_i, w = tau_i+1 - t, h = u + w and second derivatives M at the knots:
    s = y_i w/h + y_i+1 u/h + M_i (w³/h - h w)/6 + M_i+1 (u³/h - h u)/6 and A M = R y.

    basis: (K, T). second: (K, K), values -> second derivatives at the knots. segment: (T,), in which one each node is.
    """

    knots: Floats
    basis: Floats
    second: Floats
    segment: NDArray[np.intp]
    _cubic: Floats
    _inverse: Floats

    @classmethod
    def over(cls, knots: Floats, nodes: Floats) -> Natural:
        """Build the basis of the natural spline with these knots at these nodes."""
        k, every = len(knots), np.arange(len(nodes))
        h = np.diff(knots)
        i = np.searchsorted(knots[1:-1], nodes, side="right")
        u, w, hi = nodes - knots[i], knots[i + 1] - nodes, h[i]
        matrix, rhs = np.eye(k), np.zeros((k, k))
        j = np.arange(1, k - 1)
        matrix[j, j - 1], matrix[j, j], matrix[j, j + 1] = h[:-1], 2.0 * (h[:-1] + h[1:]), h[1:]
        rhs[j, j - 1], rhs[j, j], rhs[j, j + 1] = 6.0 / h[:-1], -6.0 / h[:-1] - 6.0 / h[1:], 6.0 / h[1:]
        inverse = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
        second, cubic = inverse @ rhs, np.zeros((k, len(nodes)))
        cubic[i, every], cubic[i + 1, every] = (w * w / hi - hi) * w / 6.0, (u * u / hi - hi) * u / 6.0
        basis = second.T @ cubic
        basis[i, every] += w / hi
        basis[i + 1, every] += u / hi
        return cls(knots, basis, second, i, cubic, inverse)

    def by_knot_times(self, values: Floats) -> Floats:
        """Give the derivatives (K - 2, T) of the spline at the nodes by the times of its inner knots.

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
        out = (self._inverse @ rhs).T @ self._cubic - slope[:, None] * self.basis[1:-1]
        own = np.flatnonzero(self.segment >= 1)
        i = self.segment[own]
        out[i - 1, own] += self._cubic[i, own] * jump[i - 1]
        return out

    def spline(self, values: Floats) -> PPoly:
        """Give the spline with these values at the knots."""
        h, m = np.diff(self.knots), self.second @ values
        slope = np.diff(values) / h - h * (2.0 * m[:-1] + m[1:]) / 6.0
        return PPoly(np.stack([np.diff(m) / (6.0 * h), 0.5 * m[:-1], slope, values[:-1]]), self.knots)
