"""Which lane goes on into which: the lane links of an OpenDRIVE map as a graph in driving direction."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

from resim.road.opendrive import Connection, Link, Road, RoadNetwork


class LaneKey(NamedTuple):
    """A lane of one lane section: road id, index of the section, lane id."""

    road: str
    section: int
    lane: int

    def __str__(self) -> str:
        return f"road {self.road} section {self.section} lane {self.lane}"


class _End(NamedTuple):
    """One end of a road: "start" or "end"."""

    road: str
    at: str


Graph = Mapping[LaneKey, tuple[LaneKey, ...]]


def lane_graph(network: RoadNetwork) -> dict[LaneKey, tuple[LaneKey, ...]]:
    """Give for every lane the lanes it goes on into, in driving direction, as the file links them.

    Links count from whichever side names them. A link to a lane that does not exist, or that is driven the
    other way, is none. Lane 0 is no lane here; lanes without a way on have an empty entry.
    """
    found: dict[LaneKey, dict[LaneKey, None]] = {
        LaneKey(road.id, k, lane): {}
        for road in network.roads.values()
        for k, section in enumerate(road.sections)
        for lane in section.lanes
        if lane != 0
    }
    for one, other in _pairs(network):
        if one in found and other in found:
            found[one][other] = None
    return {key: tuple(after) for key, after in found.items()}


def ways(graph: Graph, start: LaneKey, inside: Collection[str]) -> Iterator[tuple[LaneKey, ...]]:
    """Give the way on from a lane through roads `inside` (a junction's) to every lane outside that it leads to.

    Each way holds the lanes passed inside, then the one outside. Of several to one lane it is the first that the
    file names: there may be exponentially many.
    """
    before: dict[LaneKey, LaneKey] = {}
    stack = [(after, start) for after in reversed(graph[start])]
    while stack:
        key, origin = stack.pop()
        if key in before:
            continue
        before[key] = origin
        if key.road in inside:
            stack += [(after, key) for after in reversed(graph[key])]
            continue
        way = [key]
        while (origin := before[way[-1]]) != start:
            way.append(origin)
        yield tuple(reversed(way))


def passed_lanes(network: RoadNetwork, graph: Graph) -> frozenset[LaneKey]:
    """Give the lanes inside of junctions over which one can drive from a road outside to another."""
    inside = {road.id for road in network.roads.values() if road.junction is not None}
    back: dict[LaneKey, list[LaneKey]] = {key: [] for key in graph}
    for key, after in graph.items():
        for other in after:
            back[other].append(key)
    return _inside_from(graph, inside) & _inside_from(back, inside)


def _inside_from(graph: Mapping[LaneKey, Sequence[LaneKey]], inside: Collection[str]) -> frozenset[LaneKey]:
    """The lanes of the roads inside that the graph leads to from lanes outside."""
    found: set[LaneKey] = set()
    todo = [key for key in graph if key.road not in inside]
    while todo:
        new = {after for after in graph[todo.pop()] if after.road in inside} - found
        found |= new
        todo += new
    return frozenset(found)


def inner_roads(network: RoadNetwork, passed: Collection[LaneKey]) -> frozenset[str]:
    """Give the roads of junctions on which one can drive from a road outside to another (`passed_lanes`).

    A junction's road whose driving lanes all lead nowhere, or come from nowhere, is not among them.
    """
    inside = {road.id for road in network.roads.values() if road.junction is not None}
    through = {key.road for key in passed}
    return frozenset(name for name in inside if name in through or not _drivable(network.roads[name]))


def _drivable(road: Road) -> bool:
    return any(lane.drivable and lane.id != 0 for section in road.sections for lane in section.lanes.values())


def _pairs(network: RoadNetwork) -> Iterator[tuple[LaneKey, LaneKey]]:
    """Every linked pair of lanes, the one driven first in front; some name lanes that do not exist."""
    for road in network.roads.values():
        yield from _within(road)
        for at, link in (("start", road.predecessor), ("end", road.successor)):
            yield from _between(network, _End(road.id, at), link)
    for junction in network.junctions.values():
        for connection in junction.connections:
            yield from _through(network, junction.id, connection)


def _within(road: Road) -> Iterator[tuple[LaneKey, LaneKey]]:
    for k, (before, after) in enumerate(pairwise(road.sections)):
        links: list[tuple[int | None, int | None]] = [
            (lane.id, lane.successor) for lane in before.lanes.values()
        ]
        links += [(lane.predecessor, lane.id) for lane in after.lanes.values()]
        for one, other in dict.fromkeys(links):
            if one and other and road.along(one, k) == road.along(other, k + 1):
                pair = LaneKey(road.id, k, one), LaneKey(road.id, k + 1, other)
                yield pair if road.along(one, k) else pair[::-1]


def _between(network: RoadNetwork, end: _End, link: Link | None) -> Iterator[tuple[LaneKey, LaneKey]]:
    """Lane links over a link from road to road, end to end: one into the middle of a road joins no lanes."""
    if link is None or link.kind != "road" or link.s is not None or link.id not in network.roads:
        return
    road, other = network.roads[end.road], network.roads[link.id]
    contact = link.contact or ("start" if end.at == "end" else "end")
    for lane in road.sections[_last(road, end)].lanes.values():
        target = lane.successor if end.at == "end" else lane.predecessor
        if target is not None:
            yield from _joined(road, end, lane.id, other, _End(other.id, contact), target)


def _through(
    network: RoadNetwork, junction: str, connection: Connection
) -> Iterator[tuple[LaneKey, LaneKey]]:
    """Lane links of a connection, at the end of the incoming road that meets the junction."""
    road, other = (network.roads.get(name) for name in (connection.incoming, connection.connecting))
    if road is None or other is None:
        return
    into = _End(other.id, connection.contact)
    for at in _meeting(road, junction, other, into):
        end = _End(road.id, at)
        for lane, target in connection.lane_links or _alike(road, end, other, into):
            yield from _joined(road, end, lane, other, into, target)


def _alike(road: Road, end: _End, other: Road, into: _End) -> list[tuple[int, int]]:
    """What a connection without lane links means: lanes of the same id, mirrored where equal ends meet.

    Not so where lanes of the connecting road say from which lanes of this one they come.
    """
    back = other.predecessor if into.at == "start" else other.successor
    lanes = other.sections[_last(other, into)].lanes.values()
    if back is not None and back.kind == "road" and back.id == road.id and (
        any((lane.predecessor if into.at == "start" else lane.successor) is not None for lane in lanes)
    ):  # fmt: skip
        return []
    sign = -1 if end.at == into.at else 1
    there = other.sections[_last(other, into)].lanes
    return [(lane, sign * lane) for lane in road.sections[_last(road, end)].lanes if sign * lane in there]


def _meeting(road: Road, junction: str, other: Road, into: _End) -> list[str]:
    """The ends of the road that meet the junction; of two, the one that the connecting road names."""
    ends = [
        at for at, link in (("start", road.predecessor), ("end", road.successor))
        if link is not None and link.kind == "junction" and link.id == junction
    ]  # fmt: skip
    back = other.predecessor if into.at == "start" else other.successor
    named = back.contact if back is not None and back.kind == "road" and back.id == road.id else None
    if named is not None and (not ends or named in ends):
        return [named]
    return ends


def _joined(
    road: Road, end: _End, lane: int, other: Road, into: _End, target: int
) -> Iterator[tuple[LaneKey, LaneKey]]:
    """The pair of lanes that meet where two roads' ends do, if traffic can go from one to the other."""
    if lane == 0 or target == 0:
        return
    leaves = road.along(lane, _last(road, end)) == (end.at == "end")
    enters = other.along(target, _last(other, into)) == (into.at == "start")
    if leaves != enters:
        return
    pair = LaneKey(road.id, _last(road, end), lane), LaneKey(other.id, _last(other, into), target)
    yield pair if leaves else pair[::-1]


def _last(road: Road, end: _End) -> int:
    return len(road.sections) - 1 if end.at == "end" else 0
