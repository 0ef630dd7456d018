"""The lanes ahead of objects, for predictions that know the road.

Wagner 2021 names what the prediction lacks: it leaves the road, and at the entry of a curve goes straight on. A
sample that knows the road moves with constant turn rate and acceleration (Eq. 4.1) in the straightened frame of the
lane that it is on (s along the centre, d to the left), its turn rate less that of the lane. So who drives neutrally
follows the curve. It stays on what vehicles may drive on: its side is held at the edge.

The edge is that of all lanes side by side that vehicles drive on, those of the other direction too: who cuts a curve
or overtakes must be seen. In a junction there is no edge, and where lanes of another road begin within a metre of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from resim.core.errors import ResimError
from resim.core.geometry import Bools, Floats, wrap_angle
from resim.road.links import Graph, LaneKey, lane_graph
from resim.road.opendrive import RoadNetwork
from resim.road.path import Path

Ints = NDArray[np.int64]

STEP = 1.0
"""Distance [m] of a way's points."""
LOOK = 10.0
"""To how many metres behind and ahead of a place its heading and curvature are meant."""
MOST = 8
"""Ways on from one lane; where it leads into more, the first that the file names."""
HARDEST = 4.0
"""Acceleration [m/s²] for which ways are long enough; faster ones end straight."""
FREE = 1e3
"""Room [m] where there is no edge."""
BEYOND = (0.3, 0.65, 1.0)
"""m beyond an edge at which another road's lane makes it none."""
INSIDE = 1e-8

Sampled = tuple[Floats, ...]
"""x, y, heading, room to the left and to the right."""


@dataclass(frozen=True, eq=False)
class LanePaths:
    """Lane centre lines ahead of objects.

    points: (P, 7) x, y [m], cosine and sine of the heading, curvature [1/m], room to the left and to the right of the
    centre [m]; of all ways one after another, every STEP. begin: (W + 1,) the first point of each. first, count:
    (S, K) the ways of an object, count 0 where it has none. s, d: (S, K) m, where it is on each of them.
    """

    points: Floats
    begin: Ints
    first: Ints
    count: Ints
    s: Floats
    d: Floats

    def __post_init__(self) -> None:
        shape = self.first.shape
        if not all(value.shape == shape for value in (self.count, self.s, self.d)):
            raise ResimError(f"ways: first, count, s and d need one shape, that of first is {shape}")

    @staticmethod
    def none(shape: tuple[int, int]) -> LanePaths:
        """Give no way for anybody."""
        number, place = (np.zeros((2, *shape), dtype=kind) for kind in (np.int64, np.float64))
        return LanePaths(np.zeros((0, 7)), np.zeros(1, dtype=np.int64), *number, *place)


def lane_paths(
    network: RoadNetwork, state: Floats, size: Floats, *, horizon: float, z: Floats | None = None
) -> LanePaths:
    """Give the ways of objects in scenes: state (S, K, 6), size (S, K, 2), as far as they come in `horizon` [s].

    z: heights (S, K) [m] of the road under them, if known.

    Who is on no lane that vehicles drive on, or faces against his lane by more than 90 degrees, has none.
    """
    out = LanePaths.none((state.shape[0], state.shape[1]))
    who = np.argwhere((size[..., 0] > 0.0) & np.isfinite(state[..., :4]).all(axis=2))
    if not len(who):
        return out
    x, y, heading, v = state[who[:, 0], who[:, 1], :4].T
    at = network.to_road(x, y, heading=heading, z=None if z is None else z[who[:, 0], who[:, 1]])
    there = np.flatnonzero(at.on_road)
    turned = wrap_angle(heading[there] - network.lane_heading(at.road[there], at.lane[there], at.s[there]))
    there = there[np.abs(turned) <= 0.5 * np.pi]
    parts: list[Floats] = []
    begin = [0]
    for key, rows in _by_lane(network, at.road, at.lane, at.s, there):
        reach = float(np.abs(v[rows]).max()) * horizon + 0.5 * HARDEST * horizon**2
        made = [_resampled(_joined(network, route)) for route in _routes(network, key, reach)]
        s, d = _as_path(made[0]).project(x[rows], y[rows])
        n, k = who[rows].T
        out.first[n, k], out.count[n, k] = len(begin) - 1, len(made)
        out.s[n, k], out.d[n, k] = s, d
        parts += made
        begin += (begin[-1] + np.cumsum([len(way) for way in made])).tolist()
    points = np.concatenate(parts) if parts else out.points
    return LanePaths(points, np.array(begin, dtype=np.int64), out.first, out.count, out.s, out.d)


def _by_lane(
    network: RoadNetwork, road: NDArray[np.str_], lane: Ints, s: Floats, there: NDArray[np.intp]
) -> Iterator[tuple[LaneKey, NDArray[np.intp]]]:
    """Every lane of a section that somebody is on, with the rows of those who are."""
    section = np.zeros(len(s), dtype=np.int64)
    for name in np.unique(road[there]):
        starts = [part.start for part in network.roads[str(name)].sections]
        mine = there[road[there] == name]
        section[mine] = np.clip(np.searchsorted(starts, s[mine], side="right") - 1, 0, None)
    keys = [LaneKey(str(road[i]), int(section[i]), int(lane[i])) for i in there]
    for key in dict.fromkeys(keys):
        yield key, there[np.array([other == key for other in keys], dtype=bool)]


@lru_cache(maxsize=4)
def _graph(network: RoadNetwork) -> Graph:
    return lane_graph(network)


def _routes(network: RoadNetwork, start: LaneKey, reach: float) -> list[tuple[LaneKey, ...]]:
    """The lanes from this one on, till they are `reach` [m] beyond its end or lead nowhere; at most MOST routes."""
    graph = _graph(network)
    out: list[tuple[LaneKey, ...]] = []
    stack: list[tuple[tuple[LaneKey, ...], float]] = [((start,), 0.0)]
    while stack and len(out) < MOST:
        route, length = stack.pop()
        after = [key for key in graph[route[-1]] if _drivable(network, key)] if length < reach else []
        if not after:
            out.append(route)
        stack += [((*route, key), length + _length(network, key)) for key in reversed(after)]
    return out


def _drivable(network: RoadNetwork, key: LaneKey) -> bool:
    return network.roads[key.road].sections[key.section].lanes[key.lane].drivable


def _length(network: RoadNetwork, key: LaneKey) -> float:
    road = network.roads[key.road]
    section = road.sections[key.section]
    return max(min(section.end, road.length) - section.start, INSIDE)


@lru_cache(maxsize=4096)
def _lane(network: RoadNetwork, key: LaneKey) -> Sampled:
    """The centre of a lane in driving direction."""
    road, length = network.roads[key.road], _length(network, key)
    start = road.sections[key.section].start
    count = max(int(np.ceil(length / STEP)), 1)
    s = start + np.linspace(0.0, max(length - INSIDE, 0.5 * length), count + 1)
    along = road.along(key.lane, key.section)
    x, y = network.to_xy(key.road, key.lane, s, 0.0)
    left, right = _room(network, key, s)
    if not along:
        left, right = right, left
    heading = network.lane_heading(key.road, key.lane, s)
    if road.junction is None:
        left, right = (
            _open(network, (x, y, heading), room, side) for room, side in ((left, 1.0), (right, -1.0))
        )
    columns = (x, y, heading, left, right)
    return columns if along else tuple(column[::-1] for column in columns)


def _room(network: RoadNetwork, key: LaneKey, s: Floats) -> tuple[Floats, Floats]:
    """Room (K,) [m] from the lane's centre to the edge on the left and right of the road's direction."""
    road = network.roads[key.road]
    if road.junction is not None:
        return np.full(len(s), FREE), np.full(len(s), FREE)
    lanes = road.sections[key.section].lanes
    order = sorted((lane for lane in lanes if lane != 0), reverse=True)  # from left to right
    at = order.index(key.lane)
    own = 0.5 * network.lane_width(key.road, key.lane, s)
    sides = []
    for side in (order[:at][::-1], order[at + 1 :]):
        room = own.copy()
        for lane in side:
            if not lanes[lane].drivable:
                break
            room += network.lane_width(key.road, lane, s)
        sides.append(room)
    return sides[0], sides[1]


def _open(network: RoadNetwork, centre: Sampled, room: Floats, side: float) -> Floats:
    """Room (K,) [m], FREE where a lane that vehicles drive on lies beyond the edge: asphalt may be drawn as two roads.

    centre: x, y, heading (K,) of the lane's centre as it is driven. side: 1 to the left, -1 to the right.
    """
    x, y, heading = centre
    out = room.copy()
    for beyond in BEYOND:
        away = side * (room + beyond)
        found = network.driving_lanes(x - away * np.sin(heading), y + away * np.cos(heading))
        out[np.unique(found.point)] = FREE
    return out


def _joined(network: RoadNetwork, route: tuple[LaneKey, ...]) -> Sampled:
    """The centre line of a route, without points that do not lie ahead of the one before."""
    table = np.stack(
        [np.concatenate(column) for column in zip(*(_lane(network, key) for key in route), strict=True)]
    )
    keep: Bools = np.ones(table.shape[1], dtype=bool)
    while True:
        x, y, heading = table[:3, keep]
        ahead = np.diff(x) * np.cos(heading[:-1]) + np.diff(y) * np.sin(heading[:-1]) > 1e-3
        if ahead.all():
            return tuple(table[:, keep])
        keep[np.flatnonzero(keep)[1:][~ahead]] = False


def _resampled(line: Sampled) -> Floats:
    """Points (K, 7) of a way, see `LanePaths`, at even distances along it."""
    x, y, heading, left, right = line
    if len(x) < 2:
        x, y = np.r_[x, x + np.cos(heading)], np.r_[y, y + np.sin(heading)]
        heading, left, right = (np.repeat(column, 2) for column in (heading, left, right))
    along = np.r_[0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y)))]
    s = np.arange(0.0, max(along[-1], STEP) + 1e-9, STEP)
    px, py, turn = (np.interp(s, along, column) for column in (x, y, np.unwrap(heading)))
    turn, bend = _smooth(px, py, turn)
    room = [np.interp(s, along, column) for column in (left, right)]
    return np.stack([px, py, np.cos(turn), np.sin(turn), bend, *room], axis=1)


def _smooth(x: Floats, y: Floats, heading: Floats) -> tuple[Floats, Floats]:
    """Heading and curvature (K,) as a driver sees them, over LOOK [m] to either side; measured maps have noise."""
    at, last = np.arange(len(x)), len(x) - 1
    half = np.minimum(np.minimum(at, last - at), round(LOOK / STEP))
    dx, dy = x[at + half] - x[at - half], y[at + half] - y[at - half]
    chord = np.where(half > 0, np.arctan2(dy, dx), heading)
    turn: Floats = np.asarray(np.unwrap(chord), dtype=np.float64)
    low, high = np.maximum(at - round(LOOK / STEP), 0), np.minimum(at + round(LOOK / STEP), last)
    return turn, (turn[high] - turn[low]) / (STEP * np.maximum(high - low, 1))


def _as_path(points: Floats) -> Path:
    """The way as a path that places can be projected on."""
    zero, s = np.zeros(len(points)), np.linspace(0.0, STEP * (len(points) - 1), len(points))
    heading: Floats = np.asarray(np.unwrap(np.arctan2(points[:, 3], points[:, 2])), dtype=np.float64)
    x, y, curvature = points[:, 0].copy(), points[:, 1].copy(), points[:, 4].copy()
    return Path(s, x, y, heading, curvature, zero, zero, zero, zero, ends=True, end=float(s[-1]))
