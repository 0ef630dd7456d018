"""What of a map goes into its SUMO net: edges, lanes and connections with the map's own geometry and links.

netconvert's OpenDRIVE import is not used: it gives tapers one width and the wrong place, moves junctions by metres,
drops links, guesses others, and refuses or crashes on valid maps (docs/validation.md). From plain XML it only
builds what SUMO needs inside of junctions (`plainxml` writes it).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from resim.core.geometry import Floats
from resim.road.links import Graph, LaneKey, inner_roads, lane_graph, passed_lanes, ways
from resim.road.opendrive import RoadNetwork
from resim.road.sumo.pieces import Piece, Pieces, RoadEnd, cut
from resim.road.sumo.shapes import LaneStretch, mean_widths, polylines, sample

NARROWEST = 0.01

Ends = tuple[str, str]
"""The SUMO lanes that a connection leads from and to."""

EdgePair = tuple[str, str]
"""The edges that a connection leads from and to: by them SUMO is told what goes before what."""


@dataclass(frozen=True, eq=False)
class LaneLine:
    """A lane of an edge: its SUMO id, what it is in the map, its exact centre line (K, 2) and mean width [m]."""

    id: str
    stretch: LaneStretch
    line: Floats
    width: float


@dataclass(frozen=True, eq=False)
class SumoConnection:
    """From one SUMO lane to another over lanes inside of a junction (none: they meet); line (K, 2) [m].

    jump: distance [m] between where the lane before ends and the lane after begins, beyond what lies between.
    """

    origin: str
    target: str
    way: tuple[LaneKey, ...]
    stretches: tuple[LaneStretch, ...]
    line: Floats
    width: float
    jump: float

    @property
    def ends(self) -> Ends:
        """The lanes that it leads from and to."""
        return self.origin, self.target

    @property
    def edges(self) -> EdgePair:
        """The edges that it leads from and to."""
        return self.origin.rpartition("_")[0], self.target.rpartition("_")[0]


@dataclass(frozen=True, eq=False)
class PlainNetwork:
    """All that goes into the net."""

    pieces: Pieces
    lanes: dict[str, LaneLine]
    connections: tuple[SumoConnection, ...]


def plain(network: RoadNetwork) -> PlainNetwork:
    """Give the lanes of all edges and the connections between them."""
    graph = lane_graph(network)
    passed = passed_lanes(network, graph)
    inside = inner_roads(network, passed)
    pieces = cut(network, inside, passed)
    if together := _together(_connected(graph, inside, pieces), pieces):
        pieces = cut(network, inside, passed, together)
    places = [(piece, index, lane) for piece in pieces.all for index, lane in enumerate(piece.lanes)]
    stretches = [LaneStretch(p.road, p.section, lane, p.start, p.end, p.forward) for p, _, lane in places]
    samples = sample(network, stretches) if stretches else None
    lanes = {}
    if samples is not None:
        lines = polylines(samples)
        widths = mean_widths(samples)
        for (piece, index, _), stretch, line, width in zip(places, stretches, lines, widths, strict=True):
            name = f"{piece.id}_{index}"
            lanes[name] = LaneLine(name, stretch, line, max(float(width), NARROWEST))
    found = _connected(graph, inside, pieces)
    return PlainNetwork(pieces, lanes, tuple(_with_lines(network, lanes, found)))


def _together(found: Collection[Ends], pieces: Pieces) -> list[tuple[RoadEnd, RoadEnd]]:
    """The ends of roads whose lanes are linked, but which no link makes one node: SUMO connects at nodes only.

    So it is where a way leads through several junctions, or where a connecting road does not say what it connects.
    """
    by_id = {piece.id: piece for piece in pieces.all}
    out: dict[tuple[RoadEnd, RoadEnd], None] = {}
    for ends in found:
        origin, target = (by_id[lane.rpartition("_")[0]] for lane in ends)
        if origin.target != target.origin:
            out[(origin.road, origin.forward), (target.road, not target.forward)] = None
    return list(out)


def _connected(graph: Graph, inside: Collection[str], pieces: Pieces) -> dict[Ends, tuple[LaneKey, ...]]:
    """The junction lanes between each linked pair of SUMO lanes; of several ways the first that the file names."""
    graph = _bridged(graph, {key for key in graph if key not in pieces.of_lane and key.road not in inside})
    found: dict[Ends, tuple[LaneKey, ...]] = {}
    for key, own in pieces.of_lane.items():
        for before, after in pairwise(own):
            found[lane_id(before, key.lane), lane_id(after, key.lane)] = ()
        for way in ways(graph, key, inside) if key.road not in inside else ():
            if way[-1] in pieces.of_lane:
                ends = lane_id(own[-1], key.lane), lane_id(pieces.of_lane[way[-1]][0], way[-1].lane)
                found.setdefault(ends, way[:-1])
    return found


def _bridged(graph: Graph, empty: Collection[LaneKey]) -> Graph:
    """The graph with the ways through lanes without length, which are no edges, as links from end to end."""
    out = dict(graph)
    for key, after in graph.items() if empty else ():
        found: dict[LaneKey, None] = {}
        seen: set[LaneKey] = set()
        todo = list(reversed(after))
        while todo:
            one = todo.pop()
            if one not in empty:
                found[one] = None
            elif one not in seen:
                seen.add(one)
                todo += reversed(graph[one])
        out[key] = tuple(found)
    return out


def lane_id(piece: Piece, lane: int) -> str:
    """Give the SUMO id of a lane of the map on an edge."""
    return f"{piece.id}_{piece.lanes.index(lane)}"


def _with_lines(
    network: RoadNetwork, lanes: dict[str, LaneLine], found: dict[Ends, tuple[LaneKey, ...]]
) -> Iterator[SumoConnection]:
    """Connections with the centre lines of the junction lanes they pass."""
    inner = {key: _whole(network, key) for way in found.values() for key in way}
    known = [stretch for stretch in inner.values() if stretch is not None]
    samples = sample(network, known) if known else None
    lines = dict(zip(known, polylines(samples), strict=True)) if samples is not None else {}
    widths = dict(zip(known, mean_widths(samples).tolist(), strict=True)) if samples is not None else {}
    for (origin, target), way in found.items():
        stretches = tuple(stretch for key in way if (stretch := inner[key]) is not None)
        own = [lines[stretch] for stretch in stretches]
        before, after = lanes[origin].line[-1:], lanes[target].line[:1]
        gaps = [np.hypot(*(b[0] - a[-1])) for a, b in pairwise([before, *own, after])]
        line = np.concatenate(own) if own else np.concatenate([before, after])
        width = np.mean([widths[stretch] for stretch in stretches]) if own else lanes[origin].width
        yield SumoConnection(
            origin, target, way, stretches, line, max(float(width), NARROWEST), float(max(gaps))
        )


def _whole(network: RoadNetwork, key: LaneKey) -> LaneStretch | None:
    """The whole of a lane inside of a junction, None where its section has no length."""
    road = network.roads[key.road]
    section = road.sections[key.section]
    end = min(section.end, road.length)
    if end - section.start < 1e-6:
        return None
    return LaneStretch(*key, section.start, end, road.along(key.lane, key.section))
