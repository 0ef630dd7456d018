"""The natural cubic spline, of its values at the knots."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PPoly

from resim.core.geometry import Floats


def second_derivatives(knots: Floats, values: Floats) -> Floats:
    """Give the second derivatives (K,) at the knots (K,) of the natural spline with these values (K,)."""
    from resim.scenario import kernel  # compiled: numba is imported where it is used only

    return np.asarray(kernel.second(knots, values), dtype=np.float64)


def natural_spline(knots: Floats, values: Floats) -> PPoly:
    """Give the natural spline with these values (K,) at the knots (K,)."""
    h, m = np.diff(knots), second_derivatives(knots, values)
    slope = np.diff(values) / h - h * (2.0 * m[:-1] + m[1:]) / 6.0
    return PPoly(np.stack([np.diff(m) / (6.0 * h), 0.5 * m[:-1], slope, values[:-1]]), knots)
