"""The model in the loop against what its parameters mean: worlds whose truth is known, long runs where chance rules."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from resim.perception.chain import detected_share, probabilities, rates
from resim.perception.model import FEATURES, MANEUVERS, QUANTITIES, PerceptionModel, read_model
from resim.perception.sensor import Sensor
from resim.perception.world import features
from resim.sim.adfunction import EgoState, Perceived
from resim.sim.loop import simulate
from resim.sim.perception import Ideal, Perception, World

MODELS = Path(__file__).parents[2] / "adfunc" / "perception"
STEP = 0.04
COLUMNS = ("x_ego", "y_ego", "heading_ego", "v", "length", "width")
"""Of `Perceived`, in the order of QUANTITIES but for heading and speed."""
PLACES = dict(zip(("longitudinal", "lateral", "heading", "speed", "length", "width"), COLUMNS, strict=True))

Motion = Callable[[float], tuple[Any, Any, Any]]


def model(**parts: Any) -> PerceptionModel:
    return PerceptionModel.model_validate({"schema": "resim-perception-1", "name": "test", **parts})


def steps(duration: float, dt: float = STEP) -> list[float]:
    return [round(k * dt, 9) for k in range(round(duration / dt) + 1)]


def world(t: float, position: Any, heading: Any, v: Any, ego: EgoState, ids: Sequence[str] = ()) -> World:
    place = np.atleast_1d(np.asarray(position, dtype=complex))
    n = len(place)
    names = np.array(list(ids) or [f"{k}" for k in range(n)], dtype=str)
    heading, v = (np.broadcast_to(np.asarray(c, dtype=float), n).copy() for c in (heading, v))
    return World(t, ego, names, np.full(n, "car"), place, heading, v, np.full(n, 4.7), np.full(n, 1.9))


def ego_at(t: float) -> EgoState:
    return EgoState(23.0 * t, 5.0, 0.02 * t, 23.0)


def standing(t: float) -> EgoState:
    return EgoState(0.0, 0.0, 0.0, 0.0)


def look(
    perception: Perception,
    motion: Motion,
    times: Sequence[float],
    ego: Callable[[float], EgoState] = ego_at,
    seed: int = 1,
) -> list[Perceived]:
    perception.reset(np.random.default_rng(seed))
    return [perception.perceive(world(t, *motion(t), ego(t))) for t in times]


def column(seen: list[Perceived], name: str) -> np.ndarray:
    return np.array([getattr(p, name) for p in seen])


def same(one: Perceived, two: Perceived) -> bool:
    return (
        one.t == two.t
        and one.ego == two.ego
        and all(np.array_equal(getattr(one, f.name), getattr(two, f.name)) for f in fields(Perceived)[2:])
    )


def ring(n: int, distance: float = 30.0) -> Motion:
    """Objects that stand around the EGO."""
    place = distance * np.exp(1j * np.linspace(-3.0, 3.0, n))
    return lambda t: (place, np.zeros(n), np.zeros(n))


# without parameters


def changing(t: float) -> World:
    """Objects that come, go and turn round."""
    ids = [
        name
        for name, first, last in (("a", 0, 9), ("b", 1, 3), ("c", 2, 9), ("b", 5, 9))
        if first <= t < last
    ]
    n = len(ids)
    k = np.arange(n) + 1.0
    return world(
        t, 20 * t * k + 1j * k, np.angle(np.exp(1j * (t * k + 1.0))), 20 + np.sin(k * t), ego_at(t), ids
    )


@pytest.mark.parametrize(
    "parts",
    [
        {},
        {"maneuvers": {m: {} for m in MANEUVERS}},
        {"validity": {"range": (0, 10)}, "errors": {"speed": {"drift": {"constant": 0.0, "range": 0.1}}}},
        {"field_of_view": {"range": 1e6}, "id_switch": 0.0, "update": {"jitter": 0.1}},
    ],
)  # fmt: skip
def test_without_errors_it_sees_what_is_to_the_bit(parts: dict[str, Any]) -> None:
    sensor, ideal = Sensor(model(**parts)), Ideal()
    for t in steps(8.0):
        assert same(sensor.perceive(changing(t)), ideal.perceive(changing(t)))


# latency and averaging


def ramp(t: float) -> tuple[Any, Any, Any]:
    return 30.0 + 20.0 * t + t * t + 3.5j + 1j * t, 0.3 * t + 2.9, 20.0 + 2.0 * t


@pytest.mark.parametrize(
    "times", [steps(8.0), np.cumsum(np.random.default_rng(3).uniform(0.01, 0.07, 200)).tolist()]
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


# features and maneuvers


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


# errors by chance


def errors_of(
    sensor: Sensor, n: int = 30, duration: float = 200.0, times: list[float] | None = None
) -> dict[str, Any]:
    """Errors (T, n) of objects that stand around the EGO, by quantity."""
    times = times or steps(duration)
    seen, truth = (look(p, ring(n), times, standing) for p in (sensor, Ideal()))
    return {q: column(seen, c) - column(truth, c) for q, c in PLACES.items()}


def correlation(x: np.ndarray, y: np.ndarray, lag: int) -> float:
    return float(np.mean(x[: len(x) - lag] * y[lag:]) / np.sqrt(np.mean(x * x) * np.mean(y * y)))


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
    assert (start - column(look(Ideal(), ring(60), [0.0], standing), "x_ego")).std() == pytest.approx(
        0.05, rel=0.07
    )


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


# detection


def detected(sensor: Sensor, n: int, times: list[float], motion: Motion | None = None) -> np.ndarray:
    seen = look(sensor, motion or ring(n), times, standing)
    return np.array([np.isin([f"{k}" for k in range(n)], p.ids) for p in seen])


def lengths(table: np.ndarray, value: bool) -> np.ndarray:
    """Lengths of the complete runs of a value."""
    out: list[int] = []
    for row in table.T:
        ends = np.flatnonzero(np.diff(row.astype(int)))
        runs = np.diff(ends)
        out.extend(runs[row[ends[:-1] + 1] == value].tolist())
    return np.array(out)


@pytest.mark.parametrize("dt", [0.04, 0.2])
def test_share_and_run_lengths_of_detection(dt: float) -> None:
    parts = {"range_edges": (0, 100), "bearing_edges": (0, 4), "occlusion_edges": (0, 1)}
    chain = {**parts, "loss": (((0.5,),),), "gain": (((4.0,),),)}
    table = detected(Sensor(model(detection=chain)), 50, steps(4000 * dt, dt))
    lost, gained = probabilities(0.5, 4.0, dt)
    assert table.mean() == pytest.approx(4.0 / 4.5, abs=0.01)
    assert table[0].mean() == pytest.approx(4.0 / 4.5, abs=0.12)
    assert lengths(table, False).mean() == pytest.approx(1 / gained, rel=0.05)
    assert lengths(table, True).mean() == pytest.approx(1 / lost, rel=0.05)


def test_chains_and_rates_are_inverse_and_hold_for_any_step() -> None:
    loss, gain = np.array([0.5, 0.0, 3.0]), np.array([4.0, 2.0, 0.0])
    assert rates(*probabilities(loss, gain, 0.2), 0.2) == (pytest.approx(loss), pytest.approx(gain))
    assert detected_share(loss, gain).tolist() == [4.0 / 4.5, 1.0, 0.0]
    assert detected_share(0.0, 0.0) == 1.0
    lost, gained = probabilities(loss, gain, 0.1)
    twice = lost * (1 - gained) + (1 - lost) * lost
    assert twice == pytest.approx(probabilities(loss, gain, 0.2)[0])


def test_bins_of_range_and_bearing_reach_beyond_their_edges() -> None:
    never, always = 1e3, 0.0
    chain = {
        "range_edges": (10, 20, 30), "bearing_edges": (0, 1, 2), "occlusion_edges": (0, 1),
        "loss": (((always,), (always,)), ((never,), (always,))), "gain": (((1.0,),) * 2, ((0.0,), (1.0,))),
    }  # fmt: skip
    place = np.array([5.0, 15.0, 25.0, 90.0, -25.0, 25.0j])
    table = detected(Sensor(model(detection=chain)), 6, steps(2.0), lambda t: (place, 0.0, 0.0))
    assert table[10:].all(axis=0).tolist() == [True, True, False, False, True, True]
    assert table[10:].any(axis=0).tolist() == [True, True, False, False, True, True]


def test_who_is_hidden_is_lost() -> None:
    chain = {
        "range_edges": (0, 1), "bearing_edges": (0, 1), "occlusion_edges": (0, 0.5, 1),
        "loss": (((0.0, 100.0),),), "gain": (((5.0, 0.0),),),
    }  # fmt: skip

    def motion(t: float) -> tuple[Any, Any, Any]:
        return np.array([20.0, 50.0 + 1j * 10.0 * max(t - 3.0, 0.0)]), 0.0, 0.0

    table = detected(Sensor(model(detection=chain)), 2, steps(6.0), motion)
    assert table[:, 0].all()
    assert not table[20:75, 1].any()
    assert table[-10:, 1].all()


def test_field_of_view() -> None:
    sensor = Sensor(read_model(MODELS / "field_of_view.json"))
    place = np.array([119.0, 121.0, -10.0, 10 * np.exp(1j * 1.04), 10 * np.exp(-1j * 1.05)])
    assert look(sensor, lambda t: (place, 0.0, 0.0), [0.0], standing)[0].ids.tolist() == ["0", "3"]


# ids, false objects, lists


def test_ids_switch_at_their_rate_and_stay_unique() -> None:
    seen = look(Sensor(model(id_switch=0.1)), ring(20), steps(200.0), standing)
    switches = sum(int(name.partition("#")[2] or 1) - 1 for name in seen[-1].ids.tolist())
    assert switches == pytest.approx(0.1 * 20 * 200.0, abs=60)
    names = {str(name) for p in seen for name in p.ids}
    assert len(names) == switches + 20
    assert {"0", "0#2", "0#3"} < names


def test_false_objects_come_and_go_at_their_rate() -> None:
    false = {"rate": 0.8, "lifetime": 0.5, "range": 60.0, "bearing": 0.4, "speed": 20.0, "speed_spread": 2.0}
    seen = look(
        Sensor(model(false_objects=false)),
        ring(2),
        steps(600.0, 0.05),
        lambda t: EgoState(20.0 * t, 0, 0, 20.0),
    )
    lists = [[str(name) for name in p.ids[2:]] for p in seen]
    first = {name: p for p, names in reversed(list(zip(seen, lists, strict=True))) for name in names}
    assert np.mean([len(names) for names in lists]) == pytest.approx(0.8 * 0.5, abs=0.06)
    # who comes and goes between two lists is never seen: exp(-dt / lifetime) on average over the step
    assert len(first) == pytest.approx(480 * 0.95, abs=60)
    births = [(p.x_ego[k], p.y_ego[k], p.v[k]) for n, p in first.items() for k in np.flatnonzero(p.ids == n)]
    x, y, v = np.array(births).T
    assert np.hypot(x, y).max() < 60.0
    assert np.hypot(x, y).mean() == pytest.approx(30.0, abs=2.5)
    assert 0.38 < np.abs(np.arctan2(y, x)).max() <= 0.4
    assert (v.mean(), v.std()) == (pytest.approx(20.0, abs=0.3), pytest.approx(2.0, abs=0.25))


def test_a_false_object_drives_on() -> None:
    false = {"rate": 1e-3, "lifetime": 1e4, "speed": 10.0}
    seen = look(Sensor(model(false_objects=false)), ring(1), steps(5.0), standing)
    x = np.array([p.x_ego[p.ids == "false1"][0] for p in seen])
    assert np.diff(x) == pytest.approx(0.4)
    assert (seen[0].length[-1], seen[0].width[-1], seen[0].heading_ego[-1]) == (4.7, 1.9, 0.0)


def test_between_two_lists_the_last_one_stands() -> None:
    seen = look(Sensor(model(update={"period": 0.2})), lambda t: (30 + 20 * t, 0.1, 20 + t), steps(2.0))
    for k, p in enumerate(seen):
        at = seen[k - k % 5].t
        assert p.t == pytest.approx(STEP * k)
        assert p.v[0] == pytest.approx(20 + at)
        assert p.map_positions()[0][0] == pytest.approx(30 + 20 * at)
        assert p.heading_ego[0] == pytest.approx(0.1 - p.ego.heading)


@pytest.mark.parametrize("period", [0.1, 0.25])
def test_lists_come_after_their_period_with_jitter(period: float) -> None:
    sensor = Sensor(model(update={"period": period, "jitter": 0.03}))
    seen = look(sensor, lambda t: (30.0, 0.0, t), steps(100.0, 0.004), standing)
    gaps = np.diff(np.unique(column(seen, "v")))
    assert gaps.mean() == pytest.approx(period, abs=0.003)
    assert gaps.std() == pytest.approx(0.03, rel=0.1)


def test_the_mean_period_holds_where_it_is_no_multiple_of_the_cycle() -> None:
    seen = look(Sensor(model(update={"period": 0.1})), lambda t: (30.0, 0.0, t), steps(20.0), standing)
    assert np.diff(np.unique(column(seen, "v"))).mean() == pytest.approx(0.1, rel=0.01)


def test_localisation() -> None:
    own = {"bias": 0.1, "drift": 0.2, "correlation_time": 0.5, "noise": 0.05}
    parts = {
        "longitudinal": own,
        "lateral": {"bias": -0.3},
        "heading": {"noise": 0.01},
        "speed": {"bias": 0.5},
    }
    turned = EgoState(0.0, 0.0, np.pi / 2, 10.0, 1.5, 0.2)
    seen = look(Sensor(model(ego=parts)), ring(1), steps(800.0), lambda t: turned)
    x, y, heading, v = np.array([(p.ego.x, p.ego.y, p.ego.heading, p.ego.v) for p in seen]).T
    e = y - 0.1
    assert (e.mean(), e.std()) == (pytest.approx(0.0, abs=0.03), pytest.approx(np.hypot(0.2, 0.05), rel=0.05))
    assert correlation(e[:, None], e[:, None], 12) == pytest.approx(
        0.04 / 0.0425 * np.exp(-0.48 / 0.5), abs=0.05
    )
    assert x == pytest.approx(0.3)
    assert (heading - np.pi / 2).std() == pytest.approx(0.01, rel=0.05)
    assert v == pytest.approx(10.5)
    assert (seen[0].ego.a, seen[0].ego.yaw_rate) == (1.5, 0.2)
    assert np.ptp(column(seen, "x_ego")) == 0.0  # objects are where they are from the true EGO


def test_localisation_with_uneven_steps() -> None:
    times = np.tile([0.02, 0.02, 0.1], 6000).cumsum().tolist()
    own = {"drift": 0.2, "correlation_time": 0.5}
    x = np.array([p.ego.x for p in look(Sensor(model(ego={"longitudinal": own})), ring(0), times, standing)])[
        :, None
    ]
    assert x.std() == pytest.approx(0.2, rel=0.05)
    assert correlation(x[2::3], x[2::3], 1) == pytest.approx(np.exp(-0.14 / 0.5), abs=0.04)


# the whole


def everything() -> PerceptionModel:
    spread = {"constant": 0.1, "range": 0.005}
    error: dict[str, Any] = {
        q: {"bias": {"constant": 0.1}, "drift": spread, "noise": spread} for q in QUANTITIES
    }
    own = {"bias": 0.1, "drift": 0.05, "noise": 0.05}
    return model(
        latency={"position": 0.1, "speed": 0.5, "heading": 0.5},
        averaging={"speed": 1.0, "heading": 0.4},
        errors=error,
        maneuvers={"braking": {"errors": error, "latency": {"position": 0.12}}},
        detection={
            "range_edges": (0, 50, 200), "bearing_edges": (0, 1, 4), "occlusion_edges": (0, 0.5, 1),
            "loss": (((0.1, 0.5),) * 2, ((0.4, 1.0),) * 2), "gain": (((5.0, 2.0),) * 2, ((3.0, 1.0),) * 2),
        },
        field_of_view={"range": 150.0},
        update={"period": 0.08, "jitter": 0.01},
        id_switch=0.05,
        false_objects={"rate": 0.3},
        ego={"longitudinal": own, "heading": {"noise": 1e-3}},
        validity={"range": (0.0, 100.0), "relative_speed": (-15.0, 15.0)},
    )  # fmt: skip


def traffic(n: int) -> Motion:
    k = np.arange(n)

    def motion(t: float) -> tuple[Any, Any, Any]:
        v = 22.0 + k + np.sin(t + k)
        return 20.0 * k - 40.0 + (22.0 + k) * t - np.cos(t + k) + 3.5j * (k % 3), 0.02 * np.sin(t + k), v

    return motion


def as_bytes(seen: list[Perceived]) -> list[bytes]:
    return [b"".join(np.asarray(getattr(p, f.name)).tobytes() for f in fields(Perceived)[2:]) for p in seen]


def test_the_same_seed_gives_the_same_bytes() -> None:
    sensor = Sensor(everything())
    one, two, other = (as_bytes(look(sensor, traffic(6), steps(8.0), seed=s)) for s in (4, 4, 5))
    assert one == two == as_bytes(look(Sensor(everything()), traffic(6), steps(8.0), seed=4))
    assert one != other


def test_one_more_object_changes_nothing_of_the_others() -> None:
    parts = everything().model_dump(by_alias=True) | {"detection": {}}  # occlusion does link them
    few, many = (
        look(Sensor(PerceptionModel.model_validate(parts)), traffic(n), steps(8.0), seed=4) for n in (4, 6)
    )
    extra = ("4", "5")
    for one, two in zip(few, many, strict=True):
        kept = [k for k, name in enumerate(two.ids.tolist()) if name.partition("#")[0] not in extra]
        assert one.ids.tolist() == two.ids[kept].tolist()
        for name in COLUMNS:
            np.testing.assert_allclose(getattr(one, name), getattr(two, name)[kept], rtol=1e-12, atol=1e-12)


def test_coming_and_going_of_others_changes_nothing() -> None:
    error = {"speed": {"drift": {"constant": 0.1}}}
    one, two = Sensor(model(errors=error)), Sensor(model(errors=error))
    for t in steps(8.0):
        busy = changing(t)
        alone = world(t, busy.position[0], busy.heading[0], busy.v[0], busy.ego, ["a"])
        assert one.perceive(busy).v[0] == pytest.approx(two.perceive(alone).v[0], abs=1e-12)


def test_an_empty_road() -> None:
    sensor = Sensor(everything())
    nothing = np.zeros(0)
    for t in steps(4.0):
        empty = World(t, ego_at(t), nothing.astype(str), nothing.astype(str), nothing + 0j, *[nothing] * 4)
        assert all(str(name).startswith("false") for name in sensor.perceive(empty).ids)
    assert len(sensor.perceive(world(5.0, *traffic(2)(5.0), ego_at(5.0))).v) <= 3


def test_samples_outside_of_the_models_range_are_counted() -> None:
    place = np.array([10.0, 50.0, 120.0])

    def count(**validity: tuple[float, float]) -> tuple[int, int]:
        sensor = Sensor(model(validity=validity, field_of_view={"range": 100.0}))
        look(sensor, lambda t: (place, 0.0, 10.0), steps(7.96), standing)
        return sensor.outside, sensor.perceived

    assert count() == (0, 400)
    assert count(range=(20.0, 200.0)) == (200, 400)
    assert count(relative_speed=(-5.0, 5.0)) == (400, 400)
    assert count(ego_speed=(1.0, 30.0)) == (400, 400)


def test_in_the_loop(described: Any, network: Any, net: Any, build: Any) -> None:
    def drive(perception: Perception | None, seed: int = 0) -> Any:
        return simulate(
            described("cut_in_brake"),
            network,
            net.path,
            build("highway_pilot"),
            perception=perception,
            seed=seed,
        )

    ideal, none = drive(None), drive(Sensor(read_model(MODELS / "none.json")))
    assert ideal.truth.x.tobytes() == none.truth.x.tobytes()
    late = drive(Sensor(read_model(MODELS / "latency.json", ("latency.speed=0.8", "latency.heading=0.8"))))
    assert first_braking(ideal) < first_braking(late) < first_braking(ideal) + 1.5
    assert late.perceived[0].v[0] == pytest.approx(ideal.truth.v[1, 0], abs=0.3)  # filled before t = 0
    sensor = Sensor(everything())
    one, two = drive(sensor, 3), drive(sensor, 3)
    assert as_bytes(list(one.perceived)) == as_bytes(list(two.perceived))
    assert one.failure == ""
    assert 0 <= sensor.outside < sensor.perceived


def first_braking(run: Any) -> float:
    return float(run.truth.t[np.argmax(run.truth.a[0] < -0.5)])
