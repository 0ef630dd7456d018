"""Ids, false objects, the times of lists, and what the EGO knows of itself."""

from __future__ import annotations

import numpy as np
import pytest
from perception.worlds import STEP, column, correlation, look, model, ring, standing, steps

from resim.perception.parts.false_objects import Clutter, FalseObjects
from resim.perception.parts.id_switch import IdSwitches
from resim.perception.runtime.sensor import Sensor
from resim.perception.runtime.streams import PartStreams, Streams
from resim.simulation.function.interface import EgoState, Perceived
from resim.simulation.perception import World


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


def test_nobody_is_seen_for_the_sake_of_a_false_object_of_his_name() -> None:
    """Objects called as false ones are: they are never detected, and their ids are never on a list."""
    false, ids = {"rate": 5.0, "lifetime": 1.0}, [f"false{n}" for n in range(1, 40)]
    part = Clutter(FalseObjects(**false), np.random.default_rng(0))
    plain, named = (
        World(t, EgoState(0.0, 0.0, 0.0, 0.0), np.array(names), np.full(len(names), "car"),
              *(np.zeros(len(names), dtype=kind) for kind in (complex, float, float, float, float)))
        for t, names in ((0.0, ["a"]), (0.1, ids))
    )  # fmt: skip
    nobody = np.zeros(0)
    for world in (plain, named):
        empty = Perceived(world.t, world.ego, *(np.zeros(0, dtype=str),) * 2, *(nobody,) * 7)
        seen = part.change(empty, world, 0.1)
        assert len(seen.ids) > 0
        assert not {*seen.ids.tolist()} & {*world.ids.tolist()}


def test_switched_ids_are_nobody_elses() -> None:
    names = np.array(["a", "a#2", "a#3"])
    ego, zeros = EgoState(0.0, 0.0, 0.0, 0.0), np.zeros(3)
    part = IdSwitches(5.0, PartStreams(Streams(np.random.default_rng(1)), "id_switch"))
    switched = set()
    for k in range(200):
        world = World(0.1 * k, ego, names, np.full(3, "car"), zeros.astype(complex), *(zeros,) * 4)
        ids = part.change(Perceived(world.t, ego, names, world.kind, *(zeros,) * 7), world, 0.1).ids.tolist()
        assert len({*ids}) == 3
        assert not (set(ids) - {"a", "a#2", "a#3"}) & {*names.tolist()}
        assert all(name == own or name not in names for name, own in zip(ids, names.tolist(), strict=True))
        switched |= {*ids}
    assert len(switched) > 20


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
@pytest.mark.slow
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


@pytest.mark.slow
def test_localisation_with_uneven_steps() -> None:
    times = np.tile([0.02, 0.02, 0.1], 6000).cumsum().tolist()
    own = {"drift": 0.2, "correlation_time": 0.5}
    x = np.array([p.ego.x for p in look(Sensor(model(ego={"longitudinal": own})), ring(0), times, standing)])[
        :, None
    ]
    assert x.std() == pytest.approx(0.2, rel=0.05)
    assert correlation(x[2::3], x[2::3], 1) == pytest.approx(np.exp(-0.14 / 0.5), abs=0.04)
