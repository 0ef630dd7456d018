"""From resim's table of lanes to what a planner in lane coordinates needs: a reference path, and the road's edge."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import shapely

from resim.function import MapLane, RunSetup

DRIVABLE = ("driving", "entry", "exit", "onRamp", "offRamp", "connectingRamp")
AHEAD, BEHIND = 2000.0, 300.0
"""m of the reference path ahead of the start and behind it; where the map ends, it goes on straight."""
GAP = 0.1
"""m: narrower gaps between lanes are flaws of the map, and no edge of the road."""


Way = list[tuple[int, int]]
"""Lanes one after the other by their numbers; where the two of a pair differ, the lane is changed along them."""


def reference_lanes(setup: RunSetup) -> Way:
    """The lanes from behind the start to ahead of it: that at the start, then along the route."""
    lanes, here = setup.road.lanes, _lane_at(setup)
    before: list[tuple[int, ...]] = [() for _ in lanes]
    for k, lane in enumerate(lanes):
        for later in lane.after:
            before[later] += (k,)
    behind = _way(setup, here, before, BEHIND)
    return behind[:0:-1] + _way(setup, here, [lane.after for lane in lanes], AHEAD, change=True)


def _way(
    setup: RunSetup, here: int, after: Sequence[Sequence[int]], far: float, *, change: bool = False
) -> Way:
    """The way for `far` m: on the route, else where it turns least. change: to a lane that stays on the route."""
    lanes, on_route = setup.road.lanes, {road for step in setup.route for road in step}
    ends = setup.route[-1] if setup.route else ()
    way, passed, length = [(here, here)], {here}, 0.0

    def further(k: int) -> list[int]:
        found = [n for n in after[k] if n not in passed and lanes[n].type in DRIVABLE]
        return sorted(found, key=lambda n: (lanes[n].road not in on_route, _turn(lanes[k], lanes[n])))

    while length < far:
        k = way[-1][1]
        found = further(k)
        if change and lanes[k].road in on_route and lanes[k].road not in ends:
            beside = [n for n, lane in enumerate(lanes) if _section(lane) == _section(lanes[k])]
            beside = [n for n in beside if any(lanes[m].road in on_route for m in further(n))]
            if beside and k not in beside:
                n = min(beside, key=lambda n: abs(lanes[n].lane - lanes[k].lane))
                way[-1], found = (way[-1][0], n), further(n)
        if not found:
            break
        way.append((found[0], found[0]))
        passed.add(found[0])
        length += float(np.hypot(*np.diff(lanes[found[0]].centre, axis=0).T).sum())
    return way


def reference_path(setup: RunSetup, way: Way) -> Any:
    """The centre of these lanes in driving direction (K, 2) [m], straight on where the map ends."""
    points = np.concatenate([_centre(setup.road.lanes, *pair) for pair in way])
    apart = np.hypot(*np.diff(points, axis=0).T)
    points = points[np.concatenate([[True], apart > 0.2])]
    step = np.arange(1.0, 101.0)[:, None] * 3.0
    first, last = _direction(points[:2]), _direction(points[-2:])
    return np.concatenate([points[0] - (first * step)[::-1], points, points[-1] + last * step])


def _centre(lanes: list[MapLane], one: int, other: int) -> Any:
    """The centre of a lane, or the way from one to another beside it, smoothly along the whole of them."""
    a = driven(lanes[one], "centre")
    if one == other:
        return a
    share = np.linspace(0.0, 1.0, len(a))
    b = driven(lanes[other], "centre")
    b = np.column_stack([np.interp(share, np.linspace(0.0, 1.0, len(b)), b[:, i]) for i in (0, 1)])
    weight = (share**3 * (10.0 - 15.0 * share + 6.0 * share**2))[:, None]
    return (1.0 - weight) * a + weight * b


def road_edge(setup: RunSetup, way: Way) -> list[tuple[Any, Any]]:
    """Stretches of the road's edge, from point to point (2,) [m].

    The road is all lanes on which the EGO may drive; the oncoming ones of the roads on its path are not among them.
    Where the map ends, the road does not: it goes on straight.
    """
    lanes = setup.road.lanes
    along = {lanes[k].road: lanes[k].along for k, _ in way}
    own = [
        k for k, lane in enumerate(lanes) if lane.type in DRIVABLE and along.get(lane.road, lane.along) == lane.along
    ]  # fmt: skip
    reached = {later for lane in lanes for later in lane.after}
    goes_on = {_section(lanes[k]) for k in own if lanes[k].after}
    comes_from = {_section(lanes[k]) for k in own if k in reached}
    areas = []
    for k in own:
        left, right = driven(lanes[k], "left"), driven(lanes[k], "right")
        if _section(lanes[k]) not in goes_on:
            far = 300.0 * _direction(driven(lanes[k], "centre")[-2:])
            left, right = np.vstack([left, left[-1] + far]), np.vstack([right, right[-1] + far])
        if _section(lanes[k]) not in comes_from:
            far = 300.0 * _direction(driven(lanes[k], "centre")[:2])
            left, right = np.vstack([left[0] - far, left]), np.vstack([right[0] - far, right])
        areas.append(shapely.Polygon(np.vstack([left, right[::-1]])).buffer(GAP, join_style="mitre"))
    road = shapely.union_all(areas).buffer(-GAP, join_style="mitre").simplify(0.01)
    rings = [ring for area in getattr(road, "geoms", [road]) for ring in (area.exterior, *area.interiors)]
    return [pair for ring in rings for pair in pairwise(np.array(ring.coords))]


def driven(lane: MapLane, line: str) -> Any:
    """A line of a lane in driving direction (K, 2) [m]; left and right as who drives there sees them."""
    if lane.along:
        return getattr(lane, line)
    return getattr(lane, {"left": "right", "right": "left"}.get(line, line))[::-1]


def _lane_at(setup: RunSetup) -> int:
    """Number of the lane at the start: of those driven in about the EGO's direction the nearest, on its route."""
    start, on_route = setup.start, {road for step in setup.route[:1] for road in step}
    best: tuple[bool, float, int] | None = None
    for k, lane in enumerate(setup.road.lanes):
        if lane.type not in DRIVABLE:
            continue
        centre = driven(lane, "centre")
        line = shapely.LineString(centre)
        at = line.project(shapely.Point(start.x, start.y))
        ends = np.array([line.interpolate(at + ds).coords[0] for ds in (-0.5, 0.5)])
        if _direction(ends) @ (np.cos(start.heading), np.sin(start.heading)) < 0.5:
            continue
        found = (lane.road not in on_route, line.distance(shapely.Point(start.x, start.y)), k)
        best = found if best is None else min(best, found)
    if best is None:
        raise ValueError(f"there is no lane at x = {start.x:.1f} m, y = {start.y:.1f} m")
    return best[2]


def _turn(one: MapLane, other: MapLane) -> float:
    """How much a lane turns on the whole, against the direction of the one before [rad]."""
    a = _direction(driven(one, "centre")[-2:])
    b = _direction(driven(other, "centre")[[0, -1]])
    return float(np.arccos(np.clip(a @ b, -1.0, 1.0)))


def _section(lane: MapLane) -> tuple[str, int]:
    return lane.road, lane.section


def _direction(points: Any) -> Any:
    """Unit vector (2,) from the first of the points to the last."""
    way = points[-1] - points[0]
    return way / np.hypot(*way)
