"""An OpenDRIVE map as a road network: positions to lanes and back, headings, curvature, widths, limits."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resim.core.errors import InputError
from resim.core.geometry import Bools, Floats, constant, wrap_angle
from resim.road.opendrive.heights import raised
from resim.road.opendrive.index import LaneIndex
from resim.road.opendrive.lanes import Lanes, reexpanded
from resim.road.opendrive.model import Controller, Header, Junction, Road, Unread
from resim.road.opendrive.reader import ModelReader
from resim.road.opendrive.reference import Frame, Ints, ReferenceLines
from resim.road.opendrive.shapes import LaneShape, lane_shapes
from resim.road.opendrive.unread import unread
from resim.road.opendrive.xml import parse

Strings = NDArray[np.str_]
FOLDED = 0.1


@dataclass(frozen=True, eq=False)
class RoadPositions:
    """N places on lanes: road (N,), lane (N,), s (N,) m, t (N,) m left of the lane centre, on_road (N,).

    on_road: inside a lane that vehicles drive on (`VEHICLE_LANES`: driving, ramps, entry, exit, bus, taxi,
    HOV and the like; not shoulder, stop, parking, border, biking, sidewalk).
    """

    road: Strings
    lane: Ints
    s: Floats
    t: Floats
    on_road: Bools

    def __len__(self) -> int:
        return len(self.road)


@dataclass(frozen=True, eq=False)
class DrivingLanes:
    """M pairs of a position and a driving lane that it is on.

    point: which position (M,); road: its id (M,); heading: the direction of traffic there (M,) [rad], that of the
    reference line; z: height of its surface (M,) [m].
    """

    point: Ints
    road: Strings
    heading: Floats
    z: Floats


@dataclass(frozen=True, eq=False)
class LanePlaces:
    """M pairs of a position and a lane that it is on, of whatever type.

    point: which position (M,), in order; row: of the lane in `RoadNetwork.lane_table` (M,); s: m along the road (M,);
    t: m left of the lane centre (M,); beyond: m by which it is beyond the lane's border, 0 within (M,).
    """

    point: Ints
    row: Ints
    s: Floats
    t: Floats
    beyond: Floats


@dataclass(frozen=True, eq=False)
class RoadNetwork:
    """An OpenDRIVE map. Tables and the spatial index are built at the first question that needs them, and are constant:
    all runs of a process share them.

    Everywhere: road is an id or (N,) ids; lane an id or (N,) ids; s, t metres, scalars or (N,); s beyond a
    road's ends means its end tangents, with the lane as it is at that end. t is measured from the lane
    centre, positive to the left of s. Where a section begins at s, s belongs to it. Raises InputError for a
    road or lane that does not exist there. Superelevation and lane height matter for z alone: t is measured
    in the plane (a roll of 5 degrees makes 4 mm of a metre).
    """

    path: Path
    header: Header
    geo_reference: str | None
    roads: dict[str, Road]
    junctions: dict[str, Junction]
    unread: tuple[Unread, ...] = ()
    controllers: tuple[Controller, ...] = ()

    def to_xy(self, road: ArrayLike, lane: ArrayLike, s: ArrayLike, t: ArrayLike) -> tuple[Floats, Floats]:
        """Give map positions x, y [m] of (road, lane, s, t)."""
        number, lanes, s_, shape = self._places(road, lane, s, t)
        t_ = np.broadcast_to(np.asarray(t, dtype=float), shape).ravel()
        frame = self._lines.evaluate(number, s_)
        inside = self._clamped(number, s_)
        across = t_ + self._lanes.centre(self._rows(number, lanes, inside), inside)
        x, y = frame.x - across * np.sin(frame.heading), frame.y + across * np.cos(frame.heading)
        return x.reshape(shape), y.reshape(shape)

    def to_road(
        self,
        x: ArrayLike,
        y: ArrayLike,
        *,
        heading: ArrayLike | None = None,
        z: ArrayLike | None = None,
    ) -> RoadPositions:
        """Give the lane, s and t of map positions x, y (N,) [m]; inverse of `to_xy`.

        A position on a lane gets it, driving lanes first; on several (junctions) the one whose centre is
        nearest, 10 m added per rad between its driving direction and heading (N,) [rad] if given, then the
        first in the file. Where a height z (N,) [m] is given, lanes within `LEVEL` of it come before all others, if
        there are any: on a bridge the bridge, under it the road below. A position on no lane, or on one of type none,
        gets the nearest driving lane and on_road False. s, t are NaN for NaN positions, and on a map that has lanes of
        type none only.
        """
        x_, y_ = (np.atleast_1d(np.asarray(a, dtype=float)).ravel() for a in (x, y))
        want = None if heading is None else np.broadcast_to(np.asarray(heading, dtype=float), x_.shape)
        level = None if z is None else np.broadcast_to(np.asarray(z, dtype=float), x_.shape)
        if level is not None and not np.isfinite(level).any():
            level = None
        found = self._index.locate(x_, y_, want, None if level is None else (level, self._surface))
        return RoadPositions(
            self._ids[found.road], self._lanes.lane[found.row], found.s, found.t, found.on_road
        )

    def surfaces(self, x: ArrayLike, y: ArrayLike) -> tuple[Ints, Floats]:
        """Give the heights [m] of all lanes at positions x, y (N,) [m]: of which position (M,) each is, and it (M,)."""
        x_, y_ = (np.atleast_1d(np.asarray(a, dtype=float)).ravel() for a in (x, y))
        found = self._index.containing(x_, y_)
        return found.point, self._surface(found.road, found.row, found.s, found.lateral)

    def driving_lanes(self, x: ArrayLike, y: ArrayLike) -> DrivingLanes:
        """Give all lanes that vehicles drive on at positions x, y (N,) [m], side by side and one above the other."""
        x_, y_ = (np.atleast_1d(np.asarray(a, dtype=float)).ravel() for a in (x, y))
        found = self._index.containing(x_, y_)
        kept = self._lanes.drivable[found.row]
        road, row, s = found.road[kept], found.row[kept], found.s[kept]
        z = self._surface(road, row, s, found.lateral[kept]) if self.has_heights else np.zeros(len(road))
        turned = np.where(self._lanes.forward[row], 0.0, np.pi)
        heading = self._lines.evaluate(road, s).heading + turned
        return DrivingLanes(found.point[kept], self._ids[road], heading, z)

    def lanes_at(self, x: ArrayLike, y: ArrayLike, *, beyond: float = 0.0) -> LanePlaces:
        """Give all lanes, side by side and one above the other, at positions x, y (N,) [m]; none where one is NaN.

        beyond: m, up to 0.3, by which a position may be beyond a lane's border.
        Where the line of a road bends so sharply that a lane has several places there, it is that next to its centre.
        """
        x_, y_ = (np.atleast_1d(np.asarray(a, dtype=float)).ravel() for a in (x, y))
        known = np.flatnonzero(np.isfinite(x_) & np.isfinite(y_))
        found = self._index.containing(x_[known], y_[known], beyond)
        order = np.lexsort((np.abs(found.lateral), found.miss, found.row, found.point))
        new = np.ones(len(order), dtype=bool)
        new[1:] = (np.diff(found.point[order]) != 0) | (np.diff(found.row[order]) != 0)
        order = order[new]
        return LanePlaces(
            known[found.point[order]],
            found.row[order],
            found.s[order],
            found.lateral[order],
            found.beyond[order],
        )

    @property
    def lane_table(self) -> Lanes:
        """The lanes of all roads in one table, a row each lane of a lane section; its `road` counts `roads`."""
        return self._lanes

    @cached_property
    def has_heights(self) -> bool:
        """Whether the map says a height of any road but 0."""
        return any(
            value for road in self.roads.values() for record in road.elevations for value in record[1:]
        )

    def reference_line(self, road: ArrayLike, s: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Give position x, y [m] and heading [rad] of the roads' reference lines; no lane offset in it."""
        number, _, s_, shape = self._places(road, 0, s)
        frame = self._lines.evaluate(number, s_)
        return frame.x.reshape(shape), frame.y.reshape(shape), frame.heading.reshape(shape)

    def lane_heading(self, road: ArrayLike, lane: ArrayLike, s: ArrayLike) -> Floats:
        """Give the driving direction [rad] of the lane centre, in (-pi, pi]; lane tapers turn it.

        On specks of a line that bend more sharply than the lane is away (k t > 0.9), where the lane centre
        would run backwards, it is that of the reference line.
        """
        number, lanes, s_, shape = self._places(road, lane, s)
        row, frame, bend, slope, _ = self._offset_curve(number, lanes, s_)
        turn = np.arctan2(slope, np.maximum(bend, FOLDED)) + np.where(self._lanes.forward[row], 0.0, np.pi)
        return wrap_angle(frame.heading + turn).reshape(shape)

    def curvature(self, road: ArrayLike, lane: ArrayLike, s: ArrayLike) -> Floats:
        """Give the curvature [1/m] of the lane centre in driving direction, positive to the left.

        With f = 1 - k t: (f (f k + t'') + t' (k' t + 2 k t')) / (f² + t'²)^1.5, curve r(s) + t(s) n(s).
        """
        number, lanes, s_, shape = self._places(road, lane, s)
        row, frame, bend, slope, second = self._offset_curve(number, lanes, s_)
        offset = self._lanes.centre(row, self._clamped(number, s_))
        k = frame.curvature
        top = bend * (bend * k + second) + slope * (frame.rate * offset + 2.0 * k * slope)
        value = top / np.maximum(np.hypot(bend, slope), 1e-6) ** 3
        return np.asarray(np.where(self._lanes.forward[row], value, -value).reshape(shape))

    def lane_curve(self, road: ArrayLike, lane: ArrayLike, s: ArrayLike, t: ArrayLike = 0.0) -> Floats:
        """Give x, y [m] of places t [m] left of a lane's centre, and their first and second derivatives by s: (6, N).

        With the reference line's heading e, its normal n, curvature k and the offset t(s) from it:
        r' = (1 - k t) e + t' n, r'' = -(k' t + 2 k t') e + ((1 - k t) k + t'') n.
        """
        number, lanes, s_, shape = self._places(road, lane, s, t)
        row, frame, _, slope, second = self._offset_curve(number, lanes, s_)
        offset = self._lanes.centre(row, self._clamped(number, s_))
        offset = offset + np.broadcast_to(np.asarray(t, dtype=float), shape).ravel()
        k, e = frame.curvature, np.exp(1j * frame.heading)
        n, bend = 1j * e, 1.0 - k * offset
        first = bend * e + slope * n
        turn = -(frame.rate * offset + 2.0 * k * slope) * e + (bend * k + second) * n
        place = frame.x + 1j * frame.y + offset * n
        parts = [part for z in (place, first, turn) for part in (z.real, z.imag)]
        return np.stack(parts).reshape(6, *shape)

    def lane_width(self, road: ArrayLike, lane: ArrayLike, s: ArrayLike) -> Floats:
        """Give the width [m] of the lane, as its polynomial says."""
        number, lanes, s_, shape = self._places(road, lane, s)
        inside = self._clamped(number, s_)
        return self._lanes.centre_and_width(self._rows(number, lanes, inside), inside)[1].reshape(shape)

    def speed_limit(self, road: ArrayLike, lane: ArrayLike, s: ArrayLike) -> Floats:
        """Give the speed limit [m/s], NaN where there is none.

        The lane's own record comes first, then the speed-limit sign in force (see `limits`), then the type
        of the road. Signs end with their road: a limit is not carried over to the next one.
        """
        number, lanes, s_, shape = self._places(road, lane, s)
        inside = self._clamped(number, s_)
        return self._lanes.limit(self._rows(number, lanes, inside), inside).reshape(shape)

    def z(
        self, road: ArrayLike, s: ArrayLike, t: ArrayLike = 0.0, *, lane: ArrayLike | None = None
    ) -> Floats:
        """Give the height [m] of places at t [m] left of the reference line, or of the centre of `lane`.

        z = elevation(s) + t sin(superelevation(s)), t from the reference line; with `lane` its height over
        the road as well, linear from its inner to its outer border. 0 where the file says nothing.
        Shapes of the road's surface (shape, crossSectionSurface) are left out.
        """
        number, lanes, s_, shape = self._places(road, 0 if lane is None else lane, s, t)
        t_ = np.broadcast_to(np.asarray(t, float), shape).ravel()
        inside = self._clamped(number, s_)
        row = None if lane is None else self._rows(number, lanes, inside)
        return self._surface(number, row, inside, t_).reshape(shape)

    def _surface(self, number: Ints, row: Ints | None, s: Floats, t: Floats) -> Floats:
        """Heights (K,) [m] at t (K,) [m] left of the reference lines, or of the centres of lanes (rows (K,))."""
        inside, above = self._clamped(number, s), np.zeros(len(s))
        if row is not None:
            above = raised(list(self.roads.values()), self._lanes, row, inside, t)
            t = t + self._lanes.centre(row, inside)
        elevation, roll = np.zeros(len(s)), np.zeros(len(s))
        for own in np.unique(number):
            rows, of = np.flatnonzero(number == own), self.roads[str(self._ids[own])]
            elevation[rows] = reexpanded(of.elevations, inside[rows])[:, 0]
            roll[rows] = reexpanded(of.superelevations, inside[rows])[:, 0]
        return np.asarray(elevation + t * np.sin(roll) + above)

    def has_lane(self, road: str, lane: int, s: float) -> bool:
        """Say whether the road has the lane at s [m]; raises InputError for an unknown road."""
        number = self._numbers(np.asarray(road))
        at = self._clamped(number, np.array([float(s)]))
        return bool(self._lanes.find(number, np.array([lane]), at)[0] >= 0)

    def lane_shapes(self, step: float = 1.0) -> list[LaneShape]:
        """Give every lane of every section as polylines with points at most `step` [m] apart."""
        return lane_shapes(list(self.roads.values()), self._lines, self._lanes, step)

    @cached_property
    def _lines(self) -> ReferenceLines:
        return ReferenceLines(list(self.roads.values()))

    @cached_property
    def _lanes(self) -> Lanes:
        return Lanes(list(self.roads.values()))

    @cached_property
    def _index(self) -> LaneIndex:
        return LaneIndex(self._lines, self._lanes)

    @cached_property
    def _ids(self) -> Strings:
        return constant(np.array(list(self.roads), dtype=str))

    @cached_property
    def _sorted_ids(self) -> tuple[Strings, Ints]:
        order = np.argsort(self._ids)
        return constant(self._ids[order]), constant(order)

    @cached_property
    def _number(self) -> dict[str, int]:
        return {name: number for number, name in enumerate(self.roads)}

    def _numbers(self, road: NDArray[np.generic]) -> Ints:
        """The number (N,) of road ids (N,); a single id gives one number."""
        flat = road.astype(str).ravel()
        if len(flat) <= 8:
            unknown = [name for name in flat.tolist() if name not in self._number]
            if not unknown:
                return np.array([self._number[name] for name in flat.tolist()], dtype=np.intp)
        else:
            names, order = self._sorted_ids
            place = np.minimum(np.searchsorted(names, flat), len(names) - 1)
            unknown = flat[names[place] != flat].tolist()
            if not unknown:
                return np.asarray(order[place])
        some = ", ".join(list(self.roads)[:12])
        raise InputError(self.path, f"has no road {unknown[0]!r}", f"Its roads are {some}")

    def _places(
        self, road: ArrayLike, lane: ArrayLike, s: ArrayLike, t: ArrayLike = 0.0
    ) -> tuple[Ints, Ints, Floats, tuple[int, ...]]:
        """Road numbers, lanes, s, each (N,), and the common shape of the arguments."""
        roads, lanes, s_ = np.asarray(road), np.asarray(lane), np.asarray(s, dtype=float)
        shape = np.broadcast_shapes(roads.shape, lanes.shape, s_.shape, np.shape(t))
        number = self._numbers(roads).reshape(roads.shape)
        flat = (np.broadcast_to(a, shape).ravel() for a in (number, lanes.astype(np.intp, copy=False), s_))
        number, lanes, s_ = flat  # type: ignore[assignment]
        return number, lanes, s_, shape

    def _clamped(self, number: Ints, s: Floats) -> Floats:
        return np.clip(s, 0.0, self._lines.length[number])

    def _rows(self, number: Ints, lane: Ints, inside: Floats) -> Ints:
        row = self._lanes.find(number, lane, inside)
        if row.size and row.min() < 0:
            bad = int(np.argmin(row))
            road = self.roads[str(self._ids[number[bad]])]
            here = list(road.sections[road.section_index(float(inside[bad]))].lanes)
            problem = f"road {road.id} has no lane {int(lane[bad])} at s={inside[bad]:.3f} m"
            raise InputError(self.path, problem, f"Its lanes there are {', '.join(map(str, here))}")
        return row

    def _offset_curve(
        self, number: Ints, lane: Ints, s: Floats
    ) -> tuple[Ints, Frame, Floats, Floats, Floats]:
        """Lane rows, the reference line's frame, 1 - k t, t' and t'' of the lane centre at s."""
        inside = self._clamped(number, s)
        row, frame = self._rows(number, lane, inside), self._lines.evaluate(number, s)
        first, second = self._lanes.slopes(row, inside)
        on = inside == s
        bend = 1.0 - frame.curvature * self._lanes.centre(row, inside)
        return row, frame, bend, np.where(on, first, 0.0), np.where(on, second, 0.0)


def load(path: Path | str) -> RoadNetwork:
    """Read an OpenDRIVE 1.4 to 1.8 map.

    Raises InputError where the file is missing, no safe well-formed OpenDRIVE, or lacks what geometry needs.
    """
    path = Path(path)
    root = parse(path)
    reader = ModelReader(path, root)
    parts = reader.header(), reader.geo_reference(), reader.roads(), reader.junctions()
    return RoadNetwork(path, *parts, unread(root), reader.controllers())
