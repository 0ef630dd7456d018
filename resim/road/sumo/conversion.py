"""How exact a converted net is: every lane of the map against the SUMO lanes that stand for it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import shapely
from lxml import etree

from resim.core import spec
from resim.core.geometry import Floats
from resim.road.links import LaneKey
from resim.road.opendrive import RoadNetwork
from resim.road.sumo.patch import Via
from resim.road.sumo.pieces import SHORTEST
from resim.road.sumo.plain import PlainNetwork
from resim.road.sumo.shapes import LaneStretch
from resim.road.sumo.taken import TakenRules
from resim.road.sumo.truth import RawLanes

EXACT = 0.005
VARIED = 0.01
"""Largest errors [m] of a centre line: of lanes of one width, and of those that taper or shift."""

JUMP = 0.1
"""Distance [m] between the ends of linked lanes from which on the map has a gap there."""

CHECK_STEP = 0.13
"""Another step [m] than the one the shapes were made with, so that the check looks between their points."""

ONE_WIDTH = 1e-3


@dataclass(frozen=True)
class LaneError:
    """The error of one lane: distances [m] between its exact centre line and that of its SUMO lanes, both ways.

    sumo: ids, none where the lane is missing in the net. s, x, y [m]: where the worst is. limit [m]: what is
    allowed. remark: why it is missing.
    """

    road: str
    section: int
    lane: int
    type: str
    junction: str | None
    sumo: tuple[str, ...]
    length: float
    worst: float | None
    mean: float | None
    limit: float
    s: float
    x: float
    y: float
    remark: str = ""

    @property
    def key(self) -> LaneKey:
        """Road, section and lane."""
        return LaneKey(self.road, self.section, self.lane)

    @property
    def good(self) -> bool:
        """Whether the lane is in the net, within its limit."""
        return self.worst is not None and self.worst <= self.limit


@dataclass(frozen=True)
class Jump:
    """Linked lanes whose ends lie apart: the map has a gap [m] there that SUMO bridges. x, y [m]: its place."""

    origin: str
    target: str
    gap: float
    x: float
    y: float


@dataclass(frozen=True)
class Conversion:
    """What became of a map. lanes: worst first, missing ones before. connections: linked pairs of SUMO lanes.

    lost: links of lanes that netconvert made no connection of, in words. simulated: the largest error [m] of a lane
    of the net that is simulated in, which has the same lanes with fewer points. rules: what became of the map's traffic
    lights, signs and priorities.
    """

    __pydantic_config__ = spec.EXACT

    lanes: tuple[LaneError, ...]
    connections: int
    jumps: tuple[Jump, ...]
    lost: tuple[str, ...] = ()
    simulated: float = 0.0
    rules: TakenRules = field(default_factory=TakenRules)

    @property
    def bad(self) -> tuple[LaneError, ...]:
        """The lanes that are missing or not exact, worst first."""
        return tuple(lane for lane in self.lanes if not lane.good)

    @property
    def worst(self) -> float:
        """The largest error [m] of a lane that is there."""
        return max((lane.worst for lane in self.lanes if lane.worst is not None), default=0.0)

    @property
    def mean(self) -> float:
        """The mean error [m] along all lanes that are there."""
        there = [(lane.mean, lane.length) for lane in self.lanes if lane.mean is not None]
        total = sum(length for _, length in there)
        return sum(mean * length for mean, length in there) / total if total else 0.0


class _ComparedLane(NamedTuple):
    """What was compared of a lane: K exact places, at s (K,), against the net, and M points of the net against it.

    distance: (K + M,) m; xy: (K + M, 2) m; line: the exact centre line, in driving direction.
    """

    stretch: LaneStretch
    sumo: tuple[str, ...]
    width: Floats
    s: Floats
    distance: Floats
    xy: Floats
    line: shapely.LineString

    def place(self, i: int) -> float:
        """Give the s [m] of comparison i."""
        if i < len(self.s):
            return float(self.s[i])
        share = shapely.line_locate_point(self.line, shapely.Point(self.xy[i]), normalized=True)
        low, high = self.stretch.start, self.stretch.end
        return float(low + share * (high - low) if self.stretch.forward else high - share * (high - low))


def measure(network: RoadNetwork, net: bytes, made: PlainNetwork, via: Via) -> Conversion:
    """Compare the net, as written, with the map's file, read anew; lane sections without length are left out.

    Of `network`, which made the net, it takes the types of lanes and the junctions of roads only.
    """
    truth = RawLanes(network.path)
    found: dict[LaneKey, list[_ComparedLane]] = defaultdict(list)
    for each in _compared(truth, net_shapes(net), _uses(made, via)):
        found[each.stretch.key].append(each)
    whole = [LaneStretch(*lane, forward=True) for lane in truth.lanes()]
    whole = [stretch for stretch in whole if stretch.end - stretch.start > SHORTEST]
    there = [c for c in made.connections if (c.origin, c.target) in via]
    lost = [c for c in made.connections if (c.origin, c.target) not in via]
    off = {key for c in lost for key in c.way}
    lanes = [
        _error(network, each, found[each.key]) if found[each.key]
        else _missing(network, truth, each, lost=each.key in off)
        for each in whole
    ]  # fmt: skip
    lanes.sort(key=lambda lane: -(lane.worst if lane.worst is not None else np.inf))
    links = [f"{made.lanes[c.origin].stretch.key} to {made.lanes[c.target].stretch.key}" for c in lost]
    jumps = [
        Jump(c.origin, c.target, round(c.jump, 6), *(round(float(v), 3) for v in c.line[0]))
        for c in there if c.jump > JUMP
    ]  # fmt: skip
    jumps.sort(key=lambda jump: -jump.gap)
    return Conversion(tuple(lanes), len(there), tuple(jumps), tuple(links))


def _uses(made: PlainNetwork, via: Via) -> dict[tuple[str, ...], list[LaneStretch]]:
    """The stretches that each SUMO lane, or the internal lanes of a connection, stand for."""
    uses: dict[tuple[str, ...], list[LaneStretch]] = {
        (name,): [own.stretch] for name, own in made.lanes.items()
    }
    for connection in made.connections:
        if connection.stretches and (connection.origin, connection.target) in via:
            uses[via[connection.origin, connection.target]] = list(connection.stretches)
    return uses


def _compared(
    truth: RawLanes, shapes: Mapping[str, Floats], uses: Mapping[tuple[str, ...], list[LaneStretch]]
) -> Iterator[_ComparedLane]:
    """Compare both ways: places on the exact lane with the net, and the points of the net with the lane."""
    stretches = [stretch for own in uses.values() for stretch in own]
    if not stretches:
        return
    exact = truth.sample(stretches, CHECK_STEP)
    number = np.repeat(np.arange(len(stretches)), np.diff(exact.first))
    lines = shapely.linestrings(exact.xy, indices=number)
    at = 0
    for names, own in uses.items():
        points = np.concatenate([shapes[name] for name in names])
        rows = np.arange(at, at + len(own))
        at += len(own)
        back = shapely.distance(lines[rows][:, None], shapely.points(points)[None, :])
        nearest = back.argmin(axis=0)
        net = shapely.linestrings(points)
        for i, (row, stretch) in enumerate(zip(rows, own, strict=True)):
            part = slice(exact.first[row], exact.first[row + 1])
            xy, mine = exact.xy[part], nearest == i
            distance = np.concatenate([shapely.distance(net, shapely.points(xy)), back[i, mine]])
            yield _ComparedLane(stretch, names, exact.width[part], exact.s[part], distance,
                         np.concatenate([xy, points[mine]]), lines[row])  # fmt: skip


def _error(network: RoadNetwork, whole: LaneStretch, found: list[_ComparedLane]) -> LaneError:
    key = whole.key
    found = sorted(found, key=lambda f: f.stretch.start if f.stretch.forward else -f.stretch.start)
    worst = max(found, key=lambda f: float(f.distance.max()))
    at = int(worst.distance.argmax())
    parts = {f.stretch: f for f in found}.values()  # ways through a junction may pass one lane several times
    width = np.concatenate([f.width for f in parts])
    road = network.roads[key.road]
    length = sum(f.stretch.end - f.stretch.start for f in parts)
    lost = abs(whole.end - whole.start - length)
    return LaneError(
        *key, road.sections[key.section].lanes[key.lane].type, road.junction,
        tuple(dict.fromkeys(name for f in found for name in f.sumo)), round(length, 3),
        round(max(float(worst.distance[at]), lost), 6),
        round(float(np.concatenate([f.distance[: len(f.s)] for f in parts]).mean()), 6),
        EXACT if np.ptp(width) < ONE_WIDTH else VARIED,
        round(worst.place(at), 3), round(float(worst.xy[at, 0]), 3), round(float(worst.xy[at, 1]), 3),
        f"{lost:.3f} m of it are missing from the net" if lost > EXACT else "",
    )  # fmt: skip


def _missing(network: RoadNetwork, truth: RawLanes, whole: LaneStretch, *, lost: bool) -> LaneError:
    road, (x, y) = network.roads[whole.road], truth.sample([whole], whole.end - whole.start).xy[0]
    return LaneError(
        *whole.key, road.sections[whole.section].lanes[whole.lane].type, road.junction, (),
        round(whole.end - whole.start, 3), None, None, EXACT, round(whole.start, 3), round(x, 3), round(y, 3),
        "netconvert makes no connection for the link across it" if lost
        else "another path through the junction links the same lanes",
    )  # fmt: skip


def net_shapes(net: bytes) -> dict[str, Floats]:
    """Give the points (K, 2) [m] of each lane of a net, as it is written."""
    root = etree.fromstring(net)
    return {
        str(lane.get("id")): np.array([p.split(",")[:2] for p in str(lane.get("shape")).split()], dtype=float)
        for lane in root.iter("lane")
    }
