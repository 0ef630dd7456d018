"""Errors by chance: long runs against the spreads and correlations that the parameters name."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from perception.worlds import PLACES, STEP, column, correlation, look, model, ring, standing, steps

from resim.perception.model import QUANTITIES
from resim.perception.runtime.sensor import Sensor
from resim.simulation.perception import IdealPerception


def errors_of(
    sensor: Sensor, n: int = 30, duration: float = 200.0, times: list[float] | None = None
) -> dict[str, Any]:
    """Errors (T, n) of objects that stand around the EGO, by quantity."""
    times = times or steps(duration)
    seen, truth = (look(p, ring(n), times, standing) for p in (sensor, IdealPerception()))
    return {q: column(seen, c) - column(truth, c) for q, c in PLACES.items()}


def test_bias_spread_and_correlation_time() -> None:
    times = {"longitudinal": 1.0, "lateral": 0.5, "speed": 2.0, "heading": 0.2, "length": 1.0, "width": 3.0}
    error = {
        q: {
            "bias": {"constant": 0.1},
            "drift": {"constant": 0.05},
            "correlation_time": tau,
            "noise": {"constant": 0.02},
        }
        for q, tau in times.items()
    }
    found = errors_of(Sensor(model(errors=error)))
    for q, tau in times.items():
        e = found[q] - 0.1
        assert abs(e.mean()) < 0.005, q
        assert e.std() == pytest.approx(np.hypot(0.05, 0.02), rel=0.04), q
        lags = np.array([1, round(tau / STEP)])
        drift = 0.05**2 / (0.05**2 + 0.02**2)
        for lag in lags.tolist():
            assert correlation(e, e, lag) == pytest.approx(drift * np.exp(-lag * STEP / tau), abs=0.03), q
    assert abs(correlation(found["longitudinal"] - 0.1, found["lateral"] - 0.1, 0)) < 0.04


def test_drifts_are_coupled() -> None:
    coupling = np.eye(6)
    for (i, j), value in {(0, 2): 0.8, (0, 3): -0.6, (2, 3): -0.5}.items():
        coupling[i, j] = coupling[j, i] = value
    error = {q: {"drift": {"constant": 0.05}} for q in QUANTITIES} | {"coupling": coupling.tolist()}
    error["heading"]["correlation_time"] = 4.0
    found = errors_of(Sensor(model(errors=error)), n=60)
    apart = 2.0 * np.sqrt(4.0) / 5.0
    assert correlation(found["longitudinal"], found["speed"], 0) == pytest.approx(0.8, abs=0.03)
    assert correlation(found["longitudinal"], found["heading"], 0) == pytest.approx(-0.6 * apart, abs=0.04)
    assert correlation(found["speed"], found["heading"], 0) == pytest.approx(-0.5 * apart, abs=0.04)
    start = np.array(
        [column(look(Sensor(model(errors=error)), ring(60), [0.0], standing, s), "x_ego") for s in range(20)]
    )
    assert (
        start - column(look(IdealPerception(), ring(60), [0.0], standing), "x_ego")
    ).std() == pytest.approx(0.05, rel=0.07)


def test_drifts_are_coupled_from_the_first_list_on() -> None:
    coupling = np.eye(6)
    coupling[0, 3] = coupling[3, 0] = 0.9
    error = {q: {"drift": {"constant": 0.05}} for q in ("longitudinal", "heading")} | {
        "coupling": coupling.tolist()
    }
    sensor, truth = Sensor(model(errors=error)), look(IdealPerception(), ring(60), [0.0], standing)[0]
    first = [look(sensor, ring(60), [0.0], standing, seed)[0] for seed in range(20)]
    ahead, turned = (
        np.array([getattr(p, c) - getattr(truth, c) for p in first]) for c in ("x_ego", "heading_ego")
    )
    assert correlation(ahead, turned, 0) == pytest.approx(0.9, abs=0.03)


def test_correlation_does_not_depend_on_the_time_steps() -> None:
    error = {"speed": {"drift": {"constant": 0.1}, "correlation_time": 0.5}}
    pattern = np.tile([0.02, 0.1], 3000).cumsum()
    e = errors_of(Sensor(model(errors=error)), times=pattern.tolist())["speed"]
    assert e.std() == pytest.approx(0.1, rel=0.03)
    assert correlation(e[::2], e[::2], 1) == pytest.approx(np.exp(-0.12 / 0.5), abs=0.02)
    short = np.mean(e[::2] * np.roll(e, -1, axis=0)[::2]) / np.mean(e * e)  # to the next, 0.1 s later
    assert short == pytest.approx(np.exp(-0.1 / 0.5), abs=0.02)


def test_a_spread_grows_with_its_features() -> None:
    error = {"lateral": {"noise": {"constant": 0.1, "range": 0.02, "bearing": 0.3}}}
    e = errors_of(Sensor(model(errors=error)), n=5)["lateral"]
    assert e.std(axis=0) == pytest.approx(0.1 * np.exp(0.6 + 0.3 * np.abs(np.linspace(-3, 3, 5))), rel=0.04)


def test_no_box_has_less_than_a_size() -> None:
    e = look(Sensor(model(errors={"width": {"noise": {"constant": 3.0}}})), ring(9), steps(2.0), standing)
    assert column(e, "width").min() == 0.1
