"""Somebody else's planner, in an environment of its own: what it is told of the road, and that it drives."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from conftest import DATA, ROOT

import resim
from adfunc.reactive_planner.road import reference_lanes, reference_path, road_edge
from resim.function import EgoState, LaneMap, RunSetup
from resim.road.driven_route import NO_ROUTE
from resim.road.opendrive import RoadNetwork, load
from resim.simulation.function import messages
from resim.simulation.function.interface import Perceived, Setup, load_build

BUILD = ROOT / "adfunc" / "builds" / "reactive_planner-2025.1.toml"
ENVIRONMENT = ROOT / ".venv-reactive-planner"
there = pytest.mark.skipif(
    not (ENVIRONMENT / "ready").exists(), reason="no environment of it: `make reactive_planner` makes it"
)
MAP = ROOT / "networks" / "proving_ground.xodr"
START = EgoState(300.0, -5.25, 0.0, 20.0)


def told(network: RoadNetwork, start: EgoState, route: Sequence[Sequence[str]] = ()) -> RunSetup:
    road = LaneMap({"file": str(network.path), "lanes": messages._lanes(network)})
    return RunSetup(road, start, (0.0, 0.0), 4.7, 1.9, 0.2, 0, tuple(map(tuple, route)))


def line_and_edge(setup: RunSetup) -> tuple[Any, Any]:
    way = reference_lanes(setup)
    return shapely.LineString(reference_path(setup, way)), shapely.MultiLineString(road_edge(setup, way))


@pytest.mark.parametrize(
    ("start", "lane"),
    [(START, -2), (EgoState(800.0, 1.75, np.pi, 20.0), 1), (START._replace(y=-1.75), -1)],
    ids=["right", "oncoming", "left"],
)
def test_the_reference_path_is_the_lane_s_centre(start: EgoState, lane: int) -> None:
    network = load(MAP)
    line, edge = line_and_edge(told(network, start))
    assert line.distance(shapely.Point(start.x, start.y)) < 1e-6
    s = line.project(shapely.Point(start.x, start.y))
    along = s + np.arange(0.0, 900.0 if lane < 0 else 700.0, 5.0)
    points = shapely.get_coordinates(line.interpolate(along))
    found = network.to_road(points[:, 0], points[:, 1])
    assert set(found.lane.tolist()) == {lane}
    assert np.abs(found.t).max() < 0.01
    assert line.length > s + 500.0
    assert 1.7 < shapely.LineString(points).distance(edge) < 1.8  # half a lane beside it, and none across it


def test_an_oncoming_lane_is_beyond_the_edge() -> None:
    _, edge = line_and_edge(told(load(MAP), START))
    assert edge.distance(shapely.Point(300.0, 0.0)) < 0.02  # between the directions
    assert edge.distance(shapely.Point(300.0, 1.75)) > 1.5


@pytest.mark.skipif(not DATA.is_dir(), reason="no shared data")
def test_the_path_changes_to_the_lane_that_stays_on_the_route() -> None:
    network = load(DATA / "ngsim" / "USA_US101-22_1_T-1.xodr")
    lanes = told(network, START).road.lanes
    ramp = next(lane for lane in lanes if lane.road == "22" and lane.lane == -6)
    leads = {lanes[k].road for k in ramp.after}
    beside = next(lane for lane in lanes if lane.road == "22" and lane.lane == -5)
    on = {lanes[k].road for k in beside.after}
    assert leads.isdisjoint(on)
    (x, y), way = ramp.centre[0], ramp.centre[1] - ramp.centre[0]
    start = EgoState(float(x), float(y), float(np.arctan2(way[1], way[0])), 15.0)
    stays = told(network, start, [["22"], sorted(on)])
    changed = reference_lanes(stays)
    assert [lanes[k].lane for pair in changed for k in pair if lanes[k].road == "22"] == [-6, -5]
    line = shapely.LineString(reference_path(stays, changed))
    assert line.distance(shapely.Point(*ramp.centre[0])) < 0.01
    assert line.distance(shapely.Point(*beside.centre[-1])) < 0.01


def seen(t: float, ego: EgoState, x: Sequence[float], y: Sequence[float], v: float = 0.0) -> Perceived:
    """Cars at x ahead and y to the left, as fast as v."""
    n = len(x)
    names = np.array([str(k) for k in range(n)], dtype=str), np.array(["car"] * n, dtype=str)
    sizes = np.full(n, v), np.full(n, 4.7), np.full(n, 1.9)
    return Perceived(t, ego, *names, np.array(x, dtype=float), np.array(y, dtype=float), np.zeros(n), *sizes)  # type: ignore[arg-type]


@pytest.fixture
def planner() -> Iterator[Any]:
    build = load_build(BUILD)
    with build.factory.afresh():
        function = build.make()
        yield function
        function.close()


def setup_at(start: EgoState) -> Setup:
    return Setup(load(MAP), start, (900.0, -5.25), 4.7, 1.9, 0.2, 0, None, NO_ROUTE)  # type: ignore[arg-type]


@pytest.mark.slow
@there
def test_it_keeps_its_lane_and_speed_follows_and_brakes_where_there_is_no_way(
    planner: Any, capfd: pytest.CaptureFixture[str]
) -> None:
    start = START._replace(v=20.0)
    planner.reset(setup_at(start))
    free = planner.step(seen(0.0, start, [], []))
    assert abs(free.acceleration) < 0.2  # its samples of speeds need not have the one that is wanted
    assert abs(free.curvature) < 1e-4
    assert free.plan[0] == pytest.approx([0.0, start.x, start.y, 20.0], abs=1e-6)  # of the box centre
    assert free.plan[-1] == pytest.approx([3.0, start.x + 60.0, start.y, 20.0], abs=0.8)
    aside = planner.step(seen(0.2, start, [25.0, 25.0], [0.0, 3.5], 10.0))
    assert aside.acceleration < -0.5
    none = planner.step(seen(0.4, start, [9.0, 9.0, 9.0], [-3.0, 0.0, 3.5]))
    assert none.acceleration == -8.0
    assert abs(none.curvature) < 1e-4
    assert none.plan[-1][1] == pytest.approx(start.x + 20.0**2 / 16.0, abs=0.05)
    planner.close()
    words = capfd.readouterr().err
    assert "no trajectory in 1 of 3 cycles, first at 0.40 s" in words


@there
@pytest.mark.slow
def test_several_at_once_answer_as_each_alone() -> None:
    build = load_build(BUILD)
    starts = [START, START._replace(v=25.0)]
    lists = [
        seen(0.0, start, [10.0] * 3, [0.0, 3.5, -3.0], v)
        for start, v in zip(starts, (20.0, 0.0), strict=True)
    ]
    with build.factory.afresh():
        alone = []
        for start, one in zip(starts, lists, strict=True):
            function: Any = build.make()
            function.reset(setup_at(start))
            alone.append(function.step(one))
            function.close()
        batch: Any = build.make()
        batch.reset_batch([setup_at(start) for start in starts])
        answers = [messages._numbers(told) for told in batch._ask(
            {"message": "step_batch", "t": 0.0, "runs": [messages._list(one) for one in lists]}
        )["runs"]]  # fmt: skip
        batch.close()
    assert alone[1].acceleration == -8.0  # without a trajectory, and a plan of as many rows
    for one, answer in zip(alone, answers, strict=True):
        assert (one.acceleration, one.curvature) == answer[:2]
        np.testing.assert_array_equal(one.plan, answer[2])


@there
@pytest.mark.slow
def test_it_drives_the_corner_case_the_same_twice(tmp_path: Path) -> None:
    found = []
    for name in ("one", "two"):
        options = resim.ResimulationOptions(bases=("GT",))
        result = resim.resimulate(ROOT / "scenarios" / "cut_in_brake", BUILD, options)
        assert result.report.end["rGT"] == "duration"
        result.write(tmp_path / name)
        found.append([(tmp_path / name / file).read_bytes() for file in ("tracks.parquet", "plans.parquet")])
    assert found[0] == found[1]
