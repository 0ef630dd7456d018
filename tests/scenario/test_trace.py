from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from resim.scenario.trace import STEP, Quadrature, Trace

KNOTS = np.array([0.3, 1.0, 2.2, 3.0, 4.3])


@pytest.fixture
def trace() -> Trace:
    v = CubicSpline(KNOTS, [20.0, 22.0, 15.0, 14.0, 16.0], bc_type="natural")
    return Trace(100.0, -5.0, v, CubicSpline(KNOTS, [3.0, 3.1, 3.3, 3.2, 3.1], bc_type="natural"))


@given(st.lists(st.floats(0.3, 4.3), min_size=1, max_size=20))
def test_a_position_does_not_depend_on_the_other_times_that_are_asked_for(times: list[float]) -> None:
    v = CubicSpline(KNOTS, [20.0, 22.0, 15.0, 14.0, 16.0], bc_type="natural")
    one = Trace(0.0, 0.0, v, CubicSpline(KNOTS, [0.0, 0.3, 0.1, 0.2, 0.4], bc_type="natural"))
    together = one.states(np.array(times))
    for k, t in enumerate(times):
        alone = one.states(np.array([t]))
        assert (alone.x[0], alone.y[0], alone.heading[0]) == (
            together.x[k],
            together.y[k],
            together.heading[k],
        )


def test_positions_are_the_integral_of_speed_and_heading(trace: Trace) -> None:
    t = np.linspace(0.3, 4.3, 9)
    solved = solve_ivp(
        lambda t, _: [trace.v(t) * np.cos(trace.heading(t)), trace.v(t) * np.sin(trace.heading(t))],
        (0.3, 4.3), [100.0, -5.0], t_eval=t, rtol=1e-10, atol=1e-10,
    )  # fmt: skip
    states = trace.states(t)
    np.testing.assert_allclose([states.x, states.y], solved.y, atol=1e-3)  # trapezoids of 20 ms
    np.testing.assert_allclose((states.x[0], states.y[0]), (100.0, -5.0), atol=1e-12)


def test_the_rule_is_the_trapezoid_rule_on_its_own_grid(trace: Trace) -> None:
    grid = 0.3 + STEP * np.arange(51)
    expected = 100.0 + np.trapezoid(trace.v(grid) * np.cos(trace.heading(grid)), grid)
    np.testing.assert_allclose(trace.states(grid[-1:]).x, expected, atol=1e-9)


def test_a_time_on_the_grid_is_no_further_node() -> None:
    t = 0.3 + STEP * np.array([0.0, 1.0, 3.0, 3.5, 2.0])
    rule = Quadrature.over(0.3, t)
    np.testing.assert_allclose(rule.nodes, [*(0.3 + STEP * np.arange(4)), t[3]], atol=1e-12)
    np.testing.assert_allclose(rule.nodes[rule.own], t, atol=1e-12)


def test_the_rule_takes_complex_integrands_and_many_at_once() -> None:
    t = np.array([0.3, 0.42, 0.431, 1.3, 0.7])
    rule = Quadrature.over(0.3, t)
    lines = np.array([[1.0], [2.0 - 1.0j]]) * (rule.nodes - 0.3) + 1.0j  # trapezoids have no error
    expected = np.array([[0.5], [1.0 - 0.5j]]) * (t - 0.3) ** 2 + 1.0j * (t - 0.3)
    np.testing.assert_allclose(rule(lines), expected, atol=1e-12)
    np.testing.assert_allclose(rule(lines[1]), expected[1], atol=1e-12)


def test_derivatives_are_those_of_the_splines(trace: Trace) -> None:
    t = np.linspace(0.4, 4.2, 20)
    states, eps = trace.states(t), 1e-6
    np.testing.assert_allclose(states.a, (trace.v(t + eps) - trace.v(t - eps)) / (2 * eps), atol=1e-5)
    turn = (trace.heading(t + eps) - trace.heading(t - eps)) / (2 * eps)
    np.testing.assert_allclose(states.yaw_rate, turn, atol=1e-5)
    np.testing.assert_allclose(states.v, trace.v(t), rtol=0.0, atol=1e-10)


def test_there_is_nothing_outside(trace: Trace) -> None:
    states = trace.states([0.29, 0.3, 4.3, 4.31])
    for name in ("x", "y", "heading", "v", "a", "yaw_rate"):
        np.testing.assert_array_equal(np.isfinite(getattr(states, name)), [False, True, True, False], name)
    assert trace.states([]).x.shape == (0,)


def test_a_rounding_error_outside_is_inside(trace: Trace) -> None:
    states = trace.states([0.3 - 1e-9, 4.3 + 1e-9])
    np.testing.assert_allclose(states.v, [20.0, 16.0])
