"""A route's centre line in driving direction, as AD functions follow it."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from resim.core.errors import InputError
from resim.core.geometry import Floats, constant, sealed
from resim.road.driven_route import NO_ROUTE, Route
from resim.road.lane_following import SHORTEST, RouteStretch, follow
from resim.road.opendrive import RoadNetwork

FAR = 1e4
SPIKE = 0.5
MOST_ASTRAY = 8


class PathPoint(NamedTuple):
    """A path at one or more s: position [m], heading [rad], curvature [1/m], widths [m], limit [m/s]."""

    x: float
    y: float
    heading: float
    curvature: float
    left_width: float
    right_width: float
    half_width: float
    speed_limit: float


@dataclass(frozen=True, eq=False)
class Path:
    """K points along the centre of a lane and what it goes on into, in driving direction; all (K,).

    s: m along the path, 0 at the start position. heading: rad, unwrapped. curvature: 1/m, left positive.
    left_width, right_width: m, of the neighbouring driving lane of the same driving direction, 0 where
    there is none. half_width: m, of the own lane. speed_limit: m/s, NaN where none.
    ends: the road ends before the length asked for; from `end` [m] on the path goes straight on.
    """

    s: Floats
    x: Floats
    y: Floats
    heading: Floats
    curvature: Floats
    left_width: Floats
    right_width: Floats
    half_width: Floats
    speed_limit: Floats
    ends: bool
    end: float

    def project(self, x: ArrayLike, y: ArrayLike) -> tuple[Floats, Floats]:
        """Give s and d (N,) [m] of positions (N,); d is positive to the left.

        The foot lies where the normal, turned evenly from point to point, meets the position, so s and d
        are continuous, and `xy` inverts them. Beyond its ends the path is straight.
        """
        search = self._search
        x_, y_ = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
        if x_.size != y_.size:
            raise ValueError(f"x and y are not equally many: {x_.shape}, {y_.shape}")
        s, d = search.project(search.table, search.scores, x_.ravel(), y_.ravel())
        return s, d

    def track(self, x: float, y: float, i: int = -1) -> tuple[float, float, float, int]:
        """Give s, d [m] and the path's heading there [rad] for one moving point, as `project`, and its segment.

        i: the segment that the point's call before gave, to look from there; -1 to look everywhere.
        """
        search = self._search
        return search.track(search.table, search.scores, i, x, y)

    def xy(self, s: ArrayLike, d: ArrayLike) -> tuple[Floats, Floats]:
        """Give the map positions [m] at s, d metres to the left; inverse of `project`."""
        search = self._search
        s_, d_ = np.asarray(s, dtype=float), np.asarray(d, dtype=float)
        if s_.shape != d_.shape:
            s_, d_ = np.broadcast_arrays(s_, d_)
        x, y = search.positions(search.table, s_.flatten(), d_.flatten()).reshape(2, *s_.shape)
        return x, y

    def at(self, s: float) -> PathPoint:
        """Give the path at one s [m], linear between points (speed_limit: of the point before)."""
        stations, rows, rises = self._rows
        i = min(max(bisect_right(stations, s) - 1, 0), len(stations) - 2)
        f = min(max((s - stations[i]) / (stations[i + 1] - stations[i]), 0.0), 1.0)
        point = [a + f * b for a, b in zip(rows[i], rises[i], strict=True)]
        if s < stations[0] or s > stations[-1]:
            x, y = self.xy(s, 0.0)
            point[:4] = float(x), float(y), point[2], 0.0
        return PathPoint._make([*point, self._limits[i + (f == 1.0)]])

    def curvature_at(self, s: ArrayLike) -> Floats:
        """Give the curvatures (N,) [1/m] at s (N,) [m], linear between points, those of the ends beyond them."""
        s_ = np.atleast_1d(np.asarray(s, dtype=float))
        i = np.minimum(np.maximum(self.s.searchsorted(s_, "right") - 1, 0), len(self.s) - 2)
        f = np.minimum(np.maximum((s_ - self.s[i]) / (self.s[i + 1] - self.s[i]), 0.0), 1.0)
        return np.asarray(self.curvature[i] + f * (self.curvature[i + 1] - self.curvature[i]))

    def speed_limit_at(self, s: ArrayLike) -> Floats:
        """Give the speed limits (N,) [m/s] at s (N,) [m], NaN where there is none."""
        s_ = np.atleast_1d(np.asarray(s, dtype=float))
        return np.asarray(self.speed_limit[np.maximum(self.s.searchsorted(s_, "right") - 1, 0)])

    @cached_property
    def _rows(self) -> tuple[list[float], list[list[float]], list[list[float]]]:
        columns = [self.x, self.y, self.heading, self.curvature]
        table = np.stack([*columns, self.left_width, self.right_width, self.half_width], axis=1)
        return self.s.tolist(), table.tolist(), np.diff(table, axis=0).tolist()

    @cached_property
    def _limits(self) -> list[float]:
        limits: list[float] = self.speed_limit.tolist()
        return limits

    @property
    def search_table(self) -> tuple[Floats, Floats]:
        """A row per segment: what `resim.road.kernel.foot` and `track` take."""
        return self._search.table, self._search.scores

    @cached_property
    def _search(self) -> _ProjectionSearch:
        return _search(self)


class _ProjectionSearch(NamedTuple):
    """What `project` needs, with a far point added to either end: K + 1 segments.

    table: (K + 1, 10), per segment s, x, y, tx, ty where it starts (tx, ty: tangent), then what each gains over it.
    scores: (K + 1, 3), gives of (x, y, 1) the squared distance to the middles, less a constant. project, track,
    positions: what is compiled to work on them.
    """

    table: Floats
    scores: Floats
    project: Callable[..., Floats]
    track: Callable[..., tuple[float, float, float, int]]
    positions: Callable[..., Floats]


def _search(path: Path) -> _ProjectionSearch:
    # compiled: numba is imported where it is used only
    from resim.road import kernel

    tx, ty = np.cos(path.heading), np.sin(path.heading)
    x = np.r_[path.x[0] - FAR * tx[0], path.x, path.x[-1] + FAR * tx[-1]]
    y = np.r_[path.y[0] - FAR * ty[0], path.y, path.y[-1] + FAR * ty[-1]]
    s = np.r_[path.s[0] - FAR, path.s, path.s[-1] + FAR]
    starts = (s, x, y, np.r_[tx[0], tx, tx[-1]], np.r_[ty[0], ty, ty[-1]])
    columns = np.array([column[:-1] for column in starts] + [np.diff(column) for column in starts])
    middle_x, middle_y = x[:-1] + 0.5 * np.diff(x), y[:-1] + 0.5 * np.diff(y)
    score = np.array([-2.0 * middle_x, -2.0 * middle_y, middle_x**2 + middle_y**2])
    return _ProjectionSearch(
        constant(columns.T), constant(score.T), kernel.project, kernel.track, kernel.positions
    )


@lru_cache(maxsize=64)
def lane_path(
    net: RoadNetwork, road: str, lane: int, s: float, length: float, *,
    behind: float = 50.0, step: float = 1.0, route: Route = NO_ROUTE,
) -> Path:  # fmt: skip
    """Give the path from (road, lane, s) `length` [m] ahead and `behind` [m] back, see `follow` for the way.

    Points lie at most step [m] apart on the reference line, at every lane section's border too. Where the
    road ends the path goes straight on, with the widths and the limit it had. The last ones are kept, as one
    scenario is driven again and again, and are constant. Raises InputError where the lane does not exist.
    """
    if not net.has_lane(road, lane, s) or lane == 0:
        raise InputError(net.path, f"road {road} has no lane {lane} at s={s:.3f} m", "Choose one that exists")
    ahead, more = _walk(net, (road, lane, s), length, step, route)
    back, _ = _walk(net, (road, lane, s), behind, step, None)
    table = np.concatenate([back[:0:-1], ahead])
    return sealed(_assemble(table, len(back) - 1, length, behind, step, ends=not more))


def _walk(
    net: RoadNetwork, start: tuple[str, int, float], length: float, step: float, route: Route | None
) -> tuple[Floats, bool]:
    """Points (K, 8) from the start (road, lane, s) on, and whether the road reaches `length`; back, without a route."""
    road, lane, s = start
    ahead, route = route is not None, route or NO_ROUTE
    here = _points(net, road, lane, np.array([s]), net.roads[road].section_index(s))
    parts, reached, astray = [here], 0.0, 0
    for stretch in follow(net, road, lane, s, ahead=ahead, route=route) if length > 0.0 else ():
        rows = _beyond(parts[-1][-1], _sample(net, stretch, step), ahead)
        astray = 0 if len(rows) else astray + 1
        if astray > MOST_ASTRAY:
            break
        if astray:
            continue
        before = parts[-1][-1:, :2]
        gaps = np.hypot(*np.diff(np.concatenate([before, rows[:, :2]]), axis=0).T)
        covered = reached + np.cumsum(gaps)
        parts.append(rows[: int(np.searchsorted(covered, length)) + 1])
        reached += float(gaps[: len(parts[-1])].sum())
        if reached >= length:
            break
    return np.concatenate(parts), reached >= length


def _sample(net: RoadNetwork, stretch: RouteStretch, step: float) -> Floats:
    """Points (K, 8) of the stretch without its first."""
    count = max(int(np.ceil(stretch.length / step - 1e-6)), 1)
    at = np.linspace(stretch.s_from, stretch.s_to, count + 1)[1:]
    return _points(net, stretch.road, stretch.lane, at, stretch.section)


def _beyond(last: Floats, rows: Floats, ahead: bool) -> Floats:
    """Leave out the first rows that do not lie beyond the last one: roads of some maps overlap at their ends."""
    way = (rows[:, :2] - last[:2]) @ [np.cos(last[2]), np.sin(last[2])] * (1.0 if ahead else -1.0)
    further = np.flatnonzero(way > SHORTEST)
    return rows[further[0] :] if len(further) else rows[:0]


def _points(net: RoadNetwork, road: str, lane: int, s: Floats, section: int) -> Floats:
    """Columns x, y, heading, curvature, left, right and half width, speed limit at s (K,)."""
    x, y = net.to_xy(road, lane, s, 0.0)
    inward = 1 if net.roads[road].along(lane, section) else -1
    left, right = (_neighbour(net, road, section, lane, lane + d, s) for d in (inward, -inward))
    columns = [x, y, net.lane_heading(road, lane, s), net.curvature(road, lane, s), left, right]
    columns += [0.5 * net.lane_width(road, lane, s), net.speed_limit(road, lane, s)]
    return np.stack(columns, axis=1)


def _neighbour(net: RoadNetwork, road: str, section: int, lane: int, other: int, s: Floats) -> Floats:
    found = net.roads[road].sections[section].lanes.get(other)
    if found is None or not found.drivable or lane * other <= 0:
        return np.zeros(len(s))
    return net.lane_width(road, other, s)


def _assemble(table: Floats, own: int, length: float, behind: float, step: float, *, ends: bool) -> Path:
    table, own = _advancing(table, own)
    s = np.r_[0.0, np.cumsum(np.hypot(*np.diff(table[:, :2], axis=0).T))]
    s = s - s[own]
    table[:, 2] = np.unwrap(table[:, 2])
    _mend_curvature(table, s, step)
    end = float(s[-1])
    if length > end:
        s, table = _straight(s, table, length, step)
    if -behind < s[0]:
        s, table = _straight(-s[::-1], table[::-1], behind, -step)
        s, table = -s[::-1], table[::-1]
    x, y, heading, curvature, left, right, half, limit = np.ascontiguousarray(table.T)
    return Path(s, x, y, heading, curvature, left, right, half, limit, ends, end)


def _advancing(table: Floats, own: int) -> tuple[Floats, int]:
    """Leave out points that do not lie ahead of the one before: doubles, and overlaps of badly joined roads.

    The start position, row `own`, stays; gives its new row.
    """
    while len(table) > 1:
        step = np.diff(table[:, :2], axis=0)
        heading = table[:-1, 2]
        back = step[:, 0] * np.cos(heading) + step[:, 1] * np.sin(heading) <= SHORTEST
        if not back.any():
            break
        drop = np.r_[False, back]
        drop[:own] = np.r_[back, False][:own]
        drop[own] = False
        own -= int(drop[:own].sum())
        table = table[~drop]
    return table, own


def _mend_curvature(table: Floats, s: Floats, step: float) -> None:
    """Put the mean bend between the neighbours where a speck of the line bends too much to sample."""
    spikes = np.flatnonzero(np.abs(table[:, 3]) * step > SPIKE)
    if len(spikes) and len(s) > 2:
        table[spikes, 3] = np.gradient(table[:, 2], s)[spikes]


def _straight(s: Floats, table: Floats, until: float, step: float) -> tuple[Floats, Floats]:
    """Go on straight from the last row; a negative step goes against the heading."""
    count = int(np.ceil((until - s[-1]) / abs(step)))
    far = np.linspace(0.0, until - s[-1], count + 1)[1:]
    rows = np.repeat(table[-1:], count, axis=0)
    rows[:, 0] += np.sign(step) * far * np.cos(rows[:, 2])
    rows[:, 1] += np.sign(step) * far * np.sin(rows[:, 2])
    rows[:, 3] = 0.0
    return np.r_[s, s[-1] + far], np.concatenate([table, rows])
