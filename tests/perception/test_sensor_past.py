"""Latencies, averages, features and maneuvers of a perception model against the truth of known worlds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from perception.worlds import PLACES, column, look, model, ramp, standing, steps, world

from resim.perception.model import FEATURES, QUANTITIES
from resim.perception.runtime.sensor import Sensor
from resim.perception.runtime.world import features
from resim.scenario.maneuvers import MANEUVERS


@pytest.mark.parametrize(
    "times",
    [
        steps(8.0),
        np.cumsum(np.random.default_rng(3).uniform(0.01, 0.07, 200)).tolist(),
        [t for t in steps(4.0) if not 1.5 < t < 1.55] + [4.0 + t for t in steps(4.0, 0.05)[1:]],
    ],
)
def test_latencies_of_position_speed_and_heading(times: list[float]) -> None:
    late = {"position": 0.13, "speed": 0.37, "heading": 0.8}
    seen = look(Sensor(model(latency=late)), ramp, times)
    late_enough = [k for k, t in enumerate(times) if t - times[0] > 1.0]
    assert len(late_enough) > 100
    for k in late_enough:
        t, p = times[k], seen[k]
        x, y = p.map_positions()
        assert complex(x[0], y[0]) == pytest.approx(ramp(t - 0.13)[0], abs=2e-3)  # where it was in the map
        assert p.v[0] == pytest.approx(ramp(t - 0.37)[2])
        assert np.exp(1j * (p.heading_ego[0] + p.ego.heading)) == pytest.approx(np.exp(1j * ramp(t - 0.8)[1]))
        assert abs(p.heading_ego[0]) <= np.pi


def test_before_its_first_sample_an_object_drove_on_as_it_does() -> None:
    seen = look(Sensor(model(latency={"position": 0.5, "speed": 0.5})), ramp, steps(0.4, 0.1), standing)
    where, heading, v = ramp(0.0)
    for k, p in enumerate(seen):
        there = where + (0.1 * k - 0.5) * v * np.exp(1j * heading)
        assert complex(p.x_ego[0], p.y_ego[0]) == pytest.approx(there)
        assert p.v[0] == pytest.approx(v)


def test_what_comes_later_has_a_past_too() -> None:
    sensor = Sensor(model(latency={"position": 0.5}))
    for t in steps(2.0):
        two = t > 1.0
        seen = sensor.perceive(
            world(
                t,
                [20 * t, 50 + 10 * t][: 1 + two],
                0.0,
                [20.0, 10.0][: 1 + two],
                standing(t),
                ["a", "b"][: 1 + two],
            )
        )
        assert seen.x_ego == pytest.approx([20 * (t - 0.5), 50 + 10 * (t - 0.5)][: 1 + two])


def test_averages_are_centred_at_the_latency() -> None:
    w = 2.0

    def wave(t: float) -> tuple[Any, Any, Any]:
        return 50.0, np.angle(np.exp(1j * (3.1 + 0.5 * np.sin(w * t)))), 20.0 + np.sin(w * t)

    parts = {"latency": {"speed": 0.8, "heading": 0.5}, "averaging": {"speed": 1.6, "heading": 0.3}}
    times = steps(6.0, 0.01)
    seen = look(Sensor(model(**parts)), wave, times, standing)
    t = np.array(times)
    speed = 20.0 + np.sin(w * (t - 0.8)) * np.sin(w * 0.8) / (w * 0.8)
    turn = 3.1 + 0.5 * np.sin(w * (t - 0.5)) * np.sin(w * 0.15) / (w * 0.15)
    ready = t > 1.7
    assert column(seen, "v")[ready, 0] == pytest.approx(speed[ready], abs=1e-4)
    off = column(seen, "heading_ego")[ready, 0] - turn[ready]
    assert np.abs(np.angle(np.exp(1j * off))).max() < 1e-4


@pytest.mark.parametrize("feature", FEATURES)
@pytest.mark.parametrize("quantity", QUANTITIES)
def test_a_bias_follows_the_features_of_the_late_object(feature: str, quantity: str) -> None:
    late = {"position": 0.2, "speed": 0.4, "heading": 0.4}
    parts = {"errors": {quantity: {"bias": {"constant": 0.05, feature: 0.01}}}, "latency": late}
    one, two = (look(Sensor(m), ramp, steps(3.0)) for m in (model(**parts), model(latency=late)))
    error = getattr(one[-1], PLACES[quantity]) - getattr(two[-1], PLACES[quantity])
    p = two[-1]
    a = 2.0
    values = dict(
        zip(FEATURES, features(p.ego, p.x_ego, p.y_ego, p.heading_ego, p.v, a)[0].tolist(), strict=True)
    )
    assert error[0] == pytest.approx(0.05 + 0.01 * values[feature], abs=1e-9)


def test_each_maneuver_has_its_own_parameters() -> None:
    own = {m: {"errors": {"lateral": {"bias": {"constant": k + 1.0}}}} for k, m in enumerate(MANEUVERS[:3])}
    own["lane_change_left"]["latency"] = {"position": 0.2}
    sensor = Sensor(model(maneuvers=own, errors={"lateral": {"bias": {"constant": 9.0}}}))

    def motion(t: float) -> tuple[Any, Any, Any]:
        braking = 30.0 - 2.0 * t
        heading = np.array([0.0, 0.05, -0.05, 0.0])
        return 20.0 * t + 10.0 * np.arange(4), heading, np.array([20.0, 20.0, 20.0, braking])

    p = look(sensor, motion, steps(2.0), standing)[-1]
    assert p.y_ego == pytest.approx([1.0, 2.0, 3.0, 9.0])  # nothing is known of braking
    assert p.x_ego == pytest.approx([40.0, 50.0 - 4.0, 60.0, 70.0])


def test_a_maneuver_is_perceived_as_late_as_the_speed_is() -> None:
    own = {"braking": {"latency": {"speed": 0.5}, "errors": {"length": {"bias": {"constant": 1.0}}}}}
    sensor = Sensor(model(latency={"speed": 0.5}, maneuvers=own))
    seen = look(sensor, lambda t: (30.0, 0.0, 30.0 - 3.0 * max(t - 1.0, 0.0)), steps(2.0), standing)
    assert seen[int(np.argmax(column(seen, "length")[:, 0] > 5.0))].t == pytest.approx(1.54, abs=0.021)
