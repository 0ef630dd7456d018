"""What an OpenDRIVE file says, as frozen dataclasses: metres, radians, m/s, s along the reference line."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

VEHICLE_LANES = frozenset({
    "driving", "entry", "exit", "onRamp", "offRamp", "connectingRamp", "slipLane", "bidirectional",
    "mwyEntry", "mwyExit", "HOV", "bus", "taxi", "special1", "special2", "special3", "roadWorks",
})  # fmt: skip
"""Lane types that vehicles drive on: only in these is a point `on_road`."""

LANE_TYPES = VEHICLE_LANES | {
    "none", "stop", "shoulder", "biking", "sidewalk", "border", "restricted", "parking", "median", "tram", "rail",
    "walking", "curb", "shared",
}  # fmt: skip
"""Every lane type of OpenDRIVE 1.4 to 1.8."""

CURVES = ("line", "arc", "spiral", "poly3", "paramPoly3")
"""What a planView element can hold."""

Side = Literal["start", "end"]
Orientation = Literal["+", "-", "none"]
SignalKind = Literal["light", "stop", "give way", "priority"]


class Cubic(NamedTuple):
    """A polynomial a + b ds + c ds² + d ds³ that holds from s on; s on the road or within the section."""

    s: float
    a: float
    b: float
    c: float
    d: float


@dataclass(frozen=True)
class Geometry:
    """One planView element: pose of its start, length [m] and the curve.

    kind: line, arc, spiral (curvature [1/m] from start to end), poly3, paramPoly3 (u, v: coefficients
    a, b, c, d of the local coordinates; normalized: the parameter runs from 0 to 1, else to the length).
    """

    kind: str
    s: float
    x: float
    y: float
    heading: float
    length: float
    curvature_start: float = 0.0
    curvature_end: float = 0.0
    u: tuple[float, float, float, float] = (0.0, 1.0, 0.0, 0.0)
    v: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    normalized: bool = False


@dataclass(frozen=True)
class RoadMark:
    """The mark on a lane's outer border (lane 0: on the centre line) from s_offset [m] in the section."""

    s_offset: float
    type: str
    color: str
    width: float | None


class Height(NamedTuple):
    """Height [m] of a lane's inner and outer border over the road from s on, s within the section."""

    s: float
    inner: float
    outer: float


@dataclass(frozen=True)
class Lane:
    """One lane of a lane section. widths, borders, heights, speeds (s, m/s) count s from the section's start.

    speeds: inf where the file says that there is no limit, NaN where it leaves it open. reversed: driven
    against the road's rule (direction="reversed" of OpenDRIVE 1.8). unread: what is wrong with records of height
    and road marks that are passed over.
    """

    id: int
    type: str
    widths: tuple[Cubic, ...] = ()
    borders: tuple[Cubic, ...] = ()
    marks: tuple[RoadMark, ...] = ()
    speeds: tuple[tuple[float, float], ...] = ()
    predecessor: int | None = None
    successor: int | None = None
    heights: tuple[Height, ...] = ()
    reversed: bool = False
    unread: tuple[str, ...] = ()

    @property
    def drivable(self) -> bool:
        """Whether vehicles drive on it, see VEHICLE_LANES."""
        return self.type in VEHICLE_LANES


@dataclass(frozen=True)
class LaneSection:
    """Lanes by id (left positive, 0 the centre line) on start <= s < end [m]."""

    start: float
    end: float
    lanes: dict[int, Lane]


@dataclass(frozen=True)
class Link:
    """Where a road goes on: a road (with the end at which it is entered) or a junction.

    s: where within that road [m], for roads that leave or join one at a virtual junction; else None.
    """

    kind: Literal["road", "junction"]
    id: str
    contact: Side | None
    s: float | None = None


@dataclass(frozen=True)
class RoadType:
    """Type of the road from s [m] on, with its speed limit [m/s]: inf for no limit, NaN where left open."""

    s: float
    type: str
    speed: float


@dataclass(frozen=True)
class SpeedSign:
    """A signal that begins or ends a speed limit at s [m].

    orientation: for traffic along s (+), against it (-) or both (none). lanes: ranges of lane ids it is for,
    () for all. speed [m/s]: inf ends the limit before it, NaN where the file does not say a speed that a sign
    can show. text: what the file says.
    """

    id: str
    s: float
    orientation: Orientation
    lanes: tuple[tuple[int, int], ...]
    speed: float
    text: str


@dataclass(frozen=True)
class Signal:
    """A traffic light, a sign, or a reference to one, at s [m]; fixed speed limits are `SpeedSign`.

    kind: None where this reader knows none for it. orientation, lanes, text: as of `SpeedSign`. refers: it is a
    reference: the signal of that id is elsewhere, and holds here as well. problem: why its place cannot be read, or "".
    """

    id: str
    kind: SignalKind | None
    s: float
    orientation: Orientation
    lanes: tuple[tuple[int, int], ...]
    text: str
    refers: bool = False
    problem: str = ""


@dataclass(frozen=True)
class Controller:
    """What switches signals together. signals: their ids."""

    id: str
    signals: tuple[str, ...]


@dataclass(frozen=True)
class Road:
    """One road. length [m] is that of its planView; left_hand: traffic keeps left (rule LHT).

    superelevations: roll [rad]. declared_length [m]: as written at the road, NaN where it is not. empty: s
    [m] of planView elements without length, which are passed over.
    """

    id: str
    name: str
    length: float
    junction: str | None
    left_hand: bool
    geometries: tuple[Geometry, ...]
    sections: tuple[LaneSection, ...]
    lane_offsets: tuple[Cubic, ...] = ()
    elevations: tuple[Cubic, ...] = ()
    types: tuple[RoadType, ...] = ()
    predecessor: Link | None = None
    successor: Link | None = None
    superelevations: tuple[Cubic, ...] = ()
    signs: tuple[SpeedSign, ...] = ()
    signals: tuple[Signal, ...] = ()
    declared_length: float = math.nan
    empty: tuple[float, ...] = ()

    def section_index(self, s: float) -> int:
        """Give the index of the lane section at s [m], clamped to the road."""
        after = [i for i, section in enumerate(self.sections) if section.start <= s]
        return after[-1] if after else 0

    def along(self, lane: int, section: int = 0) -> bool:
        """Say whether the lane of the section (an index) is driven in the direction of s."""
        standard = lane <= 0 if not self.left_hand else lane >= 0
        found = self.sections[section].lanes.get(lane)
        return standard != (found is not None and found.reversed)


@dataclass(frozen=True)
class Connection:
    """A way through a junction: from a lane of `incoming` to one of `connecting`, entered at `contact`.

    In a direct junction `connecting` is the linked road itself, as there is no road inside.
    """

    id: str
    incoming: str
    connecting: str
    contact: Side
    lane_links: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Junction:
    """A junction and its connections. type: default, direct, virtual, crossing.

    priorities: pairs of roads, of which traffic on the first goes before that on the second. controllers: ids of
    those of its traffic lights, in their order.
    """

    id: str
    name: str
    type: str
    connections: tuple[Connection, ...]
    priorities: tuple[tuple[str, str], ...] = ()
    controllers: tuple[str, ...] = ()


class Unread(NamedTuple):
    """What the file says and the reader leaves out: road and lane are None where of none, s [m] NaN."""

    code: str
    road: str | None
    lane: int | None
    s: float
    text: str


@dataclass(frozen=True)
class Header:
    """The header: revision, name and the extent (north, south, east, west) [m] as written, or None.

    offset: x, y, heading [m m rad] of the map's frame in that of its geoReference.
    """

    revision: tuple[int, int]
    name: str
    extent: tuple[float, float, float, float] | None
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
