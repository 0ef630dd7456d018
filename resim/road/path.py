"""A route's centre line in driving direction, as AD functions follow it."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from resim.core.errors import InputError
from resim.core.geometry import Floats
from resim.road.opendrive import RoadNetwork
from resim.road.route import Stretch, follow

FAR = 1e4
SPIKE = 0.5


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
        q = np.empty((np.size(x), 3))
        q[:, 0], q[:, 1], q[:, 2] = x, y, 1.0
        q[:, :2] -= search.origin
        nearest = (q @ search.score).argmin(axis=1)
        i = nearest - (np.einsum("ij,ij->i", q, search.plane[nearest]) < 0.0)
        top = len(search.s) - 2
        np.maximum(i, 0, out=i)
        np.minimum(i, top, out=i)
        for _ in range(8):
            f, across = _solve(search, q, i)
            before, after = (f < -1e-9) & (i > 0), (f > 1.0 + 1e-9) & (i < top)
            if not (before.any() or after.any()):
                break
            i = i + after - before
        return search.s[i] + f * search.step[i], across

    def xy(self, s: ArrayLike, d: ArrayLike) -> tuple[Floats, Floats]:
        """Give the map positions [m] at s, d metres to the left; inverse of `project`."""
        search = self._search
        s_ = np.asarray(s, dtype=float)
        i = np.clip(np.searchsorted(search.s, s_, side="right") - 1, 0, len(search.s) - 2)
        f = (s_ - search.s[i]) / search.step[i]
        tx, ty = search.tx[i] + f * search.dtx[i], search.ty[i] + f * search.dty[i]
        across = np.asarray(d) / np.hypot(tx, ty)
        return (search.x[i] + f * search.ex[i] - across * ty, search.y[i] + f * search.ey[i] + across * tx)

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

    @cached_property
    def _rows(self) -> tuple[list[float], list[list[float]], list[list[float]]]:
        columns = [self.x, self.y, self.heading, self.curvature]
        table = np.stack([*columns, self.left_width, self.right_width, self.half_width], axis=1)
        return self.s.tolist(), table.tolist(), np.diff(table, axis=0).tolist()

    @cached_property
    def _limits(self) -> list[float]:
        limits: list[float] = self.speed_limit.tolist()
        return limits

    @cached_property
    def _search(self) -> _Search:
        return _search(self)


class _Search(NamedTuple):
    """What `project` needs, with a far point added to either end; K vertices, K - 1 segments."""

    s: Floats
    x: Floats
    y: Floats
    tx: Floats
    ty: Floats
    step: Floats
    ex: Floats
    ey: Floats
    dtx: Floats
    dty: Floats
    origin: Floats
    score: Floats
    plane: Floats
    linear: Floats
    square: Floats


def _search(path: Path) -> _Search:
    tx, ty = np.cos(path.heading), np.sin(path.heading)
    ends = np.array([-FAR, FAR])
    x = np.r_[path.x[0] - FAR * tx[0], path.x, path.x[-1] + FAR * tx[-1]]
    y = np.r_[path.y[0] - FAR * ty[0], path.y, path.y[-1] + FAR * ty[-1]]
    s = np.r_[path.s[0] + ends[0], path.s, path.s[-1] + ends[1]]
    tx, ty = np.r_[tx[0], tx, tx[-1]], np.r_[ty[0], ty, ty[-1]]
    origin = np.array([path.x.mean(), path.y.mean()])
    px, py = x - origin[0], y - origin[1]
    ex, ey, dtx, dty = np.diff(x), np.diff(y), np.diff(tx), np.diff(ty)
    a, b, u, v = px[:-1], py[:-1], tx[:-1], ty[:-1]
    along, across = ex * u + ey * v, ey * u - ex * v
    linear = np.array([
        [u, v, -(a * u + b * v)],
        [dtx, dty, -(a * dtx + b * dty) - along],
        [-v, u, a * v - b * u],
        [-dty, dtx, a * dty - b * dtx - across],
    ])  # fmt: skip
    square = np.stack([-(ex * dtx + ey * dty), ex * dty - ey * dtx, dtx**2 + dty**2], axis=1)
    return _Search(
        s, x, y, tx, ty, np.diff(s), ex, ey, dtx, dty, origin,
        score=np.ascontiguousarray([-2.0 * px, -2.0 * py, px**2 + py**2]),
        plane=np.stack([tx, ty, -(px * tx + py * ty)], axis=1),
        linear=np.ascontiguousarray(np.moveaxis(linear, 2, 0)), square=square,
    )  # fmt: skip


def _solve(search: _Search, q: Floats, i: Floats) -> tuple[Floats, Floats]:
    """Give the fraction f of segment i at which the normal meets the position, and d there.

    With p - P = a, chord e, tangents T and T + dT: (a - f e) · (T + f dT) = 0, quadratic in f, and
    d = (T + f dT) x (a - f e) / |T + f dT|.
    """
    index = i.astype(np.intp, copy=False)
    c0, c1, b0, b1 = np.matmul(search.linear[index], q[:, :, None])[:, :, 0].T
    c2, b2, bend = search.square[index].T
    root = np.sqrt(np.maximum(c1 * c1 - 4.0 * c0 * c2, 0.0))
    f = 2.0 * c0 / np.maximum(root - c1, 1e-12)
    return f, (b0 + f * (b1 + f * b2)) / np.sqrt(1.0 - f * (1.0 - f) * bend)


def lane_path(
    net: RoadNetwork, road: str, lane: int, s: float, length: float, *,
    behind: float = 50.0, step: float = 1.0,
) -> Path:  # fmt: skip
    """Give the path from (road, lane, s) `length` [m] ahead and `behind` [m] back, see `follow` for the way.

    Points lie at most step [m] apart on the reference line, at every lane section's border too. Where the
    road ends the path goes straight on, with the widths and the limit it had. Raises InputError where the
    lane does not exist.
    """
    if not net.has_lane(road, lane, s) or lane == 0:
        raise InputError(net.path, f"road {road} has no lane {lane} at s={s:.3f} m", "Choose one that exists")
    ahead, more = _walk(net, road, lane, s, length, step, ahead=True)
    back, before = _walk(net, road, lane, s, behind, step, ahead=False)
    table = np.concatenate([back[:0:-1], ahead])
    return _assemble(table, len(back) - 1, length, behind, step, ends=not more, begins=not before)


def _walk(
    net: RoadNetwork, road: str, lane: int, s: float, length: float, step: float, *, ahead: bool
) -> tuple[Floats, bool]:
    """Points (K, 8) from the start on, and whether the road reaches `length`."""
    here = _points(net, road, lane, np.array([s]), net.roads[road].section_index(s))
    parts, reached, full = [here], 0.0, length <= 0.0
    if not full:
        for stretch in follow(net, road, lane, s, ahead=ahead):
            rows = _sample(net, stretch, step)
            before = parts[-1][-1:, :2]
            gaps = np.hypot(*np.diff(np.concatenate([before, rows[:, :2]]), axis=0).T)
            covered = reached + np.cumsum(gaps)
            keep = int(np.searchsorted(covered, length)) + 1
            parts.append(rows[:keep])
            reached = float(covered[min(keep, len(covered)) - 1])
            if reached >= length:
                full = True
                break
    return np.concatenate(parts), full


def _sample(net: RoadNetwork, stretch: Stretch, step: float) -> Floats:
    """Points (K, 8) of the stretch without its first."""
    count = max(int(np.ceil(stretch.length / step - 1e-6)), 1)
    at = np.linspace(stretch.s_from, stretch.s_to, count + 1)[1:]
    return _points(net, stretch.road, stretch.lane, at, stretch.section)


def _points(net: RoadNetwork, road: str, lane: int, s: Floats, section: int) -> Floats:
    """Columns x, y, heading, curvature, left, right and half width, speed limit at s (K,)."""
    x, y = net.to_xy(road, lane, s, 0.0)
    inward = 1 if net.roads[road].along(lane) else -1
    left, right = (_neighbour(net, road, section, lane, lane + d, s) for d in (inward, -inward))
    columns = [x, y, net.lane_heading(road, lane, s), net.curvature(road, lane, s), left, right]
    columns += [0.5 * net.lane_width(road, lane, s), net.speed_limit(road, lane, s)]
    return np.stack(columns, axis=1)


def _neighbour(net: RoadNetwork, road: str, section: int, lane: int, other: int, s: Floats) -> Floats:
    found = net.roads[road].sections[section].lanes.get(other)
    if found is None or not found.drivable or lane * other <= 0:
        return np.zeros(len(s))
    return net.lane_width(road, other, s)


def _assemble(
    table: Floats, own: int, length: float, behind: float, step: float, *, ends: bool, begins: bool
) -> Path:
    gaps = np.hypot(*np.diff(table[:, :2], axis=0).T) if len(table) > 1 else np.zeros(0)
    keep = np.r_[True, gaps > 1e-6]
    own = int(keep[: own + 1].sum()) - 1
    table = table[keep]
    s = np.r_[0.0, np.cumsum(gaps[gaps > 1e-6])]
    s = s - s[own]
    table[:, 2] = np.unwrap(table[:, 2])
    _mend_curvature(table, s, step)
    end = float(s[-1])
    if ends and length > end:
        s, table = _straight(s, table, length, step)
    if begins and -behind < s[0]:
        s, table = _straight(-s[::-1], table[::-1], behind, -step)
        s, table = -s[::-1], table[::-1]
    x, y, heading, curvature, left, right, half, limit = np.ascontiguousarray(table.T)
    return Path(s, x, y, heading, curvature, left, right, half, limit, ends, end)


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
