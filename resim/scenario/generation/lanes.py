"""Which lanes a route passes: a lane and what it goes on into, one way or the other, and the lane beside it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

from resim.core.errors import ResimError
from resim.road.driven_route import NO_ROUTE, Route
from resim.road.lane_following import RouteStretch, follow
from resim.road.opendrive import RoadNetwork

_INSIDE = 1e-8


class LanePlace(NamedTuple):
    """A place on a lane, and which way one goes there: up is along s."""

    road: str
    lane: int
    s: float
    up: bool


def route_over(network: RoadNetwork, via: Sequence[str]) -> Route:
    """Give a route that takes these roads of junctions where a lane leads to several. Raises ResimError."""
    steps = []
    for name in via:
        found = network.roads.get(name)
        links = (
            []
            if found is None
            else [link for link in (found.predecessor, found.successor) if link is not None]
        )
        if found is None or found.junction is None or not links:
            inside = ", ".join(road.id for road in network.roads.values() if road.junction is not None)
            raise ResimError(f"via: road {name!r} is none inside of a junction; those are {inside}")
        steps += [(tuple(link.id for link in links)), (name,)]
    return Route(tuple(steps)) if steps else NO_ROUTE


def stretches(network: RoadNetwork, start: LanePlace, route: Route) -> Iterator[RouteStretch]:
    """Give the stretches from a place on, until the road ends; a lane that nobody drives on ends with its road.

    Within each the reference line and all lanes are smooth: they are cut where an element or a cubic begins.
    """
    for whole in _whole_stretches(network, start, route):
        yield from _smooth(network, whole)


def _smooth(network: RoadNetwork, whole: RouteStretch) -> Iterator[RouteStretch]:
    road = network.roads[whole.road]
    section = road.sections[whole.section]
    records = [record.s for lane in section.lanes.values() for record in (*lane.widths, *lane.borders)]
    begins = (
        {section.start + s for s in records}
        | {g.s for g in road.geometries}
        | {r.s for r in road.lane_offsets}
    )
    low, high = sorted((whole.s_from, whole.s_to))
    inside = sorted(s for s in begins if low + 1e-6 < s < high - 1e-6)
    ends = [whole.s_from, *(inside if whole.s_to > whole.s_from else inside[::-1]), whole.s_to]
    for a, b in pairwise(ends):
        yield replace(whole, s_from=a, s_to=b)


def _whole_stretches(network: RoadNetwork, start: LanePlace, route: Route) -> Iterator[RouteStretch]:
    road, section = network.roads[start.road], network.roads[start.road].section_index(start.s)
    if road.sections[section].lanes[start.lane].drivable:
        ahead = road.along(start.lane, section) == start.up
        yield from follow(network, start.road, start.lane, start.s, ahead=ahead, route=route)
        return
    lane, at = start.lane, start.s
    while True:
        here = road.sections[section]
        border = (
            here.start if not start.up else road.length if here.end >= road.length else here.end - _INSIDE
        )
        if abs(border - at) > _INSIDE:
            yield RouteStretch(road.id, section, lane, at, border)
        own = here.lanes[lane]
        linked = own.successor if start.up else own.predecessor
        section += 1 if start.up else -1
        lane = lane if linked is None else linked
        if not 0 <= section < len(road.sections) or lane not in road.sections[section].lanes:
            return
        at = road.sections[section].start if start.up else road.sections[section].end - _INSIDE


def beside(network: RoadNetwork, place: LanePlace, lanes: int) -> int:
    """Give the id of the lane so many lanes to the left of a place (to the right: below 0), as one goes there.

    Raises ResimError where there is none; a lane that is driven the other way is one.
    """
    road = network.roads[place.road]
    there = road.sections[road.section_index(place.s)].lanes
    step = (1 if lanes > 0 else -1) * (1 if place.up else -1)
    lane = place.lane
    for _ in range(abs(lanes)):
        lane = lane + step or step  # over the centre line
        if lane not in there:
            side = "left" if lanes > 0 else "right"
            has = ", ".join(map(str, sorted(there, reverse=True)))
            raise ResimError(
                f"there is no lane {abs(lanes)} to the {side} of lane {place.lane} of road {place.road} at "
                f"s = {place.s:.1f} m, which has {has}"
            )
    return lane
