"""Where maneuvers can be planted: strips of roads whose lanes stay the same, and ways through junctions.

A strip is read from the OpenDRIVE file itself: a road over one or more lane sections with the same driven lanes of the
same constant widths, so that a place in it is metres along one lane's centre and metres to the left of that; which lane
that is follows by counting widths. A way follows one lane through a junction. `resim.road` gives the centre lines, and
nothing of `resim.mining` is used.
"""

from __future__ import annotations

import bisect
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache, cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from lxml import etree
from mining_signs import (
    DRIVEN,
    NO_SIGNS,
    Signs,
    beyond,
    crossed_ends,
    joined_ends,
    lane_counts,
    roads,
    sections,
    short_neighbours,
    signs_of,
    torn,
)

from resim.road.driven_route import Route
from resim.road.opendrive import RoadNetwork
from resim.road.path import Path as LanePath
from resim.road.path import lane_path

CLASSES = {"entry": "on", "onRamp": "on", "exit": "off", "offRamp": "off"}
STEP, ARM = 0.25, 60.0
"""m between the points of a centre line, and of the lanes before and after a junction at most."""
SHORTEST_ARM, BORDER = 12.0, 1.0
"""m of an arm at least, and that strips keep from the ends of a road's sections."""
SHORTEST_INSIDE, GAP = 3.0, 0.05
"""m of a way inside of a junction at least: shorter ones lie between two samples; m that lanes are apart at most."""
BEHIND = 0.5
"""m that a line begins before its start, as speeds there are told of places before."""
TIGHT, BENDS = 60.0, 0.52
"""m: a way through a junction with a smaller mean radius, that turns by more than so many rad, makes it a crossing."""
U_TURN = 2.4
"""rad from which on a way leads back (scenarios/mining/labels.toml)."""


@dataclass(frozen=True)
class StripLane:
    """One lane of a strip, by metres to the left of the strip's own lane.

    same: driven as the strip's own lane. kind: lane type of OpenDRIVE.
    """

    left: float
    right: float
    same: bool
    kind: str

    @property
    def centre(self) -> float:
        """Metres to the left of the strip's own lane."""
        return 0.5 * (self.left + self.right)


@dataclass(frozen=True, eq=False)
class Ground:
    """A lane's centre line, with the lanes beside it, from left to right, and the junctions that it passes.

    own: place of the line's own lane in lanes. roads: (to, type of the road) m along the line. turns: (from, to, label)
    likewise. along: of each lane, m of its own centre at the nodes of `station`. edges: types of the lanes to the left
    and right of all of these, "" for none, "?" where they change. crossings: from where to where [m] along the line
    crossings are. counts: where [m] the road gets lanes, or (negative) loses them, outside of junctions. turn: rad that
    the way through the junction turns. junction: its name. before: the road before it. signs: its lights and stop sign.
    """

    network: RoadNetwork
    path: LanePath
    length: float
    lanes: tuple[StripLane, ...]
    own: int
    roads: tuple[tuple[float, str], ...]
    turns: tuple[tuple[float, float, str], ...] = ()
    along: dict[int, np.ndarray] = field(default_factory=dict)
    edges: tuple[str, str] = ("?", "?")
    crossings: tuple[tuple[float, float], ...] = ()
    counts: tuple[tuple[float, int], ...] = ()
    turn: float = 0.0
    junction: str = ""
    before: str = ""
    signs: Signs = NO_SIGNS

    @property
    def name(self) -> str:
        """That of the map."""
        return self.network.path.stem

    @cached_property
    def limit(self) -> float:
        """The least speed limit [m/s] on it, NaN without."""
        limits = self.path.speed_limit[(self.path.s >= 0.0) & (self.path.s <= self.length)]
        return float(np.nanmin(limits)) if np.isfinite(limits).all() else float("nan")

    @cached_property
    def bend(self) -> float:
        """The sharpest bend [1/m] on it."""
        return float(np.abs(self.path.curvature[(self.path.s >= 0.0) & (self.path.s <= self.length)]).max())

    def lane_at(self, aside: float) -> int:
        """Give the lane at metres to the left, -1 for none."""
        for k, lane in enumerate(self.lanes):
            if lane.right < aside <= lane.left:
                return k
        return -1

    def road_at(self, way: float) -> str:
        """Give the type of the road at metres along the line."""
        return next(kind for end, kind in self.roads if way <= end)

    def station(self, lane: int, way: np.ndarray) -> np.ndarray:
        """Give metres along the centre of a lane at metres along the line."""
        nodes = np.arange(-60.0, self.length + 60.0, 0.5)
        if lane not in self.along:
            x, y = self.path.xy(nodes, np.full(len(nodes), self.lanes[lane].centre))
            self.along[lane] = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
        return np.interp(way, nodes, self.along[lane])


def same_way(ground: Ground) -> list[int]:
    """Give the lanes that are driven as its own, next to each other, from left to right."""
    first = last = ground.own
    while first > 0 and ground.lanes[first - 1].same:
        first -= 1
    while last + 1 < len(ground.lanes) and ground.lanes[last + 1].same:
        last += 1
    return list(range(first, last + 1))


@dataclass(frozen=True)
class _Piece:
    """Metres of a road with the same lanes: (id, width, type) by id, highest first; type of the road there."""

    road: str
    first: float
    last: float
    lanes: tuple[tuple[int, float, str], ...]
    kind: str


def pieces(network: RoadNetwork) -> list[_Piece]:
    """Give the pieces of all roads outside of junctions whose driven lanes have one width each."""
    out: list[_Piece] = []
    for element in roads(network).values():
        if element.get("junction") not in (None, "-1") or element.get("rule") == "LHT":
            continue
        if torn(element) or short_neighbours(network, element):
            continue
        own: list[_Piece] = []
        for first, last, section in sections(element):
            lanes = _constant(section)
            for begin, end, kind in _types(element, first, last):
                if not lanes or end - begin < 2.0 * BORDER:
                    continue
                one = _Piece(element.get("id"), begin, end, lanes, kind)
                before = own[-1] if own else None
                if before and (before.lanes, before.kind, before.last) == (lanes, kind, begin):
                    own[-1] = _Piece(one.road, before.first, end, lanes, kind)
                else:
                    own.append(one)
        out += own
    return out


def _types(element: etree._Element, first: float, last: float) -> list[tuple[float, float, str]]:
    told = [(float(one.get("s")), one.get("type")) for one in element.findall("type")] or [(0.0, "")]
    cuts = sorted({first, last, *(s for s, _ in told if first < s < last)})
    starts = [s for s, _ in told]
    return [(a, b, told[max(bisect.bisect_right(starts, a) - 1, 0)][1]) for a, b in pairwise(cuts)]


def _constant(section: etree._Element) -> tuple[tuple[int, float, str], ...]:
    """Driven lanes that lie side by side in one or two blocks; () where a width changes."""
    out = []
    for lane in section.iterfind(".//lane"):
        number, widths = int(lane.get("id")), lane.findall("width")
        if number == 0 or lane.get("type") not in DRIVEN:
            continue
        told = {tuple(round(float(one.get(k)), 6) for k in "abcd") for one in widths}
        if len(told) != 1 or any(next(iter(told))[1:]):
            return ()
        out.append((number, next(iter(told))[0], lane.get("type")))
    return tuple(sorted(out, reverse=True))


def _beside(piece: _Piece, own: int) -> tuple[tuple[StripLane, ...], int, tuple[int, int]]:
    """The lanes next to each other that a lane is among, from left to right as it is driven, its place, outer ids."""
    ids = [number for number, _, _ in piece.lanes]
    k = ids.index(own)
    low = high = k
    while low > 0 and _next_to(ids[low - 1], ids[low]):
        low -= 1
    while high + 1 < len(ids) and _next_to(ids[high], ids[high + 1]):
        high += 1
    block = list(piece.lanes[low : high + 1])
    at = k - low
    if own > 0:
        block, at = block[::-1], len(block) - 1 - at
    out, left = [], 0.5 * block[at][1] + sum(width for _, width, _ in block[:at])
    for number, width, kind in block:
        out.append(StripLane(left, left - width, (number > 0) == (own > 0), kind))
        left -= width
    return tuple(out), at, (ids[low], ids[high])


def _next_to(one: int, two: int) -> bool:
    return one - two == (2 if one > 0 > two else 1)


def strip(network: RoadNetwork, piece: _Piece, own: int, start: float, length: float) -> Ground:
    """Give the strip of a piece from `start` m behind where its lane is entered."""
    begin = piece.first + BORDER + start if own < 0 else piece.last - BORDER - start
    path = lane_path(network, piece.road, own, begin, length, behind=BEHIND, step=STEP)
    lanes, at, outer = _beside(piece, own)
    element = roads(network)[piece.road]
    first, last = sorted((begin, begin + length if own < 0 else begin - length))
    edges = beyond(element, first, last, outer)
    crossed, joined = crossed_ends(element, crossing_junctions(network)), joined_ends(network, element, own)
    ends = crossed[0] and joined[0], crossed[1] and joined[1]
    behind, ahead = (
        _metres(network, piece.road, own, begin, to) for to in (0.0, float(element.get("length")))
    )
    if own > 0:
        edges, ends, behind, ahead = edges[::-1], ends[::-1], ahead, behind
    crossings = [(-np.inf, -behind)] * ends[0] + [(ahead, np.inf)] * ends[1]
    return Ground(
        network, path, length, lanes, at, ((np.inf, piece.kind),), edges=edges, crossings=tuple(crossings)
    )


def _metres(network: RoadNetwork, road: str, lane: int, begin: float, end: float) -> float:
    """Give metres from s = begin to end [m] of a road, as far aside of its line as a lane is at begin."""
    s = np.linspace(begin, end, max(int(abs(end - begin) / STEP), 1) + 1)
    x, y, heading = network.reference_line(np.full(len(s), road), s)
    own = np.array(network.to_xy(road, lane, begin, 0.0))
    t = (own[1] - y[0]) * np.cos(heading[0]) - (own[0] - x[0]) * np.sin(heading[0])
    return float(np.hypot(np.diff(x - t * np.sin(heading)), np.diff(y + t * np.cos(heading))).sum())


def changing(network: RoadNetwork) -> Iterator[Ground]:
    """Give the grounds of lanes that go on where their road, outside of junctions, gets or loses lanes beside them."""
    for element in roads(network).values():
        if element.get("junction") not in (None, "-1") or element.get("rule") == "LHT" or torn(element):
            continue
        parts = sections(element)
        for right in (True, False):
            changes = lane_counts(element, right)
            for s, _ in changes:
                before = next(one for _, end, one in parts if end == s)
                for number in _going_on(before, right):
                    ground = _over(network, element, number, s, changes)
                    if ground is not None:
                        yield ground


def _going_on(section: etree._Element, right: bool) -> list[int]:
    """The driven lanes of one way that are linked to a lane of the same id in the next section."""
    out = []
    for lane in section.iterfind(".//lane"):
        number, link = int(lane.get("id")), lane.find("link/successor")
        if number and (number < 0) == right and lane.get("type") in DRIVEN and link is not None:
            out += [number] if int(link.get("id")) == number else []
    return out


def _over(
    network: RoadNetwork, element: etree._Element, number: int, s: float, changes: list[tuple[float, int]]
) -> Ground | None:
    """The ground of one lane over a place where the road's lanes change; None where it is too short or narrow."""
    length, sign = float(element.get("length")), 1 if number < 0 else -1
    back, on = (
        min(ARM, (s if number < 0 else length - s) - 2.0),
        min(ARM, (length - s if number < 0 else s) - 2.0),
    )
    if min(back, on) < SHORTEST_ARM:
        return None
    start = s - sign * back
    path = lane_path(network, element.get("id"), number, start, back + on, behind=BEHIND, step=STEP)
    there = [(sign * (at - start), sign * change) for at, change in changes]
    there = [(at, change) for at, change in there if 0.0 < at < back + on]
    half = float(path.half_width.min())
    if path.ends or half < 1.2 or path.s[-1] < back + on - 0.5:
        return None
    # metres of the road are not those of the lane in bends
    places = []
    for at, change in there:
        x, y = network.to_xy(
            np.array([element.get("id")]), np.array([number]), np.array([start + sign * at]), np.zeros(1)
        )
        places.append((float(path.project(np.asarray(x), np.asarray(y))[0][0]), change))
    lanes = (StripLane(half, -half, True, "driving"),)
    kinds = _types(element, 0.0, length)
    return Ground(
        network, path, float(path.s[-1]), lanes, 0, ((np.inf, kinds[0][2] if len(kinds) == 1 else "?"),),
        counts=tuple(sorted(places)),
    )  # fmt: skip


def room(piece: _Piece) -> float:
    return piece.last - piece.first - 2.0 * BORDER


class Way(NamedTuple):
    """A way through a junction: road and lane before, road and lane inside, road after, and rad that it turns."""

    before: str
    lane: int
    inside: str
    inner: int
    after: str
    turn: float


def ways(network: RoadNetwork) -> Iterator[Way]:
    """Give the ways through junctions, over right lanes of connecting roads."""
    every = roads(network)
    outside = {name for name, road in every.items() if road.get("junction") in (None, "-1")}
    for element in every.values():
        before, after = (element.find(f"link/{tag}") for tag in ("predecessor", "successor"))
        if element.get("junction") in (None, "-1") or before is None or after is None:
            continue
        names = before.get("elementId"), after.get("elementId")
        passed = [every[name] for name in (*names, element.get("id")) if name in every]
        if (
            not set(names) <= outside
            or any(torn(one) for one in passed)
            or len(element.findall("lanes/laneSection")) != 1
        ):
            continue
        for lane in element.iterfind("lanes/laneSection/right/lane"):
            link = lane.find("link/predecessor")
            if lane.get("type") in DRIVEN and link is not None and lane.find("link/successor") is not None:
                number, own, width = int(lane.get("id")), int(link.get("id")), lane.find("width")
                comes = before.get("contactPoint") == ("end" if own < 0 else "start")
                if comes and width is not None and float(width.get("a")) > 2.0:
                    turn = turned(network, element.get("id"), number)
                    yield Way(names[0], own, element.get("id"), number, names[1], turn)


def turned(network: RoadNetwork, road: str, lane: int) -> float:
    """Give by how much [rad] a lane of a road turns, to the left positive."""
    s = np.linspace(1e-6, network.roads[road].length - 1e-6, 200)
    sign = 1.0 if lane < 0 else -1.0
    heading = np.unwrap(network.lane_heading(np.full(200, road), np.full(200, lane), s))
    return sign * float(heading[-1] - heading[0])


@cache
def crossing_junctions(network: RoadNetwork) -> set[str]:
    """Give the junctions of which a road turns as at a crossing."""
    out = set()
    for name, road in network.roads.items():
        numbers = [n for n, lane in road.sections[0].lanes.items() if n and lane.type in DRIVEN]
        if road.junction is None or not numbers or road.length < 0.1:
            continue
        if len(road.sections) > 1:
            s = np.linspace(1e-6, road.length - 1e-6, 200)
            heading = np.unwrap(network.reference_line(np.full(200, name), s)[2])
            turn = abs(float(heading[-1] - heading[0]))
        else:
            turn = max(abs(turned(network, name, number)) for number in numbers)
        if turn > BENDS and road.length <= TIGHT * turn:
            out.add(road.junction)
    return out


def way_through(network: RoadNetwork, way: Way, counts: set[str]) -> Ground | None:
    """Give the ground of a way through a junction with its arms; None where these are too short."""
    before, lane, inside, inner_lane, after, turn = way
    own, inner, other = (network.roads[name] for name in (before, inside, after))
    arm = min(ARM, _alike(network, before, lane) - 2.0)
    if arm < SHORTEST_ARM or other.length < SHORTEST_ARM + 2.0 or inner.junction not in counts:
        return None
    if inner.length < SHORTEST_INSIDE or not _meets(network, way):
        return None
    start = own.length - arm if lane < 0 else arm
    route = Route(((before,), (inside,), (after,)))
    path = lane_path(network, before, lane, start, arm + inner.length + min(ARM, other.length - 2.0),
                     behind=BEHIND, step=STEP, route=route)  # fmt: skip
    if path.ends or path.end < arm + inner.length + SHORTEST_ARM:
        return None
    label = "straight" if abs(turn) <= BENDS else "turn_left" if turn > 0.0 else "turn_right"
    label = "u_turn" if abs(turn) >= U_TURN else label
    x, y = _ends(network, inside, inner_lane)
    begin, end = path.project(x, y)[0].tolist()
    half = float(path.half_width.min())
    lanes = (StripLane(half, -half, True, "driving"),)
    types = [one.types[0].type if one.types else "" for one in (own, inner, other)]
    types_along = tuple(zip((begin, end, np.inf), types, strict=True))
    return Ground(
        network, path, float(path.s[-1]), lanes, 0, types_along, ((begin, end, label),),
        crossings=_crossings(network, (before, after), (begin, end), counts),
        counts=_counts_behind(network, path, after, end), turn=turn,
        junction=inner.junction, before=before, signs=signs_of(network, before, lane, inside),
    )  # fmt: skip


def _meets(network: RoadNetwork, way: Way) -> bool:
    """Whether the lane before a junction ends where that inside begins."""
    s = network.roads[way.before].length - 1e-6 if way.lane < 0 else 1e-6
    x, y = network.to_xy(np.array([way.before]), np.array([way.lane]), np.array([s]), np.zeros(1))
    x1, y1 = _ends(network, way.inside, way.inner)
    return bool(np.hypot(x[0] - x1[0], y[0] - y1[0]) <= GAP)


def free_beside(ground: Ground, side: int) -> bool:
    """Say whether no driven lane of any road lies up to 2 m beyond the left (0) or right (1) edge of a ground."""
    s = np.arange(0.0, ground.length, 0.5)
    for away in (0.2, 0.8, 1.4, 2.0):
        aside = ground.lanes[0].left + away if side == 0 else ground.lanes[-1].right - away
        x, y = ground.path.xy(s, np.full(len(s), aside))
        found = ground.network.lanes_at(x, y)
        if any(ground.network.lane_table.types[row] in DRIVEN for row in found.row.tolist()):
            return False
    return True


def _crossings(
    network: RoadNetwork, arms: tuple[str, str], inside: tuple[float, float], counts: set[str]
) -> tuple[tuple[float, float], ...]:
    """The crossing of a way, and those at the other ends of the roads before and behind it."""
    out = [inside]
    elements = roads(network)
    lengths = [float(elements[name].get("length")) for name in arms]
    if all(crossed_ends(elements[arms[0]], counts)):
        out.append((-np.inf, inside[0] - lengths[0]))
    if all(crossed_ends(elements[arms[1]], counts)):
        out.append((inside[1] + lengths[1], np.inf))
    return tuple(out)


def _alike(network: RoadNetwork, road: str, lane: int) -> float:
    """How long [m] a lane, with all driven lanes of its road, stays the same before the road's end."""
    parts = sections(roads(network)[road])
    parts = parts[::-1] if lane < 0 else parts
    lanes = [
        sorted(int(one.get("id")) for one in part.iterfind(".//lane") if one.get("type") in DRIVEN)
        for _, _, part in parts
    ]
    out = 0.0
    for (begin, end, _), here in zip(parts, lanes, strict=True):
        if here != lanes[0]:
            break
        out += end - begin
    return out


def _counts_behind(
    network: RoadNetwork, path: LanePath, road: str, end: float
) -> tuple[tuple[float, int], ...]:
    """Where along a line the road behind a junction, entered at `end` [m], gets or loses lanes."""
    element, out = roads(network)[road], []
    length = float(element.get("length"))
    x, y = network.to_xy(np.full(2, road), np.zeros(2, int), np.array([1e-6, length - 1e-6]), np.zeros(2))
    x0, y0 = path.xy(np.array([end]), np.zeros(1))
    right = np.hypot(x[0] - x0[0], y[0] - y0[0]) < np.hypot(x[1] - x0[0], y[1] - y0[0])
    for s, change in lane_counts(element, bool(right)):
        x, y = network.to_xy(np.array([road]), np.array([0]), np.array([s]), np.zeros(1))
        at = float(path.project(np.asarray(x), np.asarray(y))[0][0])
        if end < at < path.s[-1] - 1.0:
            out.append((at, change if right else -change))
    return tuple(out)


def _ends(network: RoadNetwork, road: str, lane: int) -> tuple[np.ndarray, np.ndarray]:
    s = np.array([1e-6, network.roads[road].length - 1e-6])
    x, y = network.to_xy(np.full(2, road), np.full(2, lane), s, np.zeros(2))
    return np.asarray(x), np.asarray(y)
