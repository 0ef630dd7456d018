"""What the page's script draws, as plain data: places in centimetres from an origin, each as a step from the last.

lines, centres: one per lane shape (`RoadNetwork.lane_shapes`: of a section, from the rightmost lane to the
leftmost, lane 0 among them). A lane lies between its own line and that of its neighbour towards lane 0.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from resim.core.geometry import Floats
from resim.report.map.colors import SCALE, type_color
from resim.report.map.shapes import LaneLines, junction_areas, lane_lines, reference_lines
from resim.report.markup import Markup, script_data
from resim.road.links import LaneKey
from resim.road.opendrive import VEHICLE_LANES, LaneShape, RoadNetwork
from resim.road.sumo import Conversion, LaneError


@dataclass(frozen=True, eq=False)
class Picture:
    """A map and what became of it in SUMO, if known."""

    network: RoadNetwork
    conversion: Conversion | None

    @cached_property
    def shapes(self) -> list[LaneShape]:
        """Every lane of every section, lane 0 among them."""
        return self.network.lane_shapes(1.0)

    @cached_property
    def lines(self) -> LaneLines:
        """Their lines, simplified."""
        return lane_lines(self.network, self.shapes)

    @cached_property
    def errors(self) -> dict[LaneKey, LaneError]:
        """The error of every lane of the net."""
        return {lane.key: lane for lane in self.conversion.lanes} if self.conversion else {}

    @cached_property
    def types(self) -> dict[str, int]:
        """How many lanes there are of each type."""
        found = [shape.type for shape in self.shapes if shape.lane != 0]
        return {name: found.count(name) for name in sorted(set(found))}

    @cached_property
    def extent(self) -> tuple[float, float, float, float]:
        """West, south, east and north end of the lanes [m]."""
        xy = np.concatenate(self.lines.borders)
        low, high = xy.min(axis=0), xy.max(axis=0)
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    @cached_property
    def origin(self) -> Floats:
        """Whole metres (2,) amid the map, from which its places count."""
        west, south, east, north = self.extent
        return np.round([0.5 * (west + east), 0.5 * (south + north)])

    def steps(self, line: Floats) -> IntegerSteps:
        """Give a line (K, 2) as x, y, dx, dy, dx, dy ... [cm]."""
        places = np.round(100.0 * (line[:, :2] - self.origin)).astype(int)
        found: list[int] = np.diff(places, axis=0, prepend=np.zeros((1, 2), int)).ravel().tolist()
        return found


IntegerSteps = list[int]
"""A line as x, y, dx, dy, dx, dy ... [cm]."""
LaneRow = tuple[int, int, int, int, int, int, int, int, str]
"""Road (index), section, lane, type (index), driven along s 1, against it -1, both ways 2, no way 0, length, least and
largest width [cm], speed limits."""
MarkRow = tuple[int, int, int, str, str, int]
"""Line (index), its first and last point, type, colour, width [cm]."""
GapRow = tuple[str, str, float, float, float]
"""From which SUMO lane to which, how far apart [m], x, y [m]."""
ErrorRow = tuple[float | None, float | None, float, float, float, float, tuple[str, ...], str]
"""Worst, mean, limit [m], s, x, y [m], SUMO lanes, remark."""


@dataclass(frozen=True)
class LaneType:
    """A type of lane."""

    name: str
    color: str
    drivable: bool


@dataclass(frozen=True)
class RoadLine:
    """A road and its reference line, with the s [m] of its points; length in m."""

    id: str
    name: str
    length: float
    junction: str | None
    sections: int
    line: IntegerSteps
    s: list[float]


@dataclass(frozen=True)
class JunctionArea:
    """A junction, and the outlines of what its lanes cover."""

    id: str
    name: str
    type: str
    rings: list[IntegerSteps]


@dataclass(frozen=True)
class MapData:
    """All that the script draws; origin: x, y [m] of the map. errors: by lane shape, None without a net."""

    origin: list[float]
    types: list[LaneType]
    scale: Sequence[tuple[float, str]]
    roads: list[RoadLine]
    lanes: list[LaneRow]
    lines: list[IntegerSteps]
    centres: list[IntegerSteps]
    marks: list[MarkRow]
    junctions: list[JunctionArea]
    errors: list[ErrorRow | None] | None
    gaps: list[GapRow]


def to_script(picture: Picture) -> Markup:
    """Give the data as JSON that can stand within a script element, whatever the map's names are."""
    data = map_data(picture)
    return script_data(
        json.dumps(data, default=vars, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    )


def map_data(picture: Picture) -> MapData:
    """Give all that the script draws of a map."""
    names = list(picture.types)
    conversion = picture.conversion
    return MapData(
        origin=picture.origin.tolist(),
        types=[LaneType(name, type_color(name), name in VEHICLE_LANES) for name in names],
        scale=SCALE,
        roads=_roads(picture),
        lanes=_lanes(picture, {name: i for i, name in enumerate(names)}),
        lines=[picture.steps(line) for line in picture.lines.borders],
        centres=[picture.steps(line) for line in picture.lines.centres],
        marks=[
            (m.line, m.first, m.last, m.mark.type, m.mark.color, round(100.0 * (m.mark.width or 0.12)))
            for m in picture.lines.marks
        ],
        junctions=_junctions(picture),
        errors=[_error(picture.errors.get(_key(s))) for s in picture.shapes] if conversion else None,
        gaps=[(j.origin, j.target, round(j.gap, 3), round(j.x, 2), round(j.y, 2)) for j in conversion.jumps]
        if conversion
        else [],
    )  # fmt: skip


def _key(shape: LaneShape) -> LaneKey:
    return LaneKey(shape.road, shape.section, shape.lane)


def _roads(picture: Picture) -> list[RoadLine]:
    return [
        RoadLine(
            road.id, road.name, round(road.length, 2), road.junction, len(road.sections), picture.steps(line),
            np.round(line[:, 2], 2).tolist(),
        )
        for road, line in zip(picture.network.roads.values(), reference_lines(picture.network), strict=True)
    ]  # fmt: skip


def _lanes(picture: Picture, types: dict[str, int]) -> list[LaneRow]:
    """A row a shape."""
    number = {name: i for i, name in enumerate(picture.network.roads)}
    limits = _limits(picture.network, picture.shapes)
    return [
        (number[s.road], s.section, s.lane, types.get(s.type, -1) if s.lane else -1,
         _way(picture.network, s), *_sizes(s), limit)
        for s, limit in zip(picture.shapes, limits, strict=True)
    ]  # fmt: skip


def _way(network: RoadNetwork, shape: LaneShape) -> int:
    if shape.type not in VEHICLE_LANES or shape.lane == 0:
        return 0
    if shape.type == "bidirectional":
        return 2
    return 1 if network.roads[shape.road].along(shape.lane, shape.section) else -1


def _sizes(shape: LaneShape) -> tuple[int, int, int]:
    width = np.hypot(*(shape.left - shape.right).T)
    length = np.hypot(*np.diff(shape.centre, axis=0).T).sum()
    return round(100.0 * float(length)), round(100.0 * float(width.min())), round(100.0 * float(width.max()))


def _limits(network: RoadNetwork, shapes: Sequence[LaneShape]) -> list[str]:
    """The speed limits of each shape in words, empty where there is none or nobody drives."""
    rows, places = [], []
    for k, shape in enumerate(shapes):
        road, section = network.roads[shape.road], network.roads[shape.road].sections[shape.section]
        if _way(network, shape) and road.section_index(section.start) == shape.section:
            end = min(section.end, road.length)
            places.append(np.linspace(section.start, end, len(shape.centre), endpoint=False))
            rows.append(np.full(len(shape.centre), k))
    out = [""] * len(shapes)
    if not rows:
        return out
    row = np.concatenate(rows)
    roads, lanes = np.array([s.road for s in shapes])[row], np.array([s.lane for s in shapes])[row]
    found = network.speed_limit(roads, lanes, np.concatenate(places))
    for own, limit in zip(rows, np.split(found, np.cumsum([len(r) for r in rows])[:-1]), strict=True):
        out[int(own[0])] = ", ".join(
            "no limit" if np.isinf(v) else f"{3.6 * v:.0f} km/h" for v in np.unique(limit[~np.isnan(limit)])
        )
    return out


def _junctions(picture: Picture) -> list[JunctionArea]:
    areas = junction_areas(picture.network, picture.shapes, picture.lines)
    return [
        JunctionArea(j.id, j.name, j.type, [picture.steps(ring) for ring in areas[j.id]])
        for j in picture.network.junctions.values()
    ]  # fmt: skip


def _error(error: LaneError | None) -> ErrorRow | None:
    if error is None:
        return None
    return (error.worst, error.mean, error.limit, round(error.s, 2), round(error.x, 2), round(error.y, 2),
            error.sumo, error.remark)  # fmt: skip
