"""Follows a lane over lane links, road links and junctions, ahead and back."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from resim.core.geometry import wrap_angle
from resim.road.driven_route import NO_ROUTE, Route
from resim.road.opendrive import Lane, Link, Road, RoadNetwork

LOOK = 40.0
SHORTEST = 1e-6
INSIDE = 1e-8
MOST_STRETCHES = 10_000


@dataclass(frozen=True)
class RouteStretch:
    """A lane of one lane section from s_from to s_to [m], in the order in which the route passes it."""

    road: str
    section: int
    lane: int
    s_from: float
    s_to: float

    @property
    def length(self) -> float:
        """Length along the reference line [m]."""
        return abs(self.s_to - self.s_from)


def follow(
    net: RoadNetwork, road: str, lane: int, s: float, *, ahead: bool, route: Route = NO_ROUTE
) -> Iterator[RouteStretch]:
    """Give the stretches from (road, lane, s) on in driving direction, or against it, till the road ends.

    A link that the file leaves out is taken as to the lane of the same id (mirrored where two roads meet
    with equal ends). Of several ways one that is on the route, if there is one; of several still the one that turns
    least over its first 40 m, then the first in the file. Ends at a lane that is not driven on or the other way round.
    A loop goes on for ever.
    """
    own = net.roads[road]
    section = own.section_index(min(max(s, 0.0), own.length))
    up = own.along(lane, section) == ahead
    at = s
    for _ in range(MOST_STRETCHES):
        border = _border(own, section, up)
        if abs(border - at) > SHORTEST:
            yield RouteStretch(own.id, section, lane, at, border)
        following = _next(net, own, section, lane, up, route if ahead else NO_ROUTE)
        if following is None:
            return
        own, section, lane, up = following
        at = _border(own, section, not up)


def _border(road: Road, section: int, up: bool) -> float:
    """Where one leaves the section, a hair inside of it."""
    here = road.sections[section]
    if not up:
        return min(here.start, road.length)
    last = section == len(road.sections) - 1
    return road.length if last else min(max(here.end - INSIDE, here.start), road.length)


def _next(
    net: RoadNetwork, road: Road, section: int, lane: int, up: bool, route: Route
) -> tuple[Road, int, int, bool] | None:
    index = section + (1 if up else -1)
    here = road.sections[section].lanes[lane]
    linked = here.successor if up else here.predecessor
    if 0 <= index < len(road.sections):
        target = lane if linked is None else linked
        return (
            (road, index, target, up) if _passable(road, index, target, road.along(lane, section)) else None
        )
    link = road.successor if up else road.predecessor
    if link is None:
        return None
    ways = list(dict.fromkeys(_ways(net, road, lane, linked, up, link)))
    good = [way for way in ways if _continues(net, road.along(lane, section) == up, way)]
    if not good:
        return None
    on_route = route.after(road.id)
    good = [way for way in good if way[0] in on_route] or good
    if len(good) > 1:
        good.sort(key=lambda way: _turn(net, road, section, lane, up, way))
    name, target, into = good[0]
    other = net.roads[name]
    return other, 0 if into else len(other.sections) - 1, target, into


LaneEntry = tuple[str, int, bool]
"""Road, lane, and whether it is entered at its start."""


def _ways(
    net: RoadNetwork, road: Road, lane: int, linked: int | None, up: bool, link: Link
) -> Iterator[LaneEntry]:
    """Every way on from the road's end (up) or start along the link; none into the middle of a road."""
    if link.s is not None:
        return
    if link.kind == "road":
        into = link.contact != "end" if link.contact else up
        target = linked if linked is not None else lane if into == up else -lane
        yield link.id, target, into
        return
    junction = net.junctions.get(link.id)
    for connection in junction.connections if junction else ():
        if connection.incoming == road.id:
            into = connection.contact == "start"
            targets = [to for start, to in connection.lane_links if start == lane]
            if not connection.lane_links:
                targets = [lane if into == up else -lane]
            yield from ((connection.connecting, target, into) for target in targets)
    for other in net.roads.values():
        if other.junction == link.id:
            yield from _joining(other, road, lane, up)


def _joining(other: Road, road: Road, lane: int, up: bool) -> Iterator[LaneEntry]:
    """Lanes of a connecting road whose links name this lane at this end of the road."""
    for end, link in ((True, other.predecessor), (False, other.successor)):
        if link is None or link.kind != "road" or link.id != road.id:
            continue
        if link.contact is not None and (link.contact == "end") != up:
            continue
        for candidate in other.sections[0 if end else -1].lanes.values():
            if (candidate.predecessor if end else candidate.successor) == lane and candidate.id != 0:
                yield other.id, candidate.id, end


def _continues(net: RoadNetwork, ahead: bool, way: LaneEntry) -> bool:
    name, target, into = way
    other = net.roads.get(name)
    if other is None:
        return False
    return _passable(other, 0 if into else -1, target, into == ahead)


def _passable(road: Road, section: int, lane: int, along: bool) -> bool:
    """Whether vehicles drive on the lane in (along) or against the direction of s."""
    found: Lane | None = road.sections[section].lanes.get(lane)
    return found is not None and lane != 0 and found.drivable and road.along(lane, section) == along


def _turn(net: RoadNetwork, road: Road, section: int, lane: int, up: bool, way: LaneEntry) -> float:
    """How far [rad] the way turns from the lane's heading over its first 40 m."""
    name, target, into = way
    other = net.roads[name]
    here = float(net.lane_heading(road.id, lane, _border(road, section, up)))
    index = 0 if into else len(other.sections) - 1
    start, end = _border(other, index, not into), _border(other, index, into)
    there = start + np.clip(end - start, -LOOK, LOOK)
    return round(abs(float(wrap_angle(float(net.lane_heading(name, target, there)) - here))), 6)
