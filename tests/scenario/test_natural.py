"""Natural splines, and the normal equations of their fit, against scipy's and against numeric differences."""

from __future__ import annotations

import inspect

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from scipy.interpolate import CubicSpline

from resim.scenario import kernel
from resim.scenario.natural import natural_spline
from resim.scenario.trace import STEP, Quadrature

MEASURED, EVALUATED = kernel.Measured, kernel._evaluated
NORMAL_EQUATIONS, NEAREST = kernel._normal_equations, kernel._nearest


@njit
def evaluated(measured, v, p_v, h, p_h, start, noise):
    """What the compiled search sees of a candidate, and its normal equations without and with moves of knots."""
    measured = MEASURED(*measured)
    state = EVALUATED(measured, (v, p_v, h, p_h, start), noise)
    fixed, moving = NORMAL_EQUATIONS(measured, state, False), NORMAL_EQUATIONS(measured, state, True)
    seen = state.direction, state.motion, state.off, state.mean
    return seen, (state.heading_off, state.v_bend, state.heading_bend), state.cost, fixed, moving


@njit
def nearest(measured, knots, ridge_bend, ridge):
    return NEAREST(MEASURED(*measured), knots, ridge_bend, ridge)


GAPS = st.lists(st.floats(0.1, 3.0), min_size=1, max_size=12)
SEED = st.integers(0, 2**31)


@settings(deadline=None)
@given(GAPS, SEED)
def test_it_is_scipys_natural_spline(gaps: list[float], seed: int) -> None:
    knots = 5.0 + np.cumsum([0.0, *gaps])
    values = np.random.default_rng(seed).normal(size=len(knots))
    nodes = np.linspace(knots[0], knots[-1], 57)
    expected = CubicSpline(knots, values, bc_type="natural")
    np.testing.assert_allclose(kernel.second(knots, values), expected(knots, 2), atol=1e-7)
    np.testing.assert_allclose(natural_spline(knots, values)(nodes), expected(nodes), atol=1e-9)


def test_a_search_does_not_depend_on_what_multiplies_matrices() -> None:
    """The kernel of the fit calls no library of matrices, whose sums depend on processor and threads."""
    source = inspect.getsource(kernel)
    assert not any(word in source for word in ("np.dot", "np.linalg", "@ ", "np.matmul"))


def residual(t, rule, v, p_v, h, p_h, start, weights):
    """All that is off, by scipy's splines and plain sums; targets are 0."""
    speed, angle = (CubicSpline(k, p, bc_type="natural") for k, p in ((v, p_v), (h, p_h)))
    grid = t[0] + STEP * np.arange(rule.grid)
    motion = lambda s: speed(s) * np.exp(1j * angle(s))  # noqa: E731
    fine = motion(grid)
    places = []
    for n in range(len(t)):
        k = rule.before[n]
        whole = STEP * (fine[: k + 1].sum() - 0.5 * fine[0] - 0.5 * fine[k])
        places.append(start + whole + rule.half[n] * (fine[k] + motion(t[n])))
    places = np.array(places)
    by_heading, by_v, by_h = weights
    return np.concatenate(
        [places.real, places.imag, by_heading * angle(t), by_v * speed(v, 2), by_h * angle(h, 2)]
    )


@pytest.mark.slow
@pytest.mark.parametrize("move", [False, True])
@settings(max_examples=20, deadline=None)
@given(
    st.lists(st.floats(0.3, 2.0), min_size=1, max_size=6), st.lists(st.floats(0.3, 2.0), min_size=1, max_size=6),
    st.floats(0.0, 1e6), SEED,
)  # fmt: skip
def test_the_normal_equations_are_those_of_numeric_differences(
    move: bool, v_gaps: list[float], h_gaps: list[float], t0: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    v, h = (np.cumsum([0.0, *gaps]) for gaps in (v_gaps, h_gaps))
    v, h = (t0 + k * (0.5 * (v[-1] + h[-1]) / k[-1]) for k in (v, h))
    v[-1] = h[-1] = min(v[-1], h[-1])
    t = np.sort(rng.uniform(v[0], v[-1], 40))
    t[0] = v[0]
    rule = Quadrature.over(float(t[0]), t)
    p_v, p_h = rng.normal(10.0, 2.0, len(v)), rng.normal(0.0, 0.5, len(h))
    noise = 0.1
    weights = (noise / kernel.HEADING_OFF, noise / kernel.BEND_V, noise / kernel.BEND_HEADING)
    args = (t, rule, v, p_v, h, p_h, 3.0 - 2.0j, weights)
    off = residual(*args)
    size = len(t)
    parts = [len(v), len(v) - 2 if move else 0, len(h), len(h) - 2 if move else 0, 2]
    eps = 1e-5

    def moved(c: int, by: float):
        a, ka, b, kb = v.copy(), p_v.copy(), h.copy(), p_h.copy()
        start = 3.0 - 2.0j
        for part, (values, offset) in enumerate(((ka, 0), (a, 1), (kb, 0), (b, 1), (None, 0))):
            if c < parts[part]:
                if values is None:
                    start += by * (1.0, 1j)[c]
                else:
                    values[c + offset] += by
                break
            c -= parts[part]
        return t, rule, a, ka, b, kb, start, weights

    jacobian = np.array([residual(*moved(c, eps)) - residual(*moved(c, -eps)) for c in range(sum(parts))]) / (
        2.0 * eps
    )
    knot_times = np.r_[len(v) : len(v) + parts[1], sum(parts[:3]) : sum(parts[:4])]
    bends = np.arange(3 * size, len(off))
    jacobian[np.ix_(knot_times, bends)] = 0.0  # what the prior says of second derivatives is held there
    nothing = np.zeros(size)
    measured = (t, nothing + 0j, nothing, nothing, rule.nodes, rule.grid, rule.before, rule.own, rule.half)
    seen, rest, cost, *equations = evaluated(measured, v, p_v, h, p_h, 3.0 - 2.0j, noise)
    _, _, places, mean = seen
    np.testing.assert_allclose(places, off[:size] + 1j * off[size : 2 * size], rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(np.concatenate(rest), off[2 * size :], rtol=1e-7, atol=1e-6)
    assert cost == pytest.approx(off @ off)
    assert mean == pytest.approx(np.abs(places).mean())
    normal, gradient = equations[move]
    expected = jacobian @ jacobian.T
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected))) + 1e-6
    assert np.abs((normal - expected) / scale).max() < 1e-4
    np.testing.assert_allclose(gradient, jacobian @ off, rtol=1e-3, atol=1e-3 * np.abs(jacobian @ off).max())


@pytest.mark.slow
def test_what_lies_beyond_the_reach_and_in_other_windows_is_there() -> None:
    rng = np.random.default_rng(0)
    knots = np.cumsum([0.0, *rng.uniform(0.6, 2.5, 80)])
    t = np.arange(0.0, knots[-1], 0.1)
    rule = Quadrature.over(0.0, t)
    assert len(t) > 3 * kernel.WINDOW
    p_v, p_h = rng.normal(10.0, 2.0, 81), rng.normal(0.0, 0.3, 81)
    nothing = np.zeros(len(t))
    measured = (t, nothing + 0j, nothing, nothing, rule.nodes, rule.grid, rule.before, rule.own, rule.half)
    (direction, motion, off, _), _, _, (normal, gradient), _ = evaluated(
        measured, knots, p_v, knots, p_h, 0j, 0.0
    )
    basis = CubicSpline(knots, np.eye(81), bc_type="natural")(rule.nodes).T
    rows = np.vstack(
        [rule(basis * direction), rule(basis * 1j * motion), np.ones(len(t)), 1j * np.ones(len(t))]
    )
    expected = (rows @ rows.conj().T).real
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert np.abs((normal - expected) / scale).max() < 1e-7
    np.testing.assert_allclose(gradient, (rows.conj() @ off).real, rtol=1e-6)


@pytest.mark.parametrize(
    ("begin", "step"),
    [
        (7.846, 0.1),
        (1.7e9, 0.1),
        *(pytest.param(*one, marks=pytest.mark.slow) for one in ((206.91, 0.1), (0.0, 0.04))),
    ],
)
def test_the_start_is_the_spline_nearest_to_the_samples(begin: float, step: float) -> None:
    """Also where a time and its node lie on two sides of a knot, by a rounding, beyond the reach of columns."""
    t = begin + step * np.arange(int(60.0 / step))
    knots = np.linspace(t[0], t[-1], 25)
    rule = Quadrature.over(float(t[0]), t)
    v, heading = 10.0 + np.sin(0.3 * (t - begin)), 0.1 * np.cos(0.2 * (t - begin))
    measured = (t, v + 0j, heading, v, rule.nodes, rule.grid, rule.before, rule.own, rule.half)
    found = []
    for _ in range(5):
        matrix, right = nearest(measured, knots, 1e-9, 1e-9)
        found.append(np.linalg.solve(matrix, right.T))
    assert all(np.array_equal(one, found[0]) for one in found)
    basis = CubicSpline(knots - begin, np.eye(25), bc_type="natural")(t - begin)
    expected = np.linalg.lstsq(basis, np.column_stack([v, heading]), rcond=None)[0]
    np.testing.assert_allclose(found[0], expected, atol=2e-3)
