"""Maneuvers that were planted are found, each once, and nothing else, on maps with curves, sections and junctions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from junction import write_junction
from mining.planted import (
    Drive,
    braking,
    crossed,
    path_of,
    smooth,
    steady,
    tracks_of,
    write_motorway,
    write_straight,
)

from resim.core.tracks import Tracks
from resim.mining.features import Features, features
from resim.mining.find import find_maneuvers
from resim.mining.maneuver import LabelledManeuver
from resim.mining.settings import DEFAULT_SETTINGS, MiningSettings
from resim.road.driven_route import Route
from resim.road.opendrive import RoadNetwork, load

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data" / "xodr"
CHANGES = ("lane_change_left", "lane_change_right", "lane_change_not_judged")


def mined(
    tracks: Tracks, network: RoadNetwork, settings: MiningSettings = DEFAULT_SETTINGS
) -> tuple[Features, list[LabelledManeuver]]:
    found = features(tracks, network)
    return found, find_maneuvers(found, settings)


def told(found: Features, maneuvers: list[LabelledManeuver], *without: str) -> list[tuple[str, str]]:
    """Who did what, but for what everybody does all the time."""
    ids = found.samples.tracks.ids.tolist()
    quiet = {"follow_lane", "road_widens", "lane_ends", "unprotected_way", *without}
    return sorted((ids[m.object], m.label) for m in maneuvers if m.label not in quiet)


def road(name: str) -> RoadNetwork:
    file = DATA / name
    if not file.is_file():
        pytest.skip(f"{name} is not here")
    return load(file)


def test_who_rolls_into_a_junction_and_back_did_not_pass_it() -> None:
    """The junction of the town begins at x = -20 m; parts of it lie on several connections."""
    t = np.arange(0.0, 8.01, 0.04)
    x = -25.0 + 5.3 * np.sin(np.pi * t / 8.0)
    zero, there = np.zeros((1, len(t))), np.ones((1, len(t)), dtype=bool)
    tracks = Tracks(
        t=t, ids=np.array(["a"]), kind=np.array(["car"]), x=x[None], y=zero - 1.75, heading=zero,
        v=np.gradient(x, t)[None], length=np.array([4.7]), width=np.array([1.9]), valid=there,
    )  # fmt: skip
    found, maneuvers = mined(tracks, load(ROOT / "networks" / "urban.xodr"))
    assert (found.junction >= 0).any()
    assert not [m for m in maneuvers if m.label in ("straight", "u_turn", "turn_left", "turn_right")]


LANES = {
    "e6mini": ("esmini/e6mini.xodr", "0", -3, 100.0, 3.5),
    "curvatures": ("alks/alks_road_different_curvatures.xodr", "0", -4, 900.0, 3.5),
    "sections": ("esmini/multi_lanesections.xodr", "0", 1, 450.0, 3.0),
    "merge and split": ("esmini/highway_example_with_merge_and_split.xodr", "0", -2, 5.0, 3.5),
}
"""Map, road, a lane with another to its right (or left), where it begins, and its width [m]."""


@pytest.mark.parametrize("name", [*LANES, "proving ground"])
@pytest.mark.parametrize("side", [1, -1])
def test_a_lane_change_is_found_once_and_from_when_to_when(name: str, side: int) -> None:
    if name == "proving ground":
        network, number, lane, s = (
            load(ROOT / "networks" / "proving_ground.xodr"),
            "1",
            -1 if side < 0 else -2,
            700.0,
        )
    else:
        file, number, lane, s, _ = LANES[name]
        network = road(file)
        if name == "sections":
            s, lane = 395.0, 1 if side < 0 else 2  # driven against s: lane 2 is to the right of lane 1
    path = path_of(network, number, lane, s, 250.0)
    width = 2.0 * float(path.half_width[0])
    size = side * width
    drive = Drive("a", steady(15.0), lambda t: smooth(t, 3.0, 5.0, size), end=12.0)
    keeps = Drive("b", lambda t: 60.0 + 8.0 * t, end=12.0)
    found, maneuvers = mined(tracks_of(path, [drive, keeps]), network)
    expected = "lane_change_left" if side > 0 else "lane_change_right"
    assert [pair for pair in told(found, maneuvers) if pair[1] in CHANGES] == [("a", expected)]
    (change,) = [m for m in maneuvers if m.label == expected]
    t = found.samples.t
    fine = np.arange(0.0, 12.0, 1.0 / 25.0)
    assert t[change.at] == pytest.approx(crossed(fine, smooth(fine, 3.0, 5.0, size), 0.5 * size), abs=0.05)
    quick = np.abs(np.gradient(smooth(fine, 3.0, 5.0, size), fine)) >= 0.03
    assert t[change.start] == pytest.approx(fine[quick][0] - 0.04, abs=0.13)
    assert t[change.end] == pytest.approx(fine[quick][-1] + 0.04, abs=0.13)


@pytest.mark.parametrize("v", [1.5, 2.5, 4.0])
def test_a_lane_change_in_a_jam_is_one_however_steeply_it_crosses(tmp_path: Path, v: float) -> None:
    network = load(write_motorway(tmp_path / "motorway.xodr"))
    path = path_of(network, "7", -2, 520.0, 360.0)
    drives = [
        Drive("a", steady(v), lambda t: smooth(t, 3.0, 6.0, 3.5), end=14.0),
        Drive("b", lambda t: 40.0 + v * t, end=14.0),
    ]
    tracks = tracks_of(path, drives)
    lane = np.interp(v * tracks.t, path.s, path.heading)
    assert np.abs(tracks.heading[0] - lane).max() > 0.25
    found, maneuvers = mined(tracks, network)
    assert [pair for pair in told(found, maneuvers) if pair[1] in CHANGES] == [("a", "lane_change_left")]


@pytest.mark.parametrize("noise", [0.0, 0.03, 0.1])
def test_doubles_are_one_label_and_swaying_over_the_border_is_none(noise: float) -> None:
    network = road("alks/alks_road_different_curvatures.xodr")
    path = path_of(network, "0", -5, 900.0, 900.0)

    def left_once(t: np.ndarray) -> np.ndarray:
        return smooth(t, 2.0, 5.0, 3.5)

    def sway(t: np.ndarray) -> np.ndarray:
        return smooth(t, 4.0, 3.0, 2.2) - smooth(t, 8.0, 3.0, 2.2)

    drives = [
        Drive("double", steady(30.0), lambda t: smooth(t, 4.0, 9.0, 7.0), end=20.0),
        Drive("sways", lambda t: 80.0 + 30.0 * t, sway, end=20.0),
        Drive("two", lambda t: 160.0 + 30.0 * t, lambda t: left_once(t) + smooth(t, 11.0, 5.0, 3.5), end=20.0),
        Drive("there and back", steady(20.0), lambda t: left_once(t) - smooth(t, 12.0, 5.0, 3.5), end=20.0),
        Drive("late", lambda t: 240.0 + 30.0 * t, lambda t: smooth(t, 17.0, 5.0, 3.5), end=20.0),
    ]  # fmt: skip
    found, maneuvers = mined(tracks_of(path, drives, noise=noise), network)
    left, right = "lane_change_left", "lane_change_right"
    assert [pair for pair in told(found, maneuvers) if pair[1] in CHANGES] == [
        ("double", left), ("late", "lane_change_not_judged"), ("there and back", left), ("there and back", right),
        ("two", left), ("two", left),
    ]  # fmt: skip
    lanes = {found.samples.tracks.ids[m.object]: m.figures["lanes"] for m in maneuvers if m.label == left}
    assert lanes == {"double": 2.0, "there and back": 1.0, "two": 1.0}


def test_following_a_lane_that_diverges_or_turns_is_no_lane_change(tmp_path: Path) -> None:
    network = load(write_junction(tmp_path / "junction.xodr"))
    for way, name in (("10", "2"), ("11", "3")):
        path = path_of(network, "1", -1, 20.0, 180.0, Route((("1",), (way,), (name,))))
        found, maneuvers = mined(tracks_of(path, [Drive("a", steady(8.0), end=20.0)]), network)
        turns = "straight" if way == "10" else "turn_left"
        assert told(found, maneuvers) == [("a", turns)]
        (turn,) = [m for m in maneuvers if m.label == turns]
        assert found.samples.t[turn.start] == pytest.approx(100.0 / 8.0, abs=0.05)
    network = road("esmini/highway_example_with_merge_and_split.xodr")
    for start, lane, way in (("0", -4, ("4", "2")), ("0", -1, ("3", "1")), ("8", 1, ("7", "1"))):
        s = 60.0 if start == "0" else 10.0
        path = path_of(network, start, lane, s, 200.0, Route(((start,), *((name,) for name in way))))
        if path.ends and path.end < 120.0:
            continue
        found, maneuvers = mined(
            tracks_of(path, [Drive("a", steady(14.0), end=min(14.0, path.end / 14.0 - 0.1))]), network
        )
        assert told(found, maneuvers) == [], (start, lane)


WAYS = [(one, two) for one in "0123" for two in "0123" if one != two]


@pytest.mark.parametrize(("before", "after"), WAYS)
def test_every_way_through_a_crossing_is_named_by_its_turn(before: str, after: str) -> None:
    network = road("esmini/fabriksgatan.xodr")
    (way,) = [
        r.id
        for r in network.roads.values()
        if r.junction and r.predecessor.id == before and r.successor.id == after
    ]
    own = network.roads[before]
    into = own.successor is not None and own.successor.kind == "junction"
    lane, s = (-1, own.length - 15.0) if into else (1, 15.0)
    path = path_of(network, before, lane, s, 45.0, Route(((before,), (way,), (after,))))
    found, maneuvers = mined(tracks_of(path, [Drive("a", steady(6.0), end=7.0)]), network)
    heading = network.lane_heading(way, -1, np.linspace(0.0, network.roads[way].length - 1e-6, 200))
    turned = float(np.diff(np.unwrap(heading)).sum())
    expected = "straight" if abs(turned) < 0.52 else "turn_left" if turned > 0.0 else "turn_right"
    assert told(found, maneuvers) == [("a", expected)]


def test_cut_ins_and_cut_outs_go_by_the_time_to_collision(tmp_path: Path) -> None:
    network = load(write_motorway(tmp_path / "motorway.xodr"))
    path = path_of(network, "7", -2, 520.0, 360.0)
    cuts = Drive("cuts", lambda t: 45.0 + 12.0 * t, lambda t: smooth(t, 2.0, 4.0, 3.5), end=11.0)
    fast = Drive("fast", lambda t: 0.0 + 20.0 * t, lambda t: np.full_like(t, 3.5), end=5.0)
    far = Drive("far", lambda t: 150.0 + 12.0 * t, lambda t: smooth(t, 2.0, 4.0, 3.5), end=11.0)
    found, maneuvers = mined(tracks_of(path, [cuts, fast, far]), network)
    pairs = told(
        found,
        maneuvers,
        "tailgating_minor",
        "pass",
        "overtaking_right",
        "critical_ttc",
        "critical_thw",
        "collision",
    )
    assert pairs == [("cuts", "cut_in_left"), ("cuts", "lane_change_left"), ("far", "lane_change_left")]
    (cut,) = [m for m in maneuvers if m.label == "cut_in_left"]
    assert found.samples.tracks.ids[cut.partner] == "fast"
    assert cut.figures["ttc_s"] == pytest.approx(1.16, abs=0.02)  # at Kaefer's end: 45 - 8 * 4.47 m at 8 m/s

    out = Drive("out", lambda t: 0.0 + 20.0 * t, lambda t: smooth(t, 2.0, 2.5, 3.5), end=9.0)
    slow = Drive("slow", lambda t: 42.0 + 8.0 * t, end=9.0)
    found, maneuvers = mined(tracks_of(path, [out, slow]), network)
    pairs = told(
        found, maneuvers, "tailgating_minor", "critical_ttc", "critical_thw", "collision", "sideswipe", "pass"
    )
    assert pairs == [("out", "cut_out_left"), ("out", "lane_change_left")]
    left = next(m for m in maneuvers if m.label == "cut_out_left")
    assert left.figures["ttc_s"] < 2.0


@pytest.mark.parametrize(
    ("v_kmh", "share", "label"),
    [(60.0, 0.95, "minor"), (60.0, 0.2, "minor"), (79.9, 0.1, "minor"), (80.1, 0.49, "moderate"), (80.1, 0.51, "minor"),
     (99.9, 0.2, "moderate"), (100.5, 0.31, "moderate"), (100.5, 0.29, "severe"), (130.0, 0.51, "minor"),
     (130.0, 0.29, "severe"), (130.0, 1.01, None)],
)  # fmt: skip
def test_tailgating_is_as_table_4_3_has_it(
    tmp_path: Path, v_kmh: float, share: float, label: str | None
) -> None:
    network = load(write_motorway(tmp_path / "motorway.xodr"))
    path = path_of(network, "7", -1, 20.0, 1500.0)
    v = v_kmh / 3.6
    ahead = Drive("b", lambda t: share * v_kmh / 2.0 + v * t, end=10.0, length=1.0)
    found, maneuvers = mined(tracks_of(path, [Drive("a", steady(v), end=10.0, length=1.0), ahead]), network)
    pairs = told(found, maneuvers, "critical_thw", "speeding", "critical_ttc")
    assert pairs == ([("a", f"tailgating_{label}")] if label else [])


def test_who_enters_ahead_gives_three_seconds(tmp_path: Path) -> None:
    network = load(write_motorway(tmp_path / "motorway.xodr"))
    path = path_of(network, "7", -2, 20.0, 1500.0)

    def labels(v: float, gap: float, restores: float | None = None) -> list[LabelledManeuver]:
        follower = steady(v) if restores is None else braking(v, -4.0, restores, 2.0)
        follows = Drive("a", follower, lambda t: np.full_like(t, 3.5), end=14.0, length=1.0)
        enters = Drive("b", lambda t: gap + v * t, lambda t: smooth(t, 2.0, 5.0, 3.5), end=14.0, length=1.0)
        found, maneuvers = mined(tracks_of(path, [follows, enters]), network)
        (change,) = [m for m in maneuvers if m.label == "lane_change_left"]
        own = [m for m in maneuvers if m.label.startswith("tailgating") and found.samples.owner[m.start] == 0]
        t = found.samples.t
        return [(m.label, round(float(t[m.start] - t[change.at]), 2)) for m in own]

    assert labels(25.0, 30.0) == [("tailgating_minor", 3.0)]
    assert labels(46.0, 60.0) == [("tailgating_minor", 1.0)]  # above 160 km/h: one second
    assert labels(20.0, 33.0, restores=4.6) == []  # 36 m are kept again within 3 s


def test_speed_and_acceleration(tmp_path: Path) -> None:
    network = load(write_motorway(tmp_path / "motorway.xodr"))
    path = path_of(network, "7", -1, 20.0, 1500.0)
    drives = [
        Drive("speeds", lambda t: 700.0 + 34.0 * t, end=12.0),
        Drive("at the limit", lambda t: 500.0 + 32.9 * t, end=12.0),
        Drive("brakes", lambda t: 300.0 + braking(20.0, -5.0, 4.0, 2.0)(t), end=12.0),
        Drive("brakes softly", lambda t: 150.0 + braking(12.0, -3.0, 4.0, 2.0)(t), end=12.0),
        Drive("accelerates", lambda t: 80.0 + braking(5.0, 3.0, 4.0, 1.5)(t), end=12.0),
        Drive("stands", lambda t: np.full_like(t, 10.0), end=12.0),
    ]  # fmt: skip
    found, maneuvers = mined(tracks_of(path, drives), network)
    assert told(found, maneuvers) == [
        ("accelerates", "strong_acceleration"), ("brakes", "strong_braking"), ("speeds", "speeding"),
        ("stands", "standing"),
    ]  # fmt: skip
    (brakes,) = [m for m in maneuvers if m.label == "strong_braking"]
    assert found.samples.t[[brakes.start, brakes.end]] == pytest.approx([4.0, 6.0], abs=0.09)


def test_ramps_passing_wrong_way_swerving_and_backing(tmp_path: Path) -> None:
    network = load(write_motorway(tmp_path / "motorway.xodr"))
    ramp = path_of(network, "7", -3, 310.0, 180.0)
    enters = Drive("enters", steady(20.0), lambda t: smooth(t, 2.0, 4.0, 3.5), end=9.0)
    found, maneuvers = mined(tracks_of(ramp, [enters]), network)
    assert told(found, maneuvers) == [("enters", "enter_highway"), ("enters", "lane_change_left")]

    main = path_of(network, "7", -2, 880.0, 300.0)
    leaves = Drive("leaves", steady(20.0), lambda t: -smooth(t, 3.0, 4.0, 3.5), end=10.0)
    found, maneuvers = mined(tracks_of(main, [leaves]), network)
    assert told(found, maneuvers) == [("leaves", "exit_highway"), ("leaves", "lane_change_right")]

    path = path_of(network, "7", -2, 20.0, 1000.0)
    quick, slow = Drive("quick", steady(30.0), end=14.0), Drive("slow", lambda t: 120.0 + 20.0 * t, end=14.0)
    left = lambda t: np.full_like(t, 3.5)  # noqa: E731
    for one, other, label in ((quick, slow, "overtaking_right"), (slow, quick, "pass")):
        drives = [one, Drive(other.name, other.way, left, end=14.0)]
        found, maneuvers = mined(tracks_of(path, drives), network)
        assert told(found, maneuvers) == [("quick", label)]
        (passes,) = [m for m in maneuvers if m.label == label]
        assert found.samples.t[passes.at] == pytest.approx(12.0, abs=0.05)

    oncoming = path_of(network, "7", 1, 800.0, 500.0)
    ghost = tracks_of(oncoming, [Drive("ghost", lambda t: 400.0 - 20.0 * t, end=14.0)])
    found, maneuvers = mined(ghost, network)
    assert told(found, maneuvers) == [("ghost", "wrong_way")]
    swerves = Drive("swerves", steady(20.0), lambda t: 0.7 * np.sin(2.0 * np.pi * t / 4.0), end=16.0)
    found, maneuvers = mined(tracks_of(path, [swerves]), network)
    assert told(found, maneuvers) == [("swerves", "swerving")]
    backs = Drive("backs", lambda t: 100.0 - 2.0 * t, end=10.0, backwards=True)
    found, maneuvers = mined(tracks_of(path, [backs]), network)
    assert told(found, maneuvers) == [("backs", "reversing")]


def test_overtaking_over_the_oncoming_lane_is_two_lane_changes_and_no_ghost_driver() -> None:
    network = road("esmini/fabriksgatan.xodr")
    path = path_of(network, "2", -1, 20.0, 260.0)
    width = 2.0 * float(path.half_width[0])
    over = Drive(
        "over", steady(15.0), lambda t: smooth(t, 2.0, 4.0, width) - smooth(t, 9.0, 4.0, width), end=16.0
    )
    found, maneuvers = mined(tracks_of(path, [over]), network)
    assert told(found, maneuvers, "speeding") == [("over", "lane_change_left"), ("over", "lane_change_right")]


def test_who_stops_amid_a_lane_change_and_goes_on_changes_lane(tmp_path: Path) -> None:
    """As at the end of an entry lane: at walking speed, so steeply as who turns off, and standing on the border."""
    network = load(write_straight(tmp_path / "straight.xodr"))

    def way(t: np.ndarray) -> np.ndarray:
        return 50.0 + 2.0 * (np.minimum(t, 8.3) + np.maximum(t - 14.3, 0.0))

    def aside(t: np.ndarray) -> np.ndarray:
        return smooth(way(t), 60.0, 12.0, 3.5)

    path = path_of(network, "1", -2, 5.0, 200.0)
    tracks = tracks_of(path, [Drive("a", way, aside, end=30.0)])
    stands = (tracks.t > 8.2) & (tracks.t < 14.4)
    tracks.heading[0, stands] = tracks.heading[0, np.argmax(stands) - 1]  # who stands is headed as it was
    found = features(tracks, network)
    told = [one for one in find_maneuvers(found) if one.label.startswith("lane_change")]
    assert [one.label for one in told] == ["lane_change_left"]
    cut = replace(tracks, valid=tracks.valid & (tracks.t < 14.5))
    told = [one for one in find_maneuvers(features(cut, network)) if one.label.startswith("lane_change")]
    assert [one.label for one in told] == ["lane_change_not_judged"]


def test_askew_over_lanes_that_cross_is_not_against_them(tmp_path: Path) -> None:
    """Two roads that cross without a junction, as some converters write: who turns left over their lanes goes against
    neither; who drives all of one of them the wrong way does, and is told once."""
    file = write_straight(tmp_path / "crossing.xodr")
    second = file.read_text().partition("<road")[2].partition("</road>")[0]
    second = second.replace('id="1"', 'id="2"', 1).replace(
        'x="0" y="0" hdg="0"', 'x="110.5" y="400" hdg="-1.5707963"'
    )
    file.write_text(file.read_text().replace("</OpenDRIVE>", f"<road{second}</road></OpenDRIVE>"))
    t = np.arange(0.0, 6.0, 0.04)
    ways = {
        "turns": (115.0 - 4.0 * t, -15.0 + 4.0 * t, 0.75 * np.pi),
        "ghost": (160.0 - 20.0 * t, 0.0 * t - 1.75, np.pi),
    }
    states = np.stack([[x, y, np.full_like(t, h), np.hypot(np.gradient(x, t), np.gradient(y, t))]
                       for x, y, h in ways.values()], axis=1)  # fmt: skip
    x, y, heading, v = states
    tracks = Tracks(
        t=t, ids=np.array([*ways]), kind=np.array(["car", "car"]), x=x, y=y, heading=heading, v=v,
        length=np.array([4.5, 4.5]), width=np.array([1.8, 1.8]), valid=np.ones(x.shape, dtype=bool),
    )  # fmt: skip
    found, maneuvers = mined(tracks, load(file))
    assert [name for name, label in told(found, maneuvers) if label == "wrong_way"] == ["ghost"]
