"""The lane beside somebody on the map: whether there is one to go to, where it is, and where it ends."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats
from resim.road.lane_following import RouteStretch, follow
from resim.road.opendrive import Road, RoadNetwork
from resim.road.path import Path, lane_path

Side = Literal["left", "right"]
_SPARE = 0.5
"""m by which a lane is wider than who goes to it, at least."""
_EVERY, _LONG = 50.0, 100.0
"""m to which the start and the length of a lane's path are rounded, so that many ask for the same one."""
_BEHIND = 150.0
"""m of the lane behind its start that are known."""
_ALONG = 0.25 * math.pi
"""rad by which the heading of who drives along a lane is off it at most."""
_SAMPLE = 5.0
"""m between places at which a lane's width is looked at."""


@dataclass(frozen=True, eq=False)
class Neighbour:
    """A lane beside somebody. path: along its centre. s: m along it, where he is. left: m from there to its end."""

    path: Path
    s: float
    left: float

    def places(self, position: NDArray[np.complex128]) -> tuple[Floats, Floats]:
        """Give how far [m] ahead, and to the left of the lane's centre, positions (M,) are."""
        s, d = self.path.project(position.real, position.imag)
        return s - self.s, d


def neighbour(
    network: RoadNetwork,
    state: tuple[float, float, float, float],
    width: float,
    side: Side,
    length: float,
    crossed: float,
) -> Neighbour | None:
    """Give the lane beside who is at `state`: x, y [m], heading [rad], z [m, NaN unknown]; one of its direction.

    width: m, of who wants to go there. length: m along it that matter. crossed: m within which it is to be there.

    None where there is no lane, or a solid line in between. The lane ends where it does on the map, where it gets too
    narrow, and where it comes to a junction: whoever is in one stays in its lane.
    """
    here = _place(network, state)
    if here is None:
        return None
    name, lane, s = here
    road = network.roads[name]
    section = road.section_index(s)
    other = _other(road, section, lane, side)
    if other is None:
        return None
    left = _left(
        network, (name, other, s), width + _SPARE, length, crossed if abs(other) < abs(lane) else -crossed
    )
    if left <= 0.0:
        return None
    path = lane_path(
        network, name, other, _begin(road, section, other, s), _LONG * math.ceil((length + 2.0 * _EVERY) / _LONG),
        behind=_BEHIND,
    )  # fmt: skip
    return Neighbour(path, float(path.project(state[0], state[1])[0][0]), left)


def _place(network: RoadNetwork, state: tuple[float, float, float, float]) -> tuple[str, int, float] | None:
    """Road, lane and s [m] of who drives along a lane outside of junctions; else None."""
    x, y, heading, z = state
    here = network.to_road(x, y, heading=heading, z=None if math.isnan(z) else z)
    name, lane, s = str(here.road[0]), int(here.lane[0]), float(here.s[0])
    if not here.on_road[0] or network.roads[name].junction is not None:
        return None
    off = math.remainder(heading - float(network.lane_heading(name, lane, s)), math.tau)
    return None if abs(off) > _ALONG else (name, lane, s)


def _other(road: Road, section: int, lane: int, side: Side) -> int | None:
    """The lane beside a lane, None where there is none of its direction."""
    along = road.along(lane, section)
    other = lane + (1 if along == (side == "left") else -1)
    found = road.sections[section].lanes.get(other)
    one_way = (
        found is not None and found.drivable and lane * other > 0 and road.along(other, section) == along
    )
    return other if one_way else None


def _begin(road: Road, section: int, lane: int, s: float) -> float:
    """Where on the road the path of a lane begins, for who is at s [m]: a round place at or behind it."""
    if road.along(lane, section):
        return max(_EVERY * math.floor(s / _EVERY), road.sections[section].start)
    return min(_EVERY * math.ceil(s / _EVERY), max(road.sections[section].end - 1e-6, s), road.length)


def _left(
    network: RoadNetwork, start: tuple[str, int, float], width: float, length: float, crossed: float
) -> float:
    """How far [m] a lane goes on from (road, lane, s), up to `length` or more; 0 where a solid line is before it.

    crossed: m within which one comes to it, from farther out on the road; negative from farther in.
    """
    left = 0.0
    for stretch in follow(network, *start, ahead=True):
        rest = abs(crossed) - left
        if rest > 0.0 and _marked(network) and _solid(network, stretch, crossed > 0.0, rest):
            return 0.0
        free = _free(network, stretch, width)
        left += free
        if free < stretch.length or left >= length:
            break
    return left


def _free(network: RoadNetwork, stretch: RouteStretch, width: float) -> float:
    """How far [m] a lane is as wide as that [m] from the stretch's begin on, outside of junctions."""
    if network.roads[stretch.road].junction is not None:
        return 0.0
    at = np.linspace(stretch.s_from, stretch.s_to, max(math.ceil(stretch.length / _SAMPLE), 1) + 1)
    at[-1] += 1e-6 * math.copysign(1.0, stretch.s_from - stretch.s_to)
    narrow = network.lane_width(stretch.road, stretch.lane, at) < width
    return float(abs(at[np.argmax(narrow)] - at[0])) if narrow.any() else stretch.length


def _solid(network: RoadNetwork, stretch: RouteStretch, inwards: bool, length: float) -> bool:
    """Whether a solid line parts a lane from the one beside it within length [m] of the stretch's begin."""
    section = network.roads[stretch.road].sections[stretch.section]
    outer = stretch.lane if inwards else stretch.lane - int(math.copysign(1.0, stretch.lane))
    if outer not in section.lanes:
        return False
    way = math.copysign(min(length, stretch.length), stretch.s_to - stretch.s_from)
    low, high = sorted((stretch.s_from - section.start, stretch.s_from + way - section.start))
    marks = section.lanes[outer].marks
    ends = [*(mark.s_offset for mark in marks[1:]), math.inf]
    return any(
        "solid" in mark.type and mark.s_offset < high and end > low
        for mark, end in zip(marks, ends, strict=True)
    )


@lru_cache(maxsize=64)
def _marked(network: RoadNetwork) -> bool:
    """Whether a map's marks tell something: converters of maps that have none write solid lines everywhere."""
    return any(
        "broken" in mark.type
        for road in network.roads.values()
        for section in road.sections
        for lane in section.lanes.values()
        for mark in lane.marks
    )
