"""Traffic that changes lanes around an EGO: when it does, when it does not, and how it moves; planted scenes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from typing import Any, Literal

import numpy as np
import pytest
from conftest import ROOT
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from resim.core.geometry import Boxes, boxes_overlap
from resim.resimulation.notes import handed_over
from resim.road.opendrive import RoadNetwork, load
from resim.road.path import lane_path
from resim.scenario.scenario import RoadPosition, Scenario, ScenarioObject
from resim.simulation.case import Case, SimulatedDrive
from resim.simulation.direct import Direct
from resim.simulation.function.interface import Build, load_build
from resim.simulation.reactive.drivers import TrafficDriver
from resim.simulation.reactive.lanes import Side, neighbour
from resim.simulation.reactive.mobil import Body, InLane, Nearest, gets_by, in_lane, moved_in, moved_out
from resim.simulation.reactive.settings import LaneChangeSettings, ReactiveSettings
from resim.simulation.reactive.ways import Boxed
from resim.simulation.sumo.engine import Sumo

Make = Callable[..., Any]
REACTIVE = ReactiveSettings()
KEEPS = ReactiveSettings(lane_change=LaneChangeSettings(possible=False))
ENGINES: dict[str, dict[str, Any]] = {
    "resim": {}, "sumo": {"engine": Sumo(), "traffic": ReactiveSettings(drivers="sumo")}
}  # fmt: skip
XODR = ROOT.parent / "shared" / "data" / "xodr"
CRAWLS = "return Command(-4.0 if perceived.t > 0.5 and perceived.ego.v > 2.5 else 0.0, 0.0)"
LENGTH, WIDTH = 4.7, 1.9
LANE = 3.5


@pytest.fixture
def scene(network: RoadNetwork, function: Make) -> Make:
    """Simulate an EGO that crawls, and others, for so long [s] as its trace."""

    def run(
        ego: ScenarioObject, *others: ScenarioObject, body: str = CRAWLS, net: RoadNetwork = network,
        build: Build | None = None, engine: Any = None, traffic: ReactiveSettings | None = REACTIVE,
    ) -> SimulatedDrive:  # fmt: skip
        scenario = Scenario(net.path.name, float(ego.v.x[-1] - ego.v.x[0]), ego, others)
        return Case(scenario, net, build or function(body), engine or Direct(), traffic=traffic).drive()

    return run


@pytest.fixture
def car(member: Make) -> Make:
    """Make a car on the straight that is there for 25 s."""

    def make(name: str, s: float, v: object = 20.0, *, lane: int = -2, **how: Any) -> ScenarioObject:
        kind = how.pop("kind", "car")
        return replace(member(name, s, v, lane=lane, end=how.pop("end", 25.0), **how), kind=kind)

    return make


def along(
    net: RoadNetwork, name: str, start: tuple[str, int, float], v: float, end: float, **how: Any
) -> ScenarioObject:
    """Make a car that drives along a lane, however it bends."""
    road, lane, s = start
    path = lane_path(net, road, lane, s, v * end + 20.0)
    t = np.linspace(0.0, end, max(int(10 * end), 2))
    heading = CubicSpline(t, np.interp(v * t, path.s, path.heading))
    speed = CubicSpline(t[[0, -1]], [v, v])
    return ScenarioObject(name, "car", LENGTH, WIDTH, RoadPosition(road, lane, s, 0.0), speed, heading)


def sides(drive: SimulatedDrive, name: str = "f") -> list[Side]:
    """To which sides an object's driver changed lanes, in the order of time."""
    return [change.side for one in drive.handed_over if one.id == name for change in one.lane_changes]


def overlaps(drive: SimulatedDrive) -> list[tuple[str, str]]:
    """Who overlap at some time, by an own look at all pairs."""
    t = drive.truth
    box = [Boxes(t.x[n], t.y[n], t.heading[n], t.length[n], t.width[n]) for n in range(len(t.ids))]
    pairs = combinations(range(len(box)), 2)
    return [(str(t.ids[m]), str(t.ids[n])) for m, n in pairs if boxes_overlap(box[n], box[m]).any()]


def assert_moves_as_vehicles_do(drive: SimulatedDrive, n: int, across: float = 4.5) -> None:
    """No jump, no slip: heading is the direction of motion; it is not thrown to the side."""
    t, dt = drive.truth, float(drive.truth.t[1] - drive.truth.t[0])
    step = np.diff(t.x[n]) + 1j * np.diff(t.y[n])
    v, a = 0.5 * (t.v[n, 1:] + t.v[n, :-1]), np.diff(t.v[n]) / dt
    assert np.abs(np.abs(step) - v * dt).max() < 0.06
    assert a.min() >= -REACTIVE.hand_over.hardest - 1e-6
    heading = np.unwrap(t.heading[n])
    moving = v > 1.0
    middle = 0.5 * (heading[1:] + heading[:-1])
    assert np.abs(np.angle(step * np.exp(-1j * middle)))[moving].max() < 0.02
    turning = np.abs(np.diff(heading)) / dt
    whole = max(round(0.2 / dt), 1)  # of polylines
    smooth = np.convolve(turning, np.ones(whole) / whole, "valid")
    assert (smooth * v[: len(smooth)]).max() < across


def test_it_overtakes_an_ego_that_crawls_and_comes_back(scene: Make, car: Make) -> None:
    ego, other = car("ego", 300.0), car("f", 230.0)
    found = scene(ego, other)
    assert found.end == "duration"
    assert sides(found) == ["left", "right"]
    (one,) = found.handed_over
    assert found.truth.x[1, -1] > found.truth.x[0, -1] + 100.0
    assert found.truth.y[1].max() == pytest.approx(found.truth.y[1, 0] + LANE, abs=1e-3)
    assert one.back is not None
    after = found.truth.t >= one.back
    np.testing.assert_allclose(found.truth.y[1, after], found.truth.y[1, 0], atol=1e-6)
    np.testing.assert_allclose(found.truth.x[1, after], 230.0 + 20.0 * found.truth.t[after], atol=1e-6)
    assert (found.truth.x[1] <= 230.0 + 20.0 * found.truth.t + 1e-6).all()
    assert overlaps(found) == []
    assert_moves_as_vehicles_do(found, 1, 1.5)
    keeps = scene(ego, other, traffic=KEEPS)
    assert sides(keeps) == []
    assert keeps.handed_over[0].farthest > one.farthest + 100.0
    told = handed_over(found.handed_over)
    first, second = one.lane_changes
    assert f"changing lanes to the left at {first.t:.2f} s, to the right at {second.t:.2f} s" in told


@pytest.mark.parametrize(
    ("others", "when"),
    [
        ([("g", 228.0, 20.0)], "is beside"),
        ([("g", 150.0, 33.0)], "comes from behind, fast"),
        ([("g", 262.0, 8.0)], "is ahead there, slow"),
    ],
)
def test_it_does_not_go_where_somebody(
    scene: Make, car: Make, others: list[tuple[str, float, float]], when: str
) -> None:
    """Not as long as he is: it waits behind the EGO, and nobody on the left has to brake hard for it."""
    ego, other = car("ego", 300.0), car("f", 230.0)
    free = scene(ego, other)
    there = [car(name, s, v, lane=-1) for name, s, v in others]
    found = scene(ego, other, *there)
    first = [one.lane_changes[0].t for one in (free.handed_over[0], found.handed_over[0]) if one.lane_changes]
    assert len(first) < 2 or first[1] > first[0] + 1.5, when
    assert overlaps(found) == []
    assert all(one.hardest <= REACTIVE.lane_change.safe for one in found.handed_over)


def test_it_changes_to_no_lane_that_ends_or_is_of_the_other_direction(scene: Make, car: Make) -> None:
    """On the inner lane there is the oncoming one to the left; the one to the right is there."""
    ego, other = car("ego", 300.0, lane=-1), car("f", 230.0, lane=-1)
    assert sides(scene(ego, other)) == ["right", "left"]
    left = ReactiveSettings(lane_change=LaneChangeSettings(sides="left"))
    assert sides(scene(ego, other, traffic=left)) == []
    # the lane that opens at 900 m is too narrow for long
    found = scene(car("ego", 890.0, lane=-2), car("f", 820.0, lane=-2), car("g", 822.0, lane=-1))
    assert "right" not in sides(found)[:1] or found.truth.x[1].max() > 940.0


@pytest.mark.parametrize(
    ("kind", "changes"), [("car", True), ("truck", True), ("bicycle", False), ("trailer", False)]
)
def test_who_changes_lanes(scene: Make, car: Make, kind: str, changes: bool) -> None:
    found = scene(car("ego", 300.0), car("f", 220.0, kind=kind))
    assert bool(sides(found)) is changes


def test_who_tows_a_trailer_stays_with_it(scene: Make, car: Make) -> None:
    tractor, trailer = car("f", 230.0), car("trailer", 230.0 - LENGTH - 0.5, kind="trailer")
    found = scene(car("ego", 300.0), tractor, trailer)
    assert sides(found) == []


def test_both_engines_give_the_same_bytes_and_twice(scene: Make, car: Make) -> None:
    objects = car("ego", 300.0), car("f", 230.0), car("h", 200.0), car("g", 150.0, 26.0, lane=-1)
    one, again, other = (scene(*objects, engine=engine) for engine in (Direct(), Direct(), Sumo()))
    assert sides(one)
    assert one.fingerprint() == again.fingerprint() == other.fingerprint()


def test_with_replay_nobody_changes_lanes(scene: Make, car: Make) -> None:
    own = load_build(ROOT / "adfunc" / "builds" / "replay-1.0.toml")
    slow = [20.0, 20.0, 2.0, 2.0]
    objects = car("ego", 300.0, slow), car("f", 280.0, 0.9 * np.array(slow))
    one, two = (scene(*objects, build=own, traffic=traffic) for traffic in (None, REACTIVE))
    assert two.handed_over == ()
    for column in ("x", "y", "heading", "v"):
        assert getattr(one.truth, column).tobytes() == getattr(two.truth, column).tobytes()


commands = st.lists(st.floats(-6.0, 2.0), min_size=4, max_size=4)
place = st.tuples(st.sampled_from([-1, -2]), st.integers(-14, 14), st.floats(14.0, 26.0))
places = st.lists(place, max_size=5, unique_by=lambda one: one[:2])


def traces_that_meet(others: list[tuple[int, int, float]]) -> set[tuple[str, str]]:
    """Pairs of one lane of whom the one behind is faster by so much that it gets there within 15 s."""
    return {
        (f"o{a}", f"o{b}")
        for (a, one), (b, two) in combinations(enumerate(others), 2)
        if one[0] == two[0]
        and 20.0 * abs(one[1] - two[1]) - LENGTH < 15.0 * (one[2] - two[2]) * np.sign(two[1] - one[1])
    }


@pytest.mark.parametrize("drivers", ["resim", pytest.param("sumo", marks=pytest.mark.slow)])
@given(commands, places)
@example([-4.888240954167173, 1.0255693392415353, 0.0, 0.0], [(-2, -12, 24.0), (-2, -13, 26.0)])
@settings(
    max_examples=4,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
    deadline=None,
    derandomize=True,
)
def test_whatever_the_ego_does_nobody_is_hit_who_was_not_before(
    scene: Make, car: Make, drivers: Literal["resim", "sumo"], accelerations: list[float],
    others: list[tuple[int, int, float]],
) -> None:  # fmt: skip
    """Nobody who changes lanes comes to overlap another one; all move as vehicles do.

    An EGO that is blind may run into whoever came in ahead of it: that is the EGO's fault, and not looked at.
    """
    body = f"return Command({accelerations!r}[min(int(max(perceived.t, 0.0) // 3), 3)], 0.0)"
    there = [
        car(f"o{n}", 450.0 + 20.0 * slot, v, lane=lane, end=15.0)
        for n, (lane, slot, v) in enumerate(others)
        if (lane, slot) != (-2, 0)
    ]
    ego, follower = car("ego", 450.0, end=15.0), car("f", 416.0, end=15.0)
    keeps = scene(ego, follower, *there, body=body, traffic=KEEPS)
    found = scene(ego, follower, *there, body=body, **ENGINES[drivers])
    changed = {one.id for one in found.handed_over if one.lane_changes}
    before = {*overlaps(keeps), *traces_that_meet(others)}
    assert [
        pair for pair in overlaps(found) if "ego" not in pair and changed & set(pair) and pair not in before
    ] == []
    for n in range(1, len(found.truth.ids)):
        assert_moves_as_vehicles_do(found, n)
    assert scene(ego, follower, *there, body=body, **ENGINES[drivers]).fingerprint() == found.fingerprint()


def curved(name: str) -> RoadNetwork:
    file = XODR / name
    if not file.is_file():
        pytest.skip("no maps")
    return load(file)


@pytest.mark.parametrize("drivers", ["resim", "sumo"])
@pytest.mark.parametrize(
    ("name", "road", "lane"),
    [
        ("proving_ground", "1", -2),
        ("alks/alks_road_left_radius_250m.xodr", None, -4),
        ("alks/alks_road_right_radius_250m.xodr", None, -4),
        ("esmini/e6mini.xodr", "0", -3),
    ],
)
@pytest.mark.slow
def test_in_bends_it_moves_along_the_lane(
    scene: Make, function: Make, network: RoadNetwork, name: str, road: str | None, lane: int,
    drivers: Literal["resim", "sumo"],
) -> None:  # fmt: skip
    net = network if name == "proving_ground" else curved(name)
    road = road or next(iter(net.roads))
    length = net.roads[road].length
    begin = 0.6 * length if name == "proving_ground" else 0.25 * length
    v, end = 15.0, min(18.0, (length - begin) / 15.0 - 6.0)
    ego, other = (along(net, who, (road, lane, begin + s), v, end) for who, s in (("ego", 60.0), ("f", 0.0)))
    found = scene(ego, other, net=net, build=function(IN_BENDS, reset=KEEP_LANE), **ENGINES[drivers])
    assert sides(found)
    assert overlaps(found) == []
    assert_moves_as_vehicles_do(found, 1)
    (one,) = found.handed_over
    k = int(np.searchsorted(found.truth.t, one.lane_changes[0].t + 6.0))
    at = net.to_road(found.truth.x[1, k], found.truth.y[1, k], heading=found.truth.heading[1, k])
    assert abs(int(at.lane[0])) in (abs(lane) - 1, abs(lane) + 1)
    assert abs(float(at.t[0])) < 0.15


KEEP_LANE = """from resim.road.path import lane_path
self.setup = setup
at = setup.road.to_road(setup.start.x, setup.start.y, heading=setup.start.heading)
self.path = lane_path(setup.road, str(at.road[0]), int(at.lane[0]), float(at.s[0]), 500.0)"""
IN_BENDS = """s, d, heading, _ = self.path.track(perceived.ego.x, perceived.ego.y)
off = math.remainder(perceived.ego.heading - heading, math.tau)
bend = float(self.path.curvature_at(s)[0]) - 0.02 * d - 0.3 * off
return Command(-4.0 if perceived.t > 0.5 and perceived.ego.v > 2.0 else 0.0, bend)"""


def test_lanes_beside_are_those_of_the_map(network: RoadNetwork) -> None:
    """By the map's own records: broken lines, the oncoming lane, the shoulder, the lane that opens."""
    straight = 300.0, -5.25, 0.0, math.nan
    left = neighbour(network, straight, WIDTH, "left", 500.0, 80.0)
    assert left is not None
    assert left.left >= 500.0
    s, d = left.places(np.array([350.0 - 1.75j, 250.0 - 5.25j]))
    np.testing.assert_allclose(s, [50.0, -50.0], atol=1e-6)
    np.testing.assert_allclose(d, [0.0, -LANE], atol=1e-6)
    assert neighbour(network, straight, WIDTH, "right", 500.0, 80.0) is None  # the shoulder
    assert neighbour(network, (300.0, -1.75, 0.0, math.nan), WIDTH, "left", 500.0, 80.0) is None  # oncoming
    assert neighbour(network, (300.0, -1.75, math.pi, math.nan), WIDTH, "right", 500.0, 80.0) is None
    assert neighbour(network, (905.0, -5.25, 0.0, math.nan), WIDTH, "right", 500.0, 80.0) is None  # a taper


def test_a_solid_line_is_not_crossed_where_the_map_knows_others(network: RoadNetwork) -> None:
    road = network.roads["1"]
    lanes = dict(road.sections[0].lanes)
    lanes[-1] = replace(lanes[-1], marks=(replace(lanes[-1].marks[0], type="solid"),))
    first = replace(road.sections[0], lanes=lanes)
    solid = replace(
        network, roads={**network.roads, "1": replace(road, sections=(first, *road.sections[1:]))}
    )
    at = 300.0, -5.25, 0.0, math.nan
    assert neighbour(network, at, WIDTH, "left", 300.0, 80.0) is not None
    assert neighbour(solid, at, WIDTH, "left", 300.0, 80.0) is None
    assert neighbour(solid, (840.0, -5.25, 0.0, math.nan), WIDTH, "left", 300.0, 80.0) is None  # still solid


@pytest.mark.parametrize("name", ["highway_exit.xodr", "highway_example_with_merge_and_split.xodr"])
def test_lanes_end_at_junctions(name: str) -> None:
    net = curved(f"esmini/{name}")
    looked = 0
    for road in net.roads.values():
        for lane in road.sections[0].lanes.values():
            if not lane.drivable or lane.id == 0:
                continue
            at = 0.5 * road.length
            if not net.has_lane(road.id, lane.id, at):
                continue
            x, y = (float(c) for c in net.to_xy(road.id, lane.id, at, 0.0))
            state = x, y, float(net.lane_heading(road.id, lane.id, at)), math.nan
            found = [neighbour(net, state, WIDTH, side, 2000.0, 10.0) for side in ("left", "right")]
            if road.junction is not None:
                assert found == [None, None]
            elif road.predecessor and road.successor:
                looked += sum(one is not None for one in found)
                assert all(one is None or one.left < 2000.0 for one in found)
    assert looked or name == "highway_exit.xodr"


DRIVER = TrafficDriver(30.0, 1.2, 2.0, 1.4, 2.0, 0.4)


def test_who_is_next_in_a_lane() -> None:
    """Of five: ahead, farther ahead, behind, in another lane, and one that will come into the lane."""
    n = 5
    length, width, zeros = np.full(n, LENGTH), np.full(n, WIDTH), np.zeros(n)
    others = Boxed(zeros + 0j, zeros, np.arange(10.0, 15.0), length, width, zeros)
    s = np.array([30.0, 60.0, -20.0, -8.0, 12.0])
    low, high = np.array([0.0, 0.0, 0.0, 3.5, 0.5]), np.array([0.0, 0.0, 0.0, 3.5, 3.5])
    own, nobody = Body(20.0, LENGTH, WIDTH), np.zeros(n, dtype=bool)
    found = in_lane(s, (low, high), others, own, nobody)
    assert (found.ahead.row, found.behind.row) == (4, 2)
    assert (found.ahead.gap, found.behind.gap) == pytest.approx((12.0 - LENGTH, 20.0 - LENGTH))
    assert found.behind.v == 12.0
    over = np.array([False, False, True, False, True])  # on a bridge
    assert in_lane(s, (low, high), others, own, over).ahead.row == 0
    assert in_lane(s, (low, high), others, own, over).behind.row == -1


def test_what_a_change_costs_the_one_behind_is_the_models_equation() -> None:
    def idm(v: float, gap: float, lead: float) -> float:
        keep = 2.0 + max(0.0, v * 1.2 + v * (v - lead) / (2.0 * math.sqrt(1.4 * 2.0)))
        return 1.4 * (1.0 - (v / 30.0) ** 4 - (keep / gap) ** 2)

    own, behind, ahead = Body(20.0, LENGTH, WIDTH), Nearest(0, 50.0, 25.0), Nearest(1, 60.0, 24.0)
    before, after = moved_in(behind, own, InLane(ahead, behind), 2.0, DRIVER, 8.0)
    assert before == pytest.approx(idm(25.0, 50.0 + LENGTH + 60.0, 24.0))
    assert after == pytest.approx(idm(25.0, 50.0 - 2.0 * 5.0, 20.0))  # nearer, until it is there
    freed = moved_out(behind, own, InLane(ahead, behind), DRIVER, 8.0)
    assert freed == pytest.approx(before - max(idm(25.0, 50.0, 20.0), -8.0))


@pytest.mark.parametrize(("v", "brakes", "gets"), [(18.0, 0.0, True), (10.0, 0.0, False), (18.0, 8.0, False)])
def test_who_gets_by_is_beside_before_it_is_too_near(v: float, brakes: float, gets: bool) -> None:
    """30 m until it is aside, at 20 m/s: 1.5 s, in which one 12 m ahead goes 27 m at 18 m/s, less if he brakes."""
    assert gets_by(30.0, 20.0, Nearest(0, 12.0, v), brakes) is gets
