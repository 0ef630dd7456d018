"""Generated drives: their derivatives are exact, their truth is where the motion is, and faults are told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from resim.core.errors import ResimError
from resim.road.opendrive import RoadNetwork, load
from resim.scenario.generation.curve import RouteCurve, SplinePiece
from resim.scenario.generation.generate import GeneratedDrive, generate
from resim.scenario.generation.recipe import Recipe

ROOT = Path(__file__).parents[3]
MOTORWAY, URBAN = (load(ROOT / "networks" / f"{name}.xodr") for name in ("motorway", "urban"))
FINE = 1000.0
"""Hz at which central differences are an oracle."""


def made(
    network: RoadNetwork, *objects: dict[str, Any], duration: float = 8.0, **told: Any
) -> GeneratedDrive:
    return generate(
        Recipe(map="m.xodr", ego=objects[0]["id"], duration=duration, object=objects, **told), network
    )


def lanes(name: str, road: str, lane: int, s: float, speed: Any, **told: Any) -> dict[str, Any]:
    route = {"road": road, "lane": lane, "s": s, **told.pop("route", {})}
    return {"id": name, "route": route, "speed": speed, **told}


def misfit(drive: GeneratedDrive) -> np.ndarray:
    """By how much velocity [m/s], acceleration [m/s²] and yaw rate [rad/s] are off central differences, at most."""
    k = drive.tracks
    assert k.a is not None
    assert k.yaw_rate is not None
    dt = 2.0 / FINE
    place, velocity = k.x + 1j * k.y, k.v * np.exp(1j * k.heading)
    off = [
        np.abs((place[:, 2:] - place[:, :-2]) / dt - velocity[:, 1:-1]),
        np.abs((k.v[:, 2:] - k.v[:, :-2]) / dt - k.a[:, 1:-1]),
        np.abs(np.angle(np.exp(1j * (k.heading[:, 2:] - k.heading[:, :-2]))) / dt - k.yaw_rate[:, 1:-1]),
    ]
    return np.array([np.nanmax(o) for o in off])


@settings(max_examples=12, deadline=None)
@given(
    st.sampled_from([-1, -2, -3]), st.floats(0.0, 600.0), st.lists(st.floats(5.0, 40.0), min_size=1, max_size=4),
    st.floats(0.0, 3.0), st.floats(2.0, 6.0), st.sampled_from(["left", "right", None]), st.floats(-0.5, 0.5),
)  # fmt: skip
def test_derivatives_are_those_of_the_motion(lane, s, speeds, t, seconds, to, offset) -> None:
    to = {(-1, "left"): "right", (-3, "right"): "left"}.get((lane, to), to)  # the lane there must go on
    profile = {"times": [2.5 * k for k in range(len(speeds))], "values": speeds}
    change = {"t": t, "seconds": seconds, "to": to, "offset": offset}
    one = lanes("ego", "2", lane, s, profile, change=[change])
    drive = made(MOTORWAY, one, duration=9.0, rate=FINE)
    v, a, yaw_rate = misfit(drive)
    assert v < 1e-4
    assert a < 0.05  # where the cubics of two knots meet
    assert yaw_rate < 1e-2  # where a clothoid begins


@settings(max_examples=12, deadline=None)
@given(
    st.lists(st.tuples(st.floats(0.3, 2.0), st.floats(-3.0, 3.0)), min_size=2, max_size=5), st.booleans(),
    st.floats(0.0, 3.0),
)  # fmt: skip
def test_who_slips_moves_as_before_and_is_turned_as_told(steps, reverse, first) -> None:
    times = (first + np.cumsum([lasts for lasts, _ in steps])).tolist()
    values = [slip for _, slip in steps]
    one = {**lanes("ego", "2", -2, 100.0, 12.0), "reverse": reverse}
    plain = made(MOTORWAY, one, duration=8.0, rate=FINE).tracks
    told = made(MOTORWAY, {**one, "slip": {"times": times, "values": values}}, duration=8.0, rate=FINE).tracks
    for name in ("x", "y", "v", "a"):
        assert np.array_equal(getattr(told, name), getattr(plain, name))
    slip = np.angle(np.exp(1j * (told.heading - plain.heading)))[0]
    for t, value in zip(times, values, strict=True):
        if t <= 8.0:
            assert slip[np.searchsorted(told.t, t - 1e-9)] == pytest.approx(value, abs=1e-2)
    rate = np.angle(np.exp(1j * (told.heading[:, 2:] - told.heading[:, :-2]))) / (2.0 / FINE)
    assert told.yaw_rate is not None
    assert np.abs(rate - told.yaw_rate[:, 1:-1]).max() < 2e-2


@settings(max_examples=12, deadline=None)
@given(
    st.lists(st.tuples(st.floats(5.0, 30.0), st.floats(-4.0, 4.0)), min_size=4, max_size=8),
    st.floats(1.0, 20.0),
)
def test_a_route_by_points_passes_them_at_the_speed_that_is_told(steps, speed) -> None:
    points = np.cumsum(steps, axis=0)
    curve = RouteCurve([SplinePiece(points)])
    duration = min(8.0, curve.length / speed - 0.1)
    if duration < 0.5:
        return
    one = {"id": "ego", "kind": "bicycle", "route": {"points": points.tolist()}, "speed": speed}
    drive = made(MOTORWAY, one, duration=duration, rate=FINE)
    v, a, yaw_rate = misfit(drive)
    assert v < 1e-3
    assert a < 1e-9
    assert yaw_rate < 5e-2
    ways = np.linspace(0.0, curve.length, 2000)
    x, y, _, _ = curve.at(ways)
    nearest = np.abs((x + 1j * y)[:, None] - (points[:, 0] + 1j * points[:, 1])).min(axis=0)
    assert nearest.max() < curve.length / 2000.0


def test_on_an_arc_the_way_is_that_of_a_circle() -> None:
    drive = made(MOTORWAY, lanes("ego", "2", -2, 470.0, 20.0), duration=5.0)
    radius = 900.0 + 1.5 * 3.75
    assert drive.tracks.yaw_rate == pytest.approx(np.full((1, 126), 20.0 / radius), rel=1e-9)
    turned = float(np.ptp(drive.tracks.heading))
    assert turned * radius == pytest.approx(100.0, abs=1e-8)


@pytest.mark.parametrize(("to", "lane"), [("left", -1), ("right", -3)])
def test_a_lane_change_begins_ends_and_crosses_where_the_truth_says(to: str, lane: int) -> None:
    change = {"to": to, "at": 60.0, "seconds": 4.0}
    drive = made(MOTORWAY, lanes("ego", "2", -2, 400.0, 30.0, change=[change]), duration=8.0, rate=FINE)
    (row,) = [row for row in drive.maneuvers if row.label.startswith("lane_change")]
    assert (row.label, row.lane_from, row.lane_to) == (f"lane_change_{to}", "2/-2", f"2/{lane}")
    assert (row.start, row.end) == (pytest.approx(2.0, abs=1e-6), pytest.approx(6.0, abs=1e-6))
    k = drive.tracks
    at = MOTORWAY.to_road(k.x[0], k.y[0], heading=k.heading[0])
    assert k.t[np.flatnonzero(at.lane != -2)[0]] == pytest.approx(row.t, abs=1.5 / FINE)
    moves = np.flatnonzero(np.abs(at.t) > 1e-6)
    before = (k.t < 2.0 - 1e-9) | (k.t > 6.0 + 1e-9)
    assert np.abs(at.t[before]).max() < 1e-6
    assert k.t[moves[0]] < 2.1


def test_a_lane_change_goes_on_over_a_border_of_roads() -> None:
    change = {"to": "left", "at": 10.0, "metres": 90.0}
    drive = made(MOTORWAY, lanes("ego", "1", -3, 300.0, 20.0, change=[change]), duration=9.0, rate=FINE)
    assert misfit(drive)[0] < 1e-4
    (row,) = drive.maneuvers
    assert (row.lane_from, row.lane_to) == ("1/-3", "101/-2")
    assert 20.0 * (row.end - row.start) == pytest.approx(90.0, abs=1e-6)


def test_turns_standing_and_reversing() -> None:
    drive = made(
        URBAN,
        lanes("ego", "1", -1, 240.0, 8.0, route={"via": ["102"]}),
        lanes("waits", "3", -1, 300.0, {"times": [0.0, 2.0, 4.0, 6.0], "values": [5.0, 0.0, 0.0, 5.0]}),
        lanes("back", "4", 1, 200.0, 3.0, reverse=True, route={"against": True}),
        duration=14.0,
    )
    labels = {(row.object, row.label): row for row in drive.maneuvers}
    turn = labels["ego", "turn_left"]
    assert (turn.lane_from, turn.lane_to) == ("1/-1", "4/-1")
    assert (turn.start, turn.end) == (
        pytest.approx(60.0 / 8.0),
        pytest.approx(60.0 / 8.0 + _length("102") / 8.0, rel=1e-2),
    )
    stands = labels["waits", "standing"]
    assert (stands.start, stands.end) == (2.0, 4.0)
    k = drive.tracks
    assert (k.v[k.index("back")] == -3.0).all()
    assert np.abs(np.angle(np.exp(1j * (k.heading[k.index("back")] + 0.5 * np.pi)))).max() < 1e-9


def _length(road: str) -> float:
    x, y = URBAN.to_xy(road, -1, np.linspace(0.0, URBAN.roads[road].length, 1000), 0.0)
    return float(np.hypot(np.diff(x), np.diff(y)).sum())


def test_speeds_over_the_way_brake_and_stop_there() -> None:
    profile = {"ways": [20.0, 60.0], "values": [10.0, 0.0]}
    drive = made(URBAN, lanes("ego", "5", -1, 10.0, profile), duration=20.0)
    k = drive.tracks
    assert k.a is not None
    assert k.x[0, -1] == pytest.approx(k.x[0, 0] + 60.0, abs=1e-9)
    assert k.v[0, -1] == 0.0
    assert np.unique(np.round(k.a[0], 9)).tolist() == [-1.25, 0.0]


@pytest.mark.parametrize(
    ("objects", "told"),
    [
        ([lanes("ego", "77", -1, 0.0, 10.0)], "object 'ego': route: there is no road '77'; the map has 1, 2, 3"),
        ([lanes("ego", "1", -7, 0.0, 10.0)], "has no lane -7 at s = 0 m; it has -1, -2, -3, -4"),
        ([lanes("ego", "3", -1, 1000.0, 80.0)], "the EGO is there from 0 to"),
        ([lanes("ego", "1", -1, 0.0, 10.0, change=[{"to": "left", "t": 1.0, "seconds": 3.0}])],
         "change.0: there is no lane 1 to the left of lane -1"),
        ([lanes("ego", "1", -2, 0.0, 0.0, change=[{"to": "left", "t": 1.0, "seconds": 3.0}])],
         "change.0: the object moves 0.00 m during it"),
        ([lanes("ego", "2", -4, 200.0, 30.0, change=[{"to": "left", "t": 1.0, "seconds": 6.0}])],
         "its two lanes no longer lead along each other"),
        ([lanes("ego", "1", -1, 50.0, 10.0), lanes("b", "1", -1, 30.0, 14.0)], "object 'ego': overlaps 'b' from t = "),
        ([lanes("ego", "1", -1, 0.0, {"times": [0.0, 0.0], "values": [1.0, 2.0]})], "speed: times must increase"),
        ([lanes("ego", "1", -1, 0.0, 1.0, route={"via": ["2"]})], "via: road '2' is none inside of a junction"),
    ],
)  # fmt: skip
def test_what_is_impossible_is_refused_with_object_and_field(
    objects: list[dict[str, Any]], told: str
) -> None:
    with pytest.raises(ResimError) as e:
        made(MOTORWAY, *objects)
    assert told in str(e.value)


def test_overlaps_are_allowed_where_they_are_asked_for() -> None:
    two = lanes("ego", "1", -1, 50.0, 10.0), lanes("b", "1", -1, 30.0, 14.0)
    drive = made(MOTORWAY, *two, overlaps=[("b", "ego")])
    assert len(drive.tracks) == 2
