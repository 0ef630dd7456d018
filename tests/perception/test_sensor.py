"""The model in the loop: the whole of it, and a model of nothing."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from perception.worlds import (
    COLUMNS,
    MODELS,
    as_bytes,
    changing,
    ego_at,
    everything,
    look,
    model,
    same,
    standing,
    steps,
    traffic,
    world,
)

from resim.perception.model import PerceptionModel, read_model
from resim.perception.runtime.sensor import Sensor
from resim.scenario.maneuvers import MANEUVERS
from resim.simulation.case import Case
from resim.simulation.perception import IdealPerception, Perception, World, worlds_of
from resim.simulation.sumo.engine import Sumo


@pytest.mark.parametrize(
    "parts",
    [
        {},
        {"maneuvers": {m: {} for m in MANEUVERS}},
        {"validity": {"range": (0, 10)}, "errors": {"speed": {"drift": {"constant": 0.0, "range": 0.1}}}},
        {"field_of_view": {"range": 1e6}, "id_switch": 0.0},
    ],
)  # fmt: skip
def test_without_errors_it_sees_what_is_to_the_bit(parts: dict[str, Any]) -> None:
    sensor, ideal = Sensor(model(**parts)), IdealPerception().together((), [np.random.default_rng(0)])
    assert ideal is not None
    for t in steps(8.0):
        assert same(sensor.perceive(changing(t)), ideal.perceive(worlds_of(changing(t))).of(0))


def test_the_same_seed_gives_the_same_bytes() -> None:
    sensor = Sensor(everything())
    one, two, other = (as_bytes(look(sensor, traffic(6), steps(8.0), seed=s)) for s in (4, 4, 5))
    assert one == two == as_bytes(look(Sensor(everything()), traffic(6), steps(8.0), seed=4))
    assert one != other


def test_what_was_perceived_stays_as_it_was() -> None:
    sensor = Sensor(everything())
    seen = [sensor.perceive(world(t, *traffic(6)(t), ego_at(t))) for t in steps(0.4)]
    before = as_bytes(seen)
    look(sensor, traffic(6), steps(4.0))
    assert as_bytes(seen) == before


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
        return sensor.outside, sensor.shown

    assert count() == (0, 400)
    assert count(range=(20.0, 200.0)) == (200, 400)
    assert count(relative_speed=(-5.0, 5.0)) == (400, 400)
    assert count(ego_speed=(1.0, 30.0)) == (400, 400)


def test_in_the_loop(described: Any, network: Any, net: Any, build: Any) -> None:
    def drive(perception: Perception | None, seed: int = 0) -> Any:
        shown = perception or IdealPerception()
        return Case(
            described("cut_in_brake"), network, build("highway_pilot"), Sumo(), shown, seed=seed
        ).drive()

    ideal, none = drive(None), drive(Sensor(read_model(MODELS / "none.json")))
    assert ideal.truth.x.tobytes() == none.truth.x.tobytes()
    late = drive(Sensor(read_model(MODELS / "latency.json", ("latency.speed=0.8", "latency.heading=0.8"))))
    assert first_braking(ideal) < first_braking(late) < first_braking(ideal) + 1.5
    assert late.perceived[0].v[0] == pytest.approx(ideal.truth.v[1, 0], abs=0.3)  # filled before t = 0
    sensor = Sensor(everything())
    one, two = drive(sensor, 3), drive(sensor, 3)
    assert as_bytes(list(one.perceived)) == as_bytes(list(two.perceived))
    assert one.failure == ""
    assert 0 <= one.outside < one.shown


def first_braking(run: Any) -> float:
    return float(run.truth.t[np.argmax(run.truth.a[0] < -0.5)])
