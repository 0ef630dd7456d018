"""Routes through junctions of maps that others made: oracles are the files' links and shapely's polygons."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from turns import driven, turns

from resim.road.driven_route import Route, driven_route, first_off_route
from resim.road.path import lane_path

MAPS = (
    "xodr/esmini/fabriksgatan.xodr",
    "xodr/edge_cases/sumo_connections_4arm.xodr",
    "xodr/esmini/highway_example_with_merge_and_split.xodr",
    "xodr/edge_cases/od_newmarket.xodr",
)


def outlines(net, roads):
    shapes = [
        s
        for s in net.lane_shapes(0.25)
        if s.road in roads and net.roads[s.road].sections[s.section].lanes[s.lane].drivable
    ]
    return shapely.union_all(
        [shapely.Polygon(np.vstack([s.left, s.right[::-1]])).buffer(0.0) for s in shapes if len(s.left) > 1]
    )


def straight_on(turn):
    (before, _), _, (after, _) = turn
    return before[0], after[0]


@pytest.mark.parametrize("name", [*MAPS[:-1], pytest.param(MAPS[-1], marks=pytest.mark.slow)])
def test_the_route_of_a_turn_is_the_roads_that_the_file_links(shared_map, name):
    net = shared_map(name)
    every = list(turns(net))
    assert len(every) >= 2
    for turn in every:
        x, y, heading = driven(net, turn)
        route = driven_route(net, x, y, heading)
        side_by_side = {t[1][0] for t in every if straight_on(t) == straight_on(turn)}
        first, *inside, last = route.steps
        assert (first, last) == ((turn[0][0][0],), (turn[2][0][0],))
        assert set().union(*inside) == side_by_side
        assert first_off_route(net, route, x, y, heading) is None
        assert route.after(first[0]) >= {turn[1][0]}


@pytest.mark.parametrize("name", MAPS)
def test_who_turns_another_way_leaves_the_route_where_its_lanes_end(shared_map, name):
    net, others = shared_map(name), 0
    every = list(turns(net))
    for turn in every[:: len(every) // 12 + 1]:
        x, y, heading = driven(net, turn)
        route = driven_route(net, x, y, heading)
        surface = outlines(net, route.roads)
        for other in [t for t in every if t[0] == turn[0] and straight_on(t) != straight_on(turn)]:
            x, y, heading = driven(net, other)
            left = first_off_route(net, route, x, y, heading)
            assert left is not None, (turn, other)
            off = np.flatnonzero(~shapely.contains_xy(surface, x, y))[0]
            assert (
                left >= off - 2
            )  # m: where a connecting road of 1 m fans out, a place is ahead of it or on it
            # where it is later, there was no other road's driving lane under the drive until then
            assert left <= off + 3 or not net.to_road(x[off:left], y[off:left]).on_road.any()
            others += 1
    assert others or "merge" in name  # whose every lane leads one way


def test_who_ends_before_inside_or_behind_the_junction(shared_map):
    net = shared_map(MAPS[0])
    every = list(turns(net))
    for turn in every:
        x, y, heading = driven(net, turn)
        inside = np.flatnonzero(np.isin(net.to_road(x, y, heading=heading).road, [t[1][0] for t in every]))
        before, middle = inside[0] - 3, (inside[0] + 2 * inside[-1]) // 3
        short = driven_route(net, x[:before], y[:before], heading[:before])
        assert short.steps == ((turn[0][0][0],),)
        assert first_off_route(net, short, x, y, heading) is None  # on over the end of the route
        half = driven_route(net, x[:middle], y[:middle], heading[:middle])
        assert first_off_route(net, half, x, y, heading) is None
        late = driven_route(net, x[middle:], y[middle:], heading[middle:])
        assert late.steps[-1] == (turn[2][0][0],)
        assert first_off_route(net, late, x[middle:], y[middle:], heading[middle:]) is None


def test_who_ended_inside_of_a_junction_tells_which_turn_he_took(shared_map):
    net = shared_map(MAPS[0])
    every = list(turns(net))
    found = 0
    for turn in every:
        x, y, heading = driven(net, turn)
        end = np.flatnonzero(net.to_road(x, y, heading=heading).road == turn[1][0])[-1]
        half = driven_route(net, x[:end], y[:end], heading[:end])
        for other in [t for t in every if t[0] == turn[0] and straight_on(t) != straight_on(turn)]:
            xo, yo, ho = driven(net, other)
            found += first_off_route(net, half, xo, yo, ho) is not None
    assert found > 0


def test_a_lane_path_turns_off_where_the_route_does(shared_map):
    net = shared_map(MAPS[0])
    turned = 0
    for turn in turns(net):
        x, y, heading = driven(net, turn)
        route = driven_route(net, x, y, heading)
        at = net.to_road(x[:1], y[:1], heading=heading[:1])
        start = str(at.road[0]), int(at.lane[0]), float(at.s[0])
        length = float(np.hypot(np.diff(x), np.diff(y)).sum())
        path = lane_path(net, *start, length, behind=0.0, route=route)
        _, d = path.project(x, y)
        assert np.abs(d).max() < 0.2, turn
        _, off = lane_path(net, *start, length, behind=0.0).project(x, y)
        turned += np.abs(off).max() > 5.0
    assert turned  # without a route it goes straight on


def test_parallel_lanes_belong_to_the_route_and_nobody_leaves_an_unknown_one(proving_ground):
    s = np.arange(300.0, 800.0, 5.0)
    x, y = proving_ground.to_xy("1", -2, s, 0.0)
    heading = proving_ground.lane_heading("1", -2, s)
    route = driven_route(proving_ground, x, y, heading)
    assert route == Route((("1",),))
    x, y = proving_ground.to_xy("1", -1, s, 0.0)
    assert first_off_route(proving_ground, route, x, y, heading) is None
    far = proving_ground.to_xy("2", -1, s[:50], 0.0)
    assert first_off_route(proving_ground, route, *far, heading[:50]) == 0
    assert first_off_route(proving_ground, Route(), *far, heading[:50]) is None
    off_road = driven_route(proving_ground, x + 1e5, y, heading)
    assert off_road == Route()


def one_after_the_other(*drives):
    return np.concatenate(drives, axis=1)


def test_who_turns_round_and_goes_elsewhere_has_left_it(shared_map):
    """On the last road of the route, by the whole of it or alone."""
    net, found = shared_map(MAPS[0]), 0
    every = list(turns(net))
    for first in every:
        for second in every:
            if first[2][0][0] != second[0][0][0] or second[2][0][0] == first[0][0][0]:
                continue
            there, back = driven(net, first), driven(net, second)
            route = driven_route(net, *there)
            left = first_off_route(net, route, *one_after_the_other(there, back))
            assert left is not None
            assert left >= there.shape[1]
            on = net.to_road(there[0], there[1], heading=there[2]).road == second[0][0][0]
            alone = there[:, on]
            assert (
                first_off_route(net, driven_route(net, *alone), *one_after_the_other(alone, back)) is not None
            )
            found += 1
    assert found


def test_who_turns_off_at_the_first_pass_as_the_route_does_at_the_second_has_left_it(shared_map):
    net, found = shared_map(MAPS[0]), 0
    every = list(turns(net))
    for one in every:
        for other in every:
            if one[0] != other[0] or one[2][0] == other[2][0]:
                continue
            twice = one_after_the_other(driven(net, one), driven(net, other))
            route = driven_route(net, *twice)
            assert first_off_route(net, route, *twice) is None
            assert first_off_route(net, route, *driven(net, other)) is not None
            found += 1
    assert found


def on_a_road(net, name, lane, start, end):
    """Positions and headings along the lane's centre, 1 m apart."""
    s = np.arange(start, end, 1.0 if end > start else -1.0)
    x, y = net.to_xy(name, lane, s, 0.0)
    return np.array([x, y, np.resize(net.lane_heading(name, lane, s), len(s))])


def test_who_comes_to_a_later_road_by_another_way_has_left_it(shared_map):
    """Round a block, and by a connecting road past it: it lies on others that are on the route."""
    net = shared_map("xodr/edge_cases/od_newmarket.xodr")
    names = ["55", "313", "38", "320", "30", "331", "25", "300", "40", "288", "26", "342", "31", "337", "24"]
    every = {turn[1][0]: turn for turn in turns(net)}
    whole = one_after_the_other(*(driven(net, every[name], 1e3) for name in names[1::2]))
    route = driven_route(net, *whole)
    assert route.steps == tuple((name,) for name in names)
    assert first_off_route(net, route, *whole) is None
    there = [driven(net, every[name], 1e3) for name in ("313", "320")]
    for by in ("332", "333"):
        other = driven(net, every[by])
        left = first_off_route(net, route, *one_after_the_other(*there, other))
        assert left is not None
        assert left >= sum(drive.shape[1] for drive in there) + 30


def test_who_turns_off_where_the_route_passes_its_last_road_for_the_first_time_has_left_it(shared_map):
    net, found = shared_map("xodr/edge_cases/od_newmarket.xodr"), 0
    every = [turn for turn in turns(net) if {turn[0][0][0], turn[2][0][0]} <= {"40", "41", "42"}]
    for first in every:
        for second in every:
            if first[0][0][0] != "40" or first[2][0][0] != second[0][0][0] or second[2][0][0] != "40":
                continue
            loop = one_after_the_other(driven(net, first, 1e3), driven(net, second, 1e3))
            route = driven_route(net, *loop)
            assert route.steps[0] == route.steps[-1] == ("40",)
            for other in every:
                if other[0] == first[0] and other[2][0][0] != first[2][0][0]:
                    assert first_off_route(net, route, *driven(net, other, 1e3)) is not None
                    found += 1
    assert found


def test_the_end_of_a_route_is_where_who_turned_round_was_going(shared_map):
    net = shared_map(MAPS[0])
    length = net.roads["3"].length
    turn = next(t for t in turns(net) if t[0][0][0] == "3")
    (_, contact), lane = turn[0]
    assert contact == "end"  # it goes with s to the junction
    away = on_a_road(net, "3", lane, 5.0, 0.8 * length)
    back = on_a_road(net, "3", -lane, 0.8 * length, 0.4 * length)
    route = driven_route(net, *one_after_the_other(away, back))
    assert route == Route((("3",),), onwards=False)
    assert first_off_route(net, route, *driven(net, turn)) is not None


@pytest.mark.parametrize(
    ("before", "angle"),
    [pytest.param(*at, marks=pytest.mark.slow) for at in ((15.0, -60.0), (6.0, 90.0), (25.0, 110.0))],
)
def test_who_leaves_its_last_road_over_a_field_has_left_it(shared_map, before, angle):
    found = 0
    for net in map(shared_map, (*MAPS, "xodr/esmini/highway_exit.xodr")):
        for turn in turns(net):
            (name, contact), lane = turn[2]
            length = net.roads[name].length
            if length < 2.0 * before:
                continue
            route = driven_route(net, *driven(net, turn))
            ends = (0.5, length - before) if contact == "start" else (length - 0.5, before)
            last = on_a_road(net, name, lane, *ends)
            x, y, heading = last[:, -1]
            away, turned = np.arange(1.0, 60.0), heading + np.radians(angle)
            field = [x + away * np.cos(turned), y + away * np.sin(turned), np.full(len(away), turned)]
            drive = one_after_the_other(driven(net, turn, 1.0), last, np.array(field))
            at = net.to_road(drive[0], drive[1])
            if (at.on_road & ~np.isin(at.road, route.roads))[-len(away) :].any():
                assert first_off_route(net, route, *drive) is not None
                found += 1
    assert found > 3


def test_who_drives_its_own_route_has_not_left_it_however_rough_its_samples(shared_map):
    """From within a junction, where a drive brushes connecting roads that lie on its own."""
    net = shared_map("mcity/mcity.xodr")
    (turn,) = [turn for turn in turns(net) if turn[1][0] == "718"]
    way = driven(net, turn, 1e3)
    route = driven_route(net, *way)
    assert route.steps == (("718", "720", "729"), ("605",))
    for first in range(15):
        assert first_off_route(net, route, *way[:, first::15]) is None
