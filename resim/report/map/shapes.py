"""The lines of the picture: borders, centre lines and reference lines to 2 cm, and the areas of junctions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from resim.core.geometry import Floats
from resim.road.opendrive import LaneShape, RoadMark, RoadNetwork

STEP = 1.0
TOLERANCE = 0.02
"""Distance [m] of the points that lines are made of, and what of them may be left out."""

AROUND, BACK = 9.0, 7.5
"""A junction's area: its lanes, widened and narrowed again [m], so that gaps between them close."""


@dataclass(frozen=True, eq=False)
class LaneMark:
    """A road mark on the vertices first to last of the outer border of lane shape `line`."""

    line: int
    first: int
    last: int
    mark: RoadMark


@dataclass(frozen=True, eq=False)
class LaneLines:
    """Simplified lines (K, 2) [m], one of each per lane shape: outer borders (lane 0: itself) and centres."""

    borders: list[Floats]
    centres: list[Floats]
    marks: list[LaneMark]


def lane_lines(network: RoadNetwork, shapes: Sequence[LaneShape]) -> LaneLines:
    """Simplify the lanes' lines; borders keep a point wherever their road mark changes."""
    pieces: list[Floats] = []
    owners: list[tuple[int, RoadMark | None]] = []
    for k, shape in enumerate(shapes):
        for first, last, mark in _stretches(network, shape):
            pieces.append(outer(shape)[first : last + 1])
            owners.append((k, mark))
    borders: list[list[Floats]] = [[] for _ in shapes]
    counts, marks = [0] * len(shapes), []
    for (k, mark), piece in zip(owners, simplified(pieces), strict=True):
        end = counts[k] + len(piece) - 1
        if mark is not None and mark.type != "none":
            marks.append(LaneMark(k, counts[k], end, mark))
        borders[k].append(piece[1:] if counts[k] else piece)
        counts[k] = end
    return LaneLines([np.concatenate(b) for b in borders], simplified([s.centre for s in shapes]), marks)


def outer(shape: LaneShape) -> Floats:
    """Give the border (K, 2) away from lane 0; lane 0 itself."""
    return shape.left if shape.lane > 0 else shape.right


def _stretches(network: RoadNetwork, shape: LaneShape) -> Iterator[tuple[int, int, RoadMark | None]]:
    """The road marks of a lane's outer border with the points from and to which each holds."""
    road = network.roads[shape.road]
    section = road.sections[shape.section]
    lane = section.lanes.get(shape.lane)
    length = max(min(section.end, road.length) - section.start, 1e-9)
    last = len(shape.centre) - 1
    starts: dict[int, RoadMark | None] = {0: None}
    for mark in lane.marks if lane else ():
        at = round(mark.s_offset / length * last)
        if at < last:
            starts[max(at, 0)] = mark
    order = sorted(starts)
    for first, after in zip(order, [*order[1:], last], strict=True):
        yield first, after, starts[first]


def reference_lines(network: RoadNetwork) -> list[Floats]:
    """Give every road's reference line as x, y, s (K, 3) [m]."""
    roads = list(network.roads.values())
    along = [np.linspace(0.0, r.length, max(int(np.ceil(r.length / STEP)), 1) + 1) for r in roads]
    s = np.concatenate(along)
    x, y, _ = network.reference_line(np.repeat([r.id for r in roads], [len(a) for a in along]), s)
    return simplified(np.split(np.column_stack([x, y, s]), np.cumsum([len(a) for a in along])[:-1]))


def simplified(lines: Sequence[Floats]) -> list[Floats]:
    """Leave out points (of two or three coordinates each) without which the lines are within 2 cm."""
    if not lines:
        return []
    number = np.repeat(np.arange(len(lines)), [len(line) for line in lines])
    made = shapely.linestrings(np.concatenate(lines), indices=number)
    kept = shapely.simplify(made, TOLERANCE, preserve_topology=False)
    bare = shapely.is_empty(kept)
    kept[bare] = made[bare]
    xy, owner = shapely.get_coordinates(kept, include_z=lines[0].shape[1] == 3, return_index=True)
    return np.split(xy, np.searchsorted(owner, np.arange(1, len(lines))))


def junction_areas(
    network: RoadNetwork, shapes: Sequence[LaneShape], lines: LaneLines
) -> dict[str, list[Floats]]:
    """Give the outlines (K, 2) [m] of every junction's area, none where it has no lanes.

    That of the lanes of its roads; where it has no roads (direct, virtual), of the ends that meet in it.
    """
    parts: dict[str, list[shapely.Geometry]] = {name: [] for name in network.junctions}
    for shape, line in zip(shapes, lines.centres, strict=True):
        junction = network.roads[shape.road].junction
        if junction in parts:
            half = 0.5 * float(np.hypot(*(shape.left - shape.right).T).max())
            parts[junction].append(shapely.buffer(shapely.linestrings(line), half + AROUND, quad_segs=8))
    for name, geometries in parts.items():
        if not geometries:
            geometries += [shapely.buffer(p, AROUND, quad_segs=8) for p in _ends(network, shapes, name)]
    return {name: _outlines(geometries) for name, geometries in parts.items()}


def _outlines(geometries: Sequence[shapely.Geometry]) -> list[Floats]:
    area = shapely.simplify(shapely.buffer(shapely.union_all(geometries), -BACK, quad_segs=8), 0.1)
    rings = [shapely.get_exterior_ring(p) for p in shapely.get_parts(area)]
    return [shapely.get_coordinates(ring) for ring in rings]


def _ends(network: RoadNetwork, shapes: Sequence[LaneShape], junction: str) -> Iterator[shapely.Geometry]:
    """The cross-sections of the roads where they are linked to the junction."""
    for shape in shapes:
        road = network.roads[shape.road]
        for link, section, point in (
            (road.predecessor, 0, 0),
            (road.successor, len(road.sections) - 1, -1),
        ):
            if link and link.kind == "junction" and link.id == junction and shape.section == section:
                yield shapely.linestrings(np.stack([shape.left[point], shape.right[point]]))
