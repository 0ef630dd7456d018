from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

from resim.core.errors import ResimError
from resim.core.tracks import Tracks
from resim.recordings import Recording, read_commonroad
from resim.road.opendrive import RoadNetwork
from resim.scenario.fit import fit_trace
from resim.scenario.scenario import Scenario, describe

NGSIM = Path(__file__).parents[2].parent / "shared" / "data" / "ngsim"


def straight(ids: str = "ab", *, start: float = 0.0, gone: tuple[int, ...] = ()) -> Tracks:
    """Cars on lane -2 of the proving ground's road 1 at 20 m/s, 30 m apart, 4 s at 25 Hz."""
    t, n = start + np.arange(101) / 25.0, len(ids)
    x = 300.0 + 20.0 * (t - start) + 30.0 * np.arange(n)[:, None]
    valid = np.ones(x.shape, dtype=bool)
    valid[list(gone), 1:] = False

    def there(value: object) -> np.ndarray:
        return np.where(valid, value, np.nan)

    return Tracks(
        t=t, ids=np.array(list(ids)), kind=np.array(["car"] * n), x=there(x), y=there(np.full(x.shape, -5.25)),
        heading=there(np.zeros(x.shape)), v=there(np.full(x.shape, 20.0)), length=np.full(n, 4.5),
        width=np.full(n, 1.8), valid=valid,
    )  # fmt: skip


@pytest.mark.parametrize("name", ["cut_in_brake", "rear_end", "overtake"])
def test_shipped_drives_are_fitted_within_the_sources_error(
    shipped: Callable[[str], Recording], described: Callable[..., Scenario], network: RoadNetwork, name: str
) -> None:
    gt = shipped(name).gt
    fitted = described(name).tracks(network, gt.t).select(gt.ids.tolist())
    error = np.hypot(fitted.x - gt.x, fitted.y - gt.y)
    assert np.nanmean(error, axis=1).max() <= 0.025
    np.testing.assert_array_equal(fitted.valid, gt.valid)


def test_the_fit_of_sensor_data_is_off_by_the_noise_that_was_put_in(
    shipped: Callable[[str], Recording], described: Callable[..., Scenario], network: RoadNetwork
) -> None:
    sd = shipped("cut_in_brake").sd_by_gt()
    assert sd is not None
    fitted = described("cut_in_brake", "SD").tracks(network, sd.t).select(sd.ids.tolist())
    error = np.nanmean(np.hypot(fitted.x - sd.x, fitted.y - sd.y), axis=1)
    ego, to = error[sd.index("ego")], error[sd.index("1")]
    assert 0.05 < ego < 0.08  # 5 cm a component: mean length 6.3 cm
    assert 0.03 < to < 0.15  # 3 cm a component in the EGO's noisy frame, and drift of metres smoothed


def test_a_scenario_starts_where_its_positions_on_the_road_say(network: RoadNetwork) -> None:
    s = describe(
        straight(), network, ego="a", map_name="proving_ground.xodr", description="d", environment={"a": "b"}
    )
    assert (s.map, s.description, s.environment) == ("proving_ground.xodr", "d", {"a": "b"})
    assert (s.ego.id, [o.id for o in s.objects]) == ("a", ["b"])
    assert (s.ego.start.road, s.ego.start.lane) == ("1", -2)
    assert s.ego.start.s == pytest.approx(300.0, abs=0.01)
    assert s.ego.start.t == pytest.approx(0.0, abs=0.01)
    assert (s.ego.length, s.ego.width, s.ego.kind) == (4.5, 1.8, "car")
    assert s.duration == 4.0
    x = s.tracks(network, [0.0, 4.0]).x
    np.testing.assert_allclose(x, [[300.0, 380.0], [330.0, 410.0]], atol=1e-3)


def test_the_ego_comes_first_wherever_it_stands_in_the_tracks(network: RoadNetwork) -> None:
    s = describe(straight("abc"), network, ego="c", map_name="m.xodr")
    assert s.tracks(network, [0.0]).ids.tolist() == ["c", "a", "b"]


def test_objects_seen_once_are_left_out(network: RoadNetwork) -> None:
    assert [o.id for o in describe(straight("abc", gone=(1,)), network, ego="a", map_name="m").objects] == [
        "c"
    ]


def test_an_ego_that_comes_late_or_has_one_sample_is_refused(network: RoadNetwork) -> None:
    with pytest.raises(ResimError, match="EGO 'a' is not there at the first time"):
        describe(straight("ab", gone=(0,)), network, ego="a", map_name="m")
    late = straight()
    valid = late.valid.copy()
    valid[0, 0] = False
    with pytest.raises(ResimError, match="cut the recording"):
        describe(replace(late, valid=valid), network, ego="a", map_name="m")
    with pytest.raises(ResimError, match="no object 'z'"):
        describe(straight(), network, ego="z", map_name="m")


def test_times_need_not_begin_at_zero(network: RoadNetwork) -> None:
    s = describe(straight(start=100.0), network, ego="a", map_name="m")
    assert (s.ego.spawn_time, s.duration) == (100.0, 4.0)
    np.testing.assert_allclose(s.tracks(network, [100.0, 104.0]).x[0], [300.0, 380.0], atol=1e-3)
    assert not s.tracks(network, [99.9, 104.1]).valid.any()


def test_tracks_of_a_scenario_are_its_splines(
    described: Callable[..., Scenario], network: RoadNetwork
) -> None:
    s, t = described("cut_in_brake"), np.linspace(0.0, 9.0, 10)
    tracks = s.tracks(network, t)
    np.testing.assert_array_equal(tracks.v[0], s.ego.v(t))
    np.testing.assert_array_equal(tracks.a[0], s.ego.v(t, 1))
    np.testing.assert_array_equal(tracks.yaw_rate[1], s.objects[0].heading(t, 1))


@pytest.mark.parametrize("name", ["USA_US101-22_1_T-1", "USA_US101-5_1_T-1"])
def test_real_vehicles_are_fitted_within_a_centimetre(name: str) -> None:
    path = NGSIM / f"{name}.xml"
    if not path.is_file():
        pytest.skip("the shared data are not on this machine")
    ego = next(str(e.get("id")) for e in etree.parse(path).iter("dynamicObstacle", "obstacle"))
    gt = read_commonroad(path, map=path.with_suffix(".xodr"), ego=ego).gt
    seen = [n for n in range(len(gt)) if gt.valid[n].sum() >= 2]
    errors = []
    for n in seen:
        columns = (c[n, gt.valid[n]] for c in (gt.x, gt.y, gt.heading, gt.v))
        errors.append(fit_trace(gt.t[gt.valid[n]], *columns).distance.mean())
    assert len(errors) >= 10
    assert np.median(errors) < 0.01
    assert max(errors) < 0.05


def test_who_kept_to_its_trace_in_simulation_is_described_by_it(network: RoadNetwork) -> None:
    told = describe(straight("abc"), network, ego="a", map_name="m.xodr")
    run = told.tracks(
        network, 0.01 + np.arange(100) / 25.0
    )  # steps, which the trace outlasts by less than one
    x = run.x.copy()
    x[1] += 1e-3 * np.arange(100)  # b did not keep to it
    found = describe(replace(run, x=x), network, ego="a", map_name="m.xodr", driven=told)
    assert found.ego is told.ego
    assert [o is p for o, p in zip(found.objects, told.objects, strict=True)] == [False, True]
    assert found.duration == pytest.approx(3.96)
    short = run.window(0.0, 2.0)  # as after a collision
    assert describe(short, network, ego="a", map_name="m.xodr", driven=told).ego is not told.ego


def test_who_is_not_there_in_simulation_is_not_described(network: RoadNetwork) -> None:
    told = describe(straight("abc"), network, ego="a", map_name="m.xodr")
    run = told.tracks(network, np.arange(100) / 25.0)
    valid = run.valid.copy()
    valid[1] = False
    found = describe(replace(run, valid=valid), network, ego="a", map_name="m.xodr", driven=told)
    assert [o.id for o in found.objects] == ["c"]
