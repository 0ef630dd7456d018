"""Cuts the roads of a map into what become edges of the SUMO net, and finds the nodes where they meet."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import ceil
from typing import NamedTuple

from resim.road.links import LaneKey
from resim.road.opendrive import Junction, Link, Road, RoadNetwork

LONGEST = 100.0
"""Edges are cut to 50 to 100 m: SUMO's search for the lane at a position scans whole lanes."""

SHORTEST = 1e-6


@dataclass(frozen=True)
class Piece:
    """One edge: the lanes (rightmost first) of a stretch of a lane section that are driven one way.

    start, end: s [m], start < end; forward: driven along s. origin, target: nodes, in driving direction.
    """

    id: str
    road: str
    section: int
    start: float
    end: float
    forward: bool
    lanes: tuple[int, ...]
    origin: str
    target: str


@dataclass(frozen=True)
class Pieces:
    """All edges; of each lane of each section its edges in driving direction."""

    all: tuple[Piece, ...]
    of_lane: Mapping[LaneKey, tuple[Piece, ...]]


RoadEnd = tuple[str, bool]
"""A road and whether it is its end (else its start)."""


def cut(
    network: RoadNetwork, inside: Collection[str], passed: Collection[LaneKey],
    together: Collection[tuple[RoadEnd, RoadEnd]] = (),
) -> Pieces:  # fmt: skip
    """Give the pieces of all lanes but those `passed` inside of junctions, which become junction-internal lanes.

    inside: the roads of `passed`; their other lanes become edges by themselves, linked to nothing. together: ends of
    roads that are one node though no link of roads or junctions says so.
    """
    parts = {road.id: list(_parts(road)) for road in network.roads.values()}
    count = {name: len(own) for name, own in parts.items() if name not in inside}
    nodes = _Nodes(network, count, together)
    for name in count:
        if len(parts[name]) == 1 and nodes.name(name, 0) == nodes.name(name, 1):
            section, start, end = parts[name][0]
            middle = 0.5 * (start + end)
            parts[name] = [(section, start, middle), (section, middle, end)]  # SUMO has no edge in a loop
    nodes = _Nodes(network, {name: len(parts[name]) for name in count}, together)
    names = _safe_names(network.roads)
    pieces = [
        piece for road in network.roads.values()
        for piece in _pieces(road, names[road.id], parts[road.id], nodes, passed)
    ]  # fmt: skip
    of_lane: dict[LaneKey, list[Piece]] = defaultdict(list)
    for piece in pieces:
        for lane in piece.lanes:
            of_lane[LaneKey(piece.road, piece.section, lane)].append(piece)
    ordered = {key: tuple(own if own[0].forward else own[::-1]) for key, own in of_lane.items()}
    return Pieces(tuple(pieces), ordered)


def _parts(road: Road) -> Iterator[tuple[int, float, float]]:
    """Section, start and end of every part, in order of s."""
    for k, section in enumerate(road.sections):
        end = min(section.end, road.length)
        if end - section.start > SHORTEST:
            count = max(ceil((end - section.start) / LONGEST - 1e-9), 1)
            cuts = [section.start + (end - section.start) * i / count for i in range(count)]
            yield from ((k, low, high) for low, high in pairwise([*cuts, end]))


def _pieces(
    road: Road, name: str, parts: list[tuple[int, float, float]], nodes: _Nodes, passed: Collection[LaneKey]
) -> Iterator[Piece]:
    for i, (section, start, end) in enumerate(parts):
        own_lanes = (lane for lane in road.sections[section].lanes if lane != 0)
        lanes = [lane for lane in own_lanes if LaneKey(road.id, section, lane) not in passed]
        ends = nodes.name(road.id, i), nodes.name(road.id, i + 1)
        for forward in (True, False):
            own = sorted(
                (lane for lane in lanes if road.along(lane, section) == forward), reverse=not forward
            )
            if own:
                origin, target = ends if forward else ends[::-1]
                sign = "" if forward else "-"
                yield Piece(f"{sign}{name}.{i}", road.id, section, start, end, forward, tuple(own),
                            origin, target)  # fmt: skip


class _Border(NamedTuple):
    """A border between parts of a road, number 0 at its start; number -1: the junction of that id."""

    id: str
    number: int


class _Nodes:
    """Which borders of parts are one node: linked ends of roads, and all ends that meet one junction."""

    def __init__(
        self, network: RoadNetwork, count: Mapping[str, int], together: Collection[tuple[RoadEnd, RoadEnd]]
    ) -> None:
        self._above: dict[_Border, _Border] = {}
        self._roads, self._junctions = _safe_names(network.roads), _safe_names(network.junctions)
        for road in (network.roads[name] for name in count):
            self._link(network, count, _Border(road.id, 0), road.predecessor)
            self._link(network, count, _Border(road.id, count[road.id]), road.successor)
        for junction in network.junctions.values():
            for border in _meeting(network, junction, count):
                self._join(border, _Border(junction.id, -1))
        for ends in together:
            one, other = (_Border(road, count[road] if at_end else 0) for road, at_end in ends)
            self._join(one, other)

    def name(self, road: str, number: int) -> str:
        """Give the id of the node at a border of the road's parts."""
        top = self._top(_Border(road, number))
        if top.number < 0:
            return f"{self._junctions[top.id]}.junction"
        return f"{self._roads[top.id]}.at{top.number}"

    def _link(
        self, network: RoadNetwork, count: Mapping[str, int], border: _Border, link: Link | None
    ) -> None:
        if link is None or link.s is not None:
            return
        if link.kind == "junction" and link.id in network.junctions:
            self._join(border, _Border(link.id, -1))
        elif link.kind == "road" and link.id in count:
            self._join(border, _end(link, count, ahead=border.number > 0))

    def _top(self, border: _Border) -> _Border:
        while (above := self._above.get(border, border)) != border:
            border = above
        return border

    def _join(self, one: _Border, other: _Border) -> None:
        """Make the two one node, named after a junction if there is one, else after the first road."""
        first, second = sorted(
            (self._top(one), self._top(other)), key=lambda b: (b.number >= 0, b.id, b.number)
        )
        if first != second:
            self._above[second] = first


def _end(link: Link, count: Mapping[str, int], *, ahead: bool) -> _Border:
    """The end of the linked road; the one that fits where the file does not say."""
    contact = link.contact or ("start" if ahead else "end")
    return _Border(link.id, 0 if contact == "start" else count[link.id])


def _meeting(network: RoadNetwork, junction: Junction, count: Mapping[str, int]) -> Iterator[_Border]:
    """The road ends that the junction's connecting roads, or in a direct junction its connections, name."""
    for road in network.roads.values():
        if road.junction == junction.id:
            for ahead, link in ((False, road.predecessor), (True, road.successor)):
                if link is not None and link.kind == "road" and link.s is None and link.id in count:
                    yield _end(link, count, ahead=ahead)
    for connection in junction.connections:
        if connection.connecting in count and network.roads[connection.connecting].junction is None:
            yield _Border(
                connection.connecting, 0 if connection.contact == "start" else count[connection.connecting]
            )


def _safe_names(ids: Iterable[str]) -> dict[str, str]:
    """Names that SUMO takes as ids, each its own: the map's where they are plain."""
    plain = {name for name in ids if re.fullmatch(r"[A-Za-z0-9_]+", name)}
    out: dict[str, str] = {}
    for number, name in enumerate(ids):
        safe = name if name in plain else f"_{number}"
        while safe != name and safe in plain:
            safe = f"_{safe}"
        out[name] = safe
    return out
