"""From map positions to (road, lane, s, t): an STR tree of lane cells, then Newton on the exact curve."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from resim.core.geometry import Bools, Floats, constant, sealed, wrap_angle
from resim.road.opendrive.lanes import Lanes
from resim.road.opendrive.reference import Frame, Ints, ReferenceLines

CELL = 8.0
CELL_TURN = 0.05
MARGIN = 0.3
SHORTEST_CELL = 1e-6
INSIDE = 1e-9
HEADING_WEIGHT = 10.0
LEVEL, OTHER_LEVEL = 2.5, 1e12
"""Height [m] between a place and a lane up to which it is on it, and what it costs to be on another."""
MISS_WEIGHT = 1e3
LOST = 1e-6
TURNS, DAMPED_FROM, LONGEST_STEP = 32, 14, 4.0


SurfaceFunction = Callable[[Ints, Ints, Floats, Floats], Floats]
"""Heights (M,) [m] at roads (M,), lane rows (M,), s and t from the lane centres (M,) [m]."""


@dataclass(frozen=True)
class Containing:
    """M pairs of a position and a lane that holds it.

    point: which position; road, row: of the lane; s and t from the lane centre [m]; miss: of the foot [m]; beyond: m
    by which it is beyond the lane's border, 0 within.
    """

    point: Ints
    road: Ints
    row: Ints
    s: Floats
    lateral: Floats
    miss: Floats
    beyond: Floats


@dataclass(frozen=True)
class Located:
    """N answers: road number, lane row, s and t from the lane centre [m], and whether on a driving lane."""

    road: Ints
    row: Ints
    s: Floats
    t: Floats
    on_road: Bools


@dataclass(frozen=True)
class Cells:
    """Short stretches of lanes: lane row, s from `low` to `high`, the frame at the middle, its t range."""

    row: Ints
    low: Floats
    high: Floats
    x: Floats
    y: Floats
    cos: Floats
    sin: Floats
    curvature: Floats
    half: Floats
    lean: Floats
    right: Floats
    left: Floats
    corners: Floats


class LaneIndex:
    """Finds the lane, s and t of positions. Roads are numbers, lanes are rows of `lanes`."""

    def __init__(self, lines: ReferenceLines, lanes: Lanes) -> None:
        self.lines, self.lanes = lines, lanes

    def containing(self, x: Floats, y: Floats, beyond: float = 0.0) -> Containing:
        """Give every lane at each position (N,) [m]; one more than once where its line bends too sharply for one foot.

        beyond: m up to which a position beside a lane is on it too, at most MARGIN. A position without a foot, at a
        kink, has its place in the cell; a search that ends elsewhere found none.
        """
        point, cell = self._cells_around(x, y)
        road, s, t, miss = self._feet(x[point], y[point], cell)
        c = self.cells
        row = c.row[cell]
        offset, width = self.lanes.centre_and_width(row, s)
        lateral = t - offset
        outside = np.abs(lateral) - 0.5 * width
        inside = self._holds(row, road, s) & (outside <= beyond + INSIDE) & (width > 0.0)
        inside &= (miss <= LOST) | ((s >= c.low[cell] - MARGIN) & (s <= c.high[cell] + MARGIN))
        outside = np.where(outside > INSIDE, outside, 0.0)
        return Containing(
            point[inside],
            road[inside],
            row[inside],
            s[inside],
            lateral[inside],
            miss[inside],
            outside[inside],
        )

    def locate(
        self,
        x: Floats,
        y: Floats,
        heading: Floats | None,
        level: tuple[Floats, SurfaceFunction] | None = None,
    ) -> Located:
        """Give the lane at each position (N,) [m]: the containing one, else the nearest driving lane.

        Of several that contain it: driving lanes first, then the one with the smallest |t| (plus 10 m per
        rad between its direction and `heading`, where that is given), then the first in the file. level: heights
        (N,) [m], and the map's surface: lanes that lie within LEVEL of them come before all others there.
        """
        found = self.containing(x, y)
        point, road, row = found.point, found.road, found.row
        s, lateral, miss = found.s, found.lateral, found.miss
        cost = np.abs(lateral) + MISS_WEIGHT * miss + np.where(self.lanes.drivable[row], 0.0, 1e9)
        if heading is not None:
            cost = cost + HEADING_WEIGHT * self._disagreement(row, road, s, heading[point])
        if level is not None:
            cost = cost + _other_level(found, *level)
        best = _first_of_each(point, cost, row)
        out = Located(np.zeros(len(x), np.intp), np.zeros(len(x), np.intp), np.full(len(x), np.nan),
                      np.full(len(x), np.nan), np.zeros(len(x), bool))  # fmt: skip
        _put(out, point[best], road[best], row[best], s[best], lateral[best])
        out.on_road[point[best]] = self.lanes.drivable[row[best]]
        missing = np.flatnonzero(np.isnan(out.s) & np.isfinite(x) & np.isfinite(y))
        if len(missing):
            self._nearest(out, missing, x[missing], y[missing], heading)
        return out

    @cached_property
    def cells(self) -> Cells:
        """Cells of every lane but those of type none; built once."""
        return sealed(_build_cells(self.lines, self.lanes))

    @cached_property
    def _boxes(self) -> shapely.STRtree:
        low, high = self.cells.corners.min(axis=1) - MARGIN, self.cells.corners.max(axis=1) + MARGIN
        return shapely.STRtree(shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1]))

    @cached_property
    def _driving(self) -> tuple[shapely.STRtree, Ints]:
        number = np.flatnonzero(self.lanes.drivable[self.cells.row])
        if not len(number):
            number = np.arange(len(self.cells.row))
        corners = shapely.points(self.cells.corners[number].reshape(-1, 2))
        quads = shapely.multipoints(corners, indices=np.repeat(np.arange(len(number)), 4))
        return shapely.STRtree(shapely.convex_hull(quads)), constant(number)

    def _cells_around(self, x: Floats, y: Floats) -> tuple[Ints, Ints]:
        """Every pair of a point and a cell that may hold it."""
        point, cell = self._boxes.query(shapely.points(x, y))
        c = self.cells
        dx, dy = x[point] - c.x[cell], y[point] - c.y[cell]
        along, across = c.cos[cell] * dx + c.sin[cell] * dy, c.cos[cell] * dy - c.sin[cell] * dx
        near = np.abs(along) <= c.half[cell] + c.lean[cell] * np.abs(across) + MARGIN
        near &= (across >= c.right[cell] - MARGIN) & (across <= c.left[cell] + MARGIN)
        return point[near], cell[near]

    def _feet(self, x: Floats, y: Floats, cell: Ints) -> tuple[Ints, Floats, Floats, Floats]:
        """The road, s and t of each point's foot on the reference line sought from the cell, and its miss."""
        c = self.cells
        road = self.lanes.road[c.row[cell]]
        dx, dy = x - c.x[cell], y - c.y[cell]
        along, across = c.cos[cell] * dx + c.sin[cell] * dy, c.cos[cell] * dy - c.sin[cell] * dx
        guess = 0.5 * (c.low[cell] + c.high[cell]) + along / np.maximum(1.0 - c.curvature[cell] * across, 0.2)
        first = (c.low[cell] <= 0.0) & (guess < 0.0)
        last = (c.high[cell] >= self.lines.length[road]) & (guess > c.high[cell])
        guess = np.where(first | last, guess, np.minimum(np.maximum(guess, c.low[cell]), c.high[cell]))
        return road, *foot(self.lines, road, x, y, guess)

    def _holds(self, row: Ints, road: Ints, s: Floats) -> Bools:
        """Whether s lies on the road and in the row's own lane section."""
        length = self.lines.length[road]
        on = (s >= -INSIDE) & (s <= length + INSIDE)
        return np.asarray(on & (self.lanes.find(road, self.lanes.lane[row], np.clip(s, 0.0, length)) == row))

    def _disagreement(self, row: Ints, road: Ints, s: Floats, heading: Floats) -> Floats:
        """Angle (M,) [rad] between the lane's driving direction and the heading; 0 where that is NaN."""
        own = self.lines.evaluate(road, s).heading + np.where(self.lanes.forward[row], 0.0, np.pi)
        return np.nan_to_num(np.abs(wrap_angle(own - heading)))

    def _nearest(self, out: Located, missing: Ints, x: Floats, y: Floats, heading: Floats | None) -> None:
        tree, number = self._driving
        point, found = tree.query_nearest(shapely.points(x, y), all_matches=True)
        cell = number[found]
        road, s, t, miss = self._feet(x[point], y[point], cell)
        for lost in np.flatnonzero(miss > LOST):
            s[lost], t[lost], miss[lost] = search_line(self.lines, road[lost], x[point[lost]], y[point[lost]])
        length = self.lines.length[road]
        inside = np.clip(s, 0.0, length)
        row = self._beside(road, inside, t, self.cells.row[cell])
        offset, width = self.lanes.centre_and_width(row, inside)
        lateral = t - offset
        beyond = np.hypot(np.maximum(np.abs(lateral) - 0.5 * width, 0.0), s - inside)
        cost = beyond + MISS_WEIGHT * miss
        if heading is not None:
            cost = cost + HEADING_WEIGHT * self._disagreement(row, road, s, heading[missing][point])
        best = _first_of_each(point, np.round(cost, 9), row)
        _put(out, missing[point[best]], road[best], row[best], s[best], lateral[best])
        exact = self._holds(row, road, s) & (np.abs(lateral) <= 0.5 * width + INSIDE) & (width > 0.0)
        exact &= miss < LOST
        out.on_road[missing[point[best]]] = (exact & self.lanes.drivable[row])[best]

    def _beside(self, road: Ints, s: Floats, t: Floats, row: Ints) -> Ints:
        """The rows (M,) given where they hold at s; elsewhere the driving lane of the section nearest t."""
        section = self.lanes.section_at(road, s)
        best = self.lanes.row_of[section, self.lanes.lane[row] - self.lanes.lowest]
        lost = np.flatnonzero(best != row)
        rows = self.lanes.row_of[section[lost]]
        offset, width = (
            a.reshape(rows.shape)
            for a in self.lanes.centre_and_width(
                np.maximum(rows, 0).ravel(), np.repeat(s[lost], rows.shape[1])
            )
        )
        far = np.abs(t[lost, None] - offset) - 0.5 * width
        far = far + np.where(self.lanes.drivable[rows], 0.0, 1e6) + np.where(rows >= 0, 0.0, 1e12)
        best[lost] = rows[np.arange(len(lost)), np.argmin(far, axis=1)]
        return best


def foot(lines: ReferenceLines, road: Ints, x: Floats, y: Floats, s: Floats) -> tuple[Floats, Floats, Floats]:
    """Give s, t (N,) [m] of the foot of each point on its road's line, by Newton from s, and its miss.

    Solves (p - r(s)) · r'(s) = 0. Steps are at most 4 m and damped where the centre of curvature is near.
    miss: distance [m] from the point to the place (s, t), above zero where the line has a kink or gap and
    the point no foot.
    """
    s = np.array(s, dtype=float)
    t, miss = np.zeros_like(s), np.zeros_like(s)
    left = np.arange(len(s))
    for turn in range(TURNS):
        frame = lines.evaluate(road[left], s[left])
        cos, sin = np.cos(frame.heading), np.sin(frame.heading)
        dx, dy = x[left] - frame.x, y[left] - frame.y
        along, across = cos * dx + sin * dy, cos * dy - sin * dx
        t[left], miss[left] = across, np.abs(along)
        step = along / (frame.speed * np.maximum(1.0 - frame.curvature * across, 0.01))
        if turn > 0:
            on = (s[left] >= 0.0) & (s[left] <= lines.length[road[left]])
            limit = LONGEST_STEP * 0.5 ** max(turn - DAMPED_FROM, 0)
            step = np.where(on, np.minimum(np.maximum(step, -limit), limit), step)
        moving = miss[left] > 1e-10
        left, step = left[moving], step[moving]
        if not len(left):
            break
        s[left] += step
    return s, t, np.where(miss > 1e-9, miss, 0.0)


def search_line(lines: ReferenceLines, road: np.intp, x: float, y: float) -> tuple[float, float, float]:
    """Give s, t and miss [m] of one point by trying the whole line: its foot, else the nearest place."""
    low, high, count = 0.0, float(lines.length[road]), 2000
    for _ in range(3):
        at = np.linspace(low, high, count)
        frame = lines.evaluate(np.full(count, road), at)
        best = int(np.argmin((frame.x - x) ** 2 + (frame.y - y) ** 2))
        reach = (high - low) / count
        low, high = max(at[best] - reach, 0.0), min(at[best] + reach, float(lines.length[road]))
    near = np.array([at[best]])
    s, t, miss = foot(lines, np.array([road]), np.array([x]), np.array([y]), near)
    if miss[0] <= LOST:
        return float(s[0]), float(t[0]), float(miss[0])
    cos, sin = np.cos(frame.heading[best]), np.sin(frame.heading[best])
    dx, dy = x - frame.x[best], y - frame.y[best]
    return float(near[0]), float(cos * dy - sin * dx), float(abs(cos * dx + sin * dy))


def _other_level(found: Containing, z: Floats, surface: SurfaceFunction) -> Floats:
    """What lanes (M,) cost that are not at the height of their position, where another one is."""
    off = np.abs(surface(found.road, found.row, found.s, found.lateral) - z[found.point])
    near = off <= LEVEL
    some = np.zeros(len(z), dtype=bool)
    some[found.point[near]] = True
    return np.where(some[found.point] & ~near, OTHER_LEVEL, 0.0)


def _first_of_each(point: Ints, cost: Floats, row: Ints) -> Ints:
    """Give for each point the place of its cheapest entry; equal costs go to the lower row."""
    order = np.lexsort((row, cost, point))
    first = np.ones(len(order), dtype=bool)
    first[1:] = point[order][1:] != point[order][:-1]
    return np.asarray(order[first])


def _put(out: Located, at: Ints, road: Ints, row: Ints, s: Floats, t: Floats) -> None:
    out.road[at], out.row[at], out.s[at], out.t[at] = road, row, s, t


def _build_cells(lines: ReferenceLines, lanes: Lanes) -> Cells:
    rows, lows, highs = [], [], []
    stretches: dict[tuple[int, int], Floats] = {}
    for row in range(len(lanes.lane)):
        if lanes.lane[row] == 0 or (lanes.types[row] == "none"):
            continue
        key = (int(lanes.road[row]), int(lanes.section[row]))
        if key not in stretches:
            stretches[key] = _stretches(lines, lanes, row)
        at = stretches[key]
        rows.append(np.full(len(at) - 1, row))
        lows.append(at[:-1])
        highs.append(at[1:])
    empty = [np.zeros(0)]
    row_of = np.concatenate(rows or empty).astype(np.intp)
    return _cells(lines, lanes, row_of, np.concatenate(lows or empty), np.concatenate(highs or empty))


def _stretches(lines: ReferenceLines, lanes: Lanes, row: int) -> Floats:
    """Where the cells of the row's section begin and end: at most 8 m and 0.05 rad each."""
    road = int(lanes.road[row])
    start, end = np.minimum([lanes.start[row], lanes.end[row]], lines.length[road]).tolist()
    steps = lines.steps
    parts = lines.start[steps.first[road] : steps.last[road] + 1]
    borders = [start, *parts[(parts > start) & (parts < end)], *lanes.between(start, end, row), end]
    at = np.unique(np.array(borders))
    at = np.concatenate([at[:-1][np.diff(at) > SHORTEST_CELL], at[-1:]]) if len(at) > 1 else at
    span = np.diff(at)
    middle = lines.evaluate(
        np.full(3 * len(span), road, np.intp), (at[:-1] + np.outer([0.01, 0.5, 0.99], span)).ravel()
    )
    bend = np.abs(middle.curvature).reshape(3, -1).max(axis=0)
    count = np.ceil(np.maximum(span / CELL, np.minimum(bend * span / CELL_TURN, span / 0.25))).astype(int)
    count = np.maximum(count, 1)
    first = np.repeat(at[:-1], count)
    number = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    return np.concatenate([first + number * np.repeat(span / count, count), at[-1:]])


def _cells(lines: ReferenceLines, lanes: Lanes, row: Ints, low: Floats, high: Floats) -> Cells:
    road, middle = lanes.road[row], 0.5 * (low + high)
    # just inside of both ends, so that a gap in the reference line belongs to neither cell
    ends = [lines.evaluate(road, low), lines.evaluate(road, high - 1e-9)]
    centre = lines.evaluate(road, middle)
    borders = [_borders(lanes, row, s) for s in (low, middle, high)]
    corners = [_point(e, b) for e, pair in zip(ends, (borders[0], borders[2]), strict=True) for b in pair]
    right, left = (np.stack([b[i] for b in borders]) for i in (0, 1))
    bulge = [np.abs(e[1] - 0.5 * (e[0] + e[2])) for e in (right, left)]
    turn = np.maximum(*(np.abs(wrap_angle(e.heading - centre.heading)) for e in ends))
    reach = [np.abs((e.x - centre.x) * np.cos(centre.heading) + (e.y - centre.y) * np.sin(centre.heading))
             for e in ends]  # fmt: skip
    return Cells(
        row=row, low=low, high=high, x=centre.x, y=centre.y, cos=np.cos(centre.heading),
        sin=np.sin(centre.heading), curvature=centre.curvature, half=np.maximum(*reach),
        lean=np.tan(np.minimum(turn, 1.5)), right=right.min(axis=0) - bulge[0],
        left=left.max(axis=0) + bulge[1], corners=np.stack(corners, axis=1),
    )  # fmt: skip


def _borders(lanes: Lanes, row: Ints, s: Floats) -> tuple[Floats, Floats]:
    centre, width = lanes.centre_and_width(row, s)
    half = 0.5 * np.maximum(width, 0.0)
    return centre - half, centre + half


def _point(frame: Frame, t: Floats) -> Floats:
    x, y, heading = frame.x, frame.y, frame.heading
    return np.stack([x - t * np.sin(heading), y + t * np.cos(heading)], axis=-1)
