from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from resim.scenario.natural import Natural

GAPS = st.lists(st.floats(0.1, 3.0), min_size=1, max_size=12)
SEED = st.integers(0, 2**31)


@given(GAPS, SEED)
def test_the_basis_is_that_of_scipys_natural_spline(gaps: list[float], seed: int) -> None:
    knots = 5.0 + np.cumsum([0.0, *gaps])
    values = np.random.default_rng(seed).normal(size=len(knots))
    nodes = np.linspace(knots[0], knots[-1], 57)
    spline = Natural.over(knots, nodes)
    expected = CubicSpline(knots, values, bc_type="natural")
    np.testing.assert_allclose(values @ spline.basis, expected(nodes), atol=1e-9)
    np.testing.assert_allclose(spline.second @ values, expected(knots, 2), atol=1e-7)
    np.testing.assert_allclose(spline.spline(values)(nodes), expected(nodes), atol=1e-9)


@given(st.lists(st.floats(0.3, 3.0), min_size=2, max_size=8), SEED)
def test_derivatives_by_knot_times_are_those_of_central_differences(gaps: list[float], seed: int) -> None:
    knots = np.cumsum([0.0, *gaps])
    values = np.random.default_rng(seed).normal(size=len(knots))
    nodes = np.linspace(knots[0], knots[-1], 41)
    eps = 1e-5
    for j in range(1, len(knots) - 1):
        moved = [CubicSpline(knots + e * (np.arange(len(knots)) == j), values, bc_type="natural")(nodes)
                 for e in (eps, -eps)]  # fmt: skip
        numeric = (moved[0] - moved[1]) / (2.0 * eps)
        own = Natural.over(knots, nodes).by_knot_times(values)[j - 1]
        np.testing.assert_allclose(own, numeric, atol=1e-5 * (1.0 + np.abs(numeric).max()))
