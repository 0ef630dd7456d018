from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from resim.scenario.fit import TraceFit, fit_trace
from resim.scenario.kernel import MIN_SEGMENT
from resim.scenario.trace import Trace

RATE = 25.0


def sampled(trace: Trace, t: np.ndarray, noise: float = 0.0, seed: int = 0) -> tuple[np.ndarray, ...]:
    states = trace.states(t)
    error = (
        np.random.default_rng(seed).normal(scale=noise, size=(2, len(t))) if noise else np.zeros((2, len(t)))
    )
    return t, states.x + error[0], states.y + error[1], states.heading, states.v


def drive(knots: object, v: object, heading: object) -> Trace:
    return Trace(50.0, -20.0, *(CubicSpline(knots, values, bc_type="natural") for values in (v, heading)))


def cut_in() -> Trace:
    """9.2 s as in Section 5.2: cut-in from the left and braking."""
    knots = [0.0, 1.5, 3.0, 4.5, 6.0, 7.5, 9.2]
    return drive(knots, [32.5, 32.6, 32.0, 29.0, 23.5, 18.0, 14.0], [0.0, -0.01, -0.05, -0.03, 0.0, 0.0, 0.0])


def times(end: float, rate: float = RATE) -> np.ndarray:
    return np.arange(int(end * rate + 1e-9) + 1) / rate


def from_truth(fit: TraceFit, truth: Trace, t: np.ndarray) -> np.ndarray:
    one, two = fit.trace.states(t), truth.states(t)
    return np.hypot(one.x - two.x, one.y - two.y)


@settings(deadline=None, max_examples=30)
@given(
    st.lists(st.floats(5.0, 35.0), min_size=3, max_size=5),
    st.lists(st.floats(-0.3, 0.3), min_size=5, max_size=5),
    st.floats(-3.1, 3.1),
)
def test_what_the_splines_can_say_exactly_is_recovered(
    v: list[float], turn: list[float], heading0: float
) -> None:
    knots = 2.4 * np.arange(len(v))
    truth = drive(knots, v, heading0 + np.array(turn[: len(v)]))
    t = times(float(knots[-1]))
    fit = fit_trace(*sampled(truth, t))
    assert fit.distance.mean() < 2e-3
    end = fit.trace.states(t)
    np.testing.assert_allclose(end.v, truth.v(t), atol=0.2)
    np.testing.assert_allclose(end.heading, truth.heading(t), atol=0.02)


def test_the_distance_is_that_of_the_trace() -> None:
    t, x, y, heading, v = sampled(cut_in(), times(9.2), 0.05)
    fit = fit_trace(t, x, y, heading, v)
    states = fit.trace.states(t)
    np.testing.assert_allclose(fit.distance, np.hypot(states.x - x, states.y - y), atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_one_centimetre_of_noise_leaves_no_more_than_itself(seed: int) -> None:
    t = times(9.2)
    fit = fit_trace(*sampled(cut_in(), t, 0.01, seed))
    assert 0.010 < fit.distance.mean() < 0.016
    assert from_truth(fit, cut_in(), t).mean() < 0.007
    assert len(fit.trace.v.x) - 1 <= 14  # segments, of 230 samples: it does not follow the noise


@pytest.mark.parametrize("noise", [0.03, 0.1, 0.3])
def test_the_error_grows_with_the_noise_and_stays_at_its_size(noise: float) -> None:
    t = times(9.2)
    fit = fit_trace(*sampled(cut_in(), t, noise))
    mean_of_noise = noise * np.sqrt(np.pi / 2.0)  # mean length of two normal components
    assert 0.8 * mean_of_noise < fit.distance.mean() < 1.15 * mean_of_noise
    assert from_truth(fit, cut_in(), t).mean() < 0.6 * mean_of_noise


def test_knots_keep_their_distance_and_span_the_trace() -> None:
    t = times(9.2)
    trace = fit_trace(*sampled(cut_in(), t, 0.02)).trace
    for spline in (trace.v, trace.heading):
        assert (spline.x[0], spline.x[-1]) == (t[0], t[-1])
        assert np.diff(spline.x).min() >= MIN_SEGMENT - 1e-9


def test_the_splines_are_natural_and_twice_continuous() -> None:
    trace = fit_trace(*sampled(cut_in(), times(9.2), 0.02)).trace
    for spline in (trace.v, trace.heading):
        np.testing.assert_allclose(spline([spline.x[0], spline.x[-1]], 2), 0.0, atol=1e-9)
        inner, width = spline.x[1:-1], np.diff(spline.x)[:-1]
        for order, factor in ((0, (1, 1, 1, 1)), (1, (3, 2, 1)), (2, (6, 2))):
            powers = range(3 - order, -1, -1)
            before = sum(f * c[:-1] * width**p for f, c, p in zip(factor, spline.c, powers, strict=False))
            np.testing.assert_allclose(before, spline(inner, order), atol=1e-8)


def test_measured_speed_and_heading_only_start_the_search() -> None:
    t, x, y, heading, v = sampled(cut_in(), times(9.2), 0.005)
    late = fit_trace(t, x, y, heading + 0.02, v + 1.5)  # a late sensor: positions win
    states = late.trace.states(t)
    assert np.abs(states.v - v).mean() < 0.1
    assert np.abs(states.heading - heading).mean() < 0.005


def test_a_wrapped_heading_is_no_turn() -> None:
    knots = [0.0, 2.0, 4.0, 6.0]
    truth = drive(knots, [10.0] * 4, [3.0, 3.1, 3.3, 3.4])
    t, x, y, heading, v = sampled(truth, times(6.0))
    wrapped = np.pi - np.mod(np.pi - heading, 2.0 * np.pi)
    assert np.ptp(wrapped) > 6.0
    fit = fit_trace(t, x, y, wrapped, v)
    assert fit.distance.mean() < 2e-3
    assert np.abs(np.diff(fit.trace.states(t).heading)).max() < 0.02


def test_a_stop_and_a_start() -> None:
    knots = np.arange(0.0, 15.1, 2.5)
    t = times(15.0)
    v = np.clip(np.interp(t, [0, 4, 9, 14, 15], [10, 0, 0, 10, 10]), 0.0, None)
    x = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) / RATE)])
    noise = np.random.default_rng(3).normal(scale=0.01, size=(2, len(t)))
    fit = fit_trace(t, x + noise[0], noise[1], np.full(len(t), 0.4) * 0.0, v)
    states = fit.trace.states(t)
    standing = (t > 4.5) & (t < 8.5)
    assert fit.distance.mean() < 0.025
    assert np.abs(states.v[standing]).max() < 0.15
    assert np.abs(states.heading[standing]).max() < 0.2
    assert len(knots) < len(t)


def test_a_parked_car_stays_and_keeps_its_measured_heading() -> None:
    t = times(10.0)
    noise = np.random.default_rng(1).normal(scale=0.02, size=(2, len(t)))
    fit = fit_trace(t, 100.0 + noise[0], 7.0 + noise[1], np.full(len(t), 1.2), np.zeros(len(t)))
    states = fit.trace.states(t)
    assert np.hypot(states.x - 100.0, states.y - 7.0).max() < 0.03
    np.testing.assert_allclose(states.heading, 1.2, atol=0.1)


def test_a_gap_is_bridged_smoothly() -> None:
    truth, t = cut_in(), times(9.2)
    seen = t[(t < 4.0) | (t > 5.5)]
    fit = fit_trace(*sampled(truth, seen, 0.01))
    assert fit.distance.mean() < 0.016
    assert from_truth(fit, truth, t).max() < 0.3


def test_a_reversing_vehicle_has_negative_speed() -> None:
    truth, t = drive([0.0, 2.0, 4.0, 6.0], [-1.0, -2.0, -2.5, -2.0], [0.3, 0.35, 0.4, 0.5]), times(6.0)
    fit = fit_trace(*sampled(truth, t, 0.01))
    assert fit.distance.mean() < 0.016
    np.testing.assert_allclose(fit.trace.v(t), truth.v(t), atol=0.15)
    np.testing.assert_allclose(fit.trace.heading(t), truth.heading(t), atol=0.05)


@pytest.mark.parametrize("n", [2, 3, 4])
@pytest.mark.parametrize("dt", [0.01, 0.04, 1.0])
def test_a_few_samples_are_enough(n: int, dt: float) -> None:
    t = 3.0 + dt * np.arange(n)
    x = 20.0 * (t - 3.0)
    fit = fit_trace(t, x, np.zeros(n), np.zeros(n), np.full(n, 20.0))
    assert fit.distance.max() < 1e-3
    assert (fit.trace.start, fit.trace.end) == (t[0], t[-1])


def test_a_pedestrian_gives_a_trace_however_it_turns() -> None:
    rng, t = np.random.default_rng(5), times(10.0)
    heading = np.repeat(rng.uniform(-3.1, 3.1, 26), 10)[: len(t)]  # a new direction every 0.4 s
    v = np.full(len(t), 1.4)
    x = np.cumsum(v * np.cos(heading)) / RATE
    y = np.cumsum(v * np.sin(heading)) / RATE
    fit = fit_trace(t, x, y, heading, v)
    states = fit.trace.states(t)
    assert all(
        np.isfinite(getattr(states, name)).all() for name in ("x", "y", "heading", "v", "a", "yaw_rate")
    )
    assert fit.distance.mean() < 1.0  # out of the source's scope: near, not exact


def test_times_far_from_zero_change_nothing() -> None:
    t, x, y, heading, v = sampled(cut_in(), times(9.2), 0.01)
    near, far = fit_trace(t, x, y, heading, v), fit_trace(t + 1000.0, x + 5e5, y + 5.4e6, heading, v)
    np.testing.assert_allclose(far.distance.mean(), near.distance.mean(), rtol=0.05)


def test_the_same_samples_give_the_same_bytes() -> None:
    args = sampled(cut_in(), times(9.2), 0.02)
    one, two = fit_trace(*args).trace, fit_trace(*args).trace
    for a, b in itertools.chain(zip((one.v, one.heading), (two.v, two.heading), strict=True)):
        assert a.c.tobytes() == b.c.tobytes()
        assert a.x.tobytes() == b.x.tobytes()
