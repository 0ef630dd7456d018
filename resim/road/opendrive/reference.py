"""The reference lines of all roads in one table, evaluated exactly for arrays of (road, s)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats, sealed
from resim.road.opendrive.arclength import NODES, WEIGHTS, invert, powers
from resim.road.opendrive.model import Geometry, Road

Ints = NDArray[np.intp]
ARC, SPIRAL, POLYNOMIAL = 0, 1, 2


@dataclass(frozen=True)
class Frame:
    """The reference line at N places: position [m], heading [rad], curvature [1/m] and its rate [1/m²].

    speed: metres of curve per metre of s; 1 but where a paramPoly3 is no true arc length.
    """

    x: Floats
    y: Floats
    heading: Floats
    curvature: Floats
    rate: Floats
    speed: Floats


class Steps:
    """Finds the record that holds at (group, s) in records sorted by group, then by start.

    A group's records lie on one axis behind those of the group before it, so one search serves all.
    """

    def __init__(self, group: Ints, start: Floats, count: int) -> None:
        number = np.arange(count)
        self.first = np.searchsorted(group, number, side="left")
        self.last = np.searchsorted(group, number, side="right") - 1
        low, high = np.minimum(start[self.first], 0.0), start[self.last] + 1.0
        self.base = np.concatenate([[0.0], np.cumsum(high - low)[:-1]]) - low
        self.high, self.start = high, start
        self.key = self.base[group] + start
        sealed(self)

    def find(self, group: Ints, s: Floats) -> Ints:
        """Give the record (N,) of each group (N,) that holds at s (N,); the first one before it begins.

        The sum of base and s is rounded, the more the longer all roads are: s itself has the last word.
        """
        first, last = self.first[group], self.last[group]
        key = self.base[group] + np.minimum(s, self.high[group])
        found = np.minimum(np.maximum(np.searchsorted(self.key, key, side="right") - 1, first), last)
        while np.any(early := (s < self.start[found]) & (found > first)):
            found = found - early
        while np.any(late := (found < last) & (s >= self.start[np.minimum(found + 1, last)])):
            found = found + late
        return found


class ReferenceLines:
    """Reference lines of roads 0..R-1.

    Lines and arcs in closed form. Spirals by 8-point Gauss quadrature of exp(i heading) on parts that turn
    by at most 1 rad: exact to rounding whatever the rate of curvature, so constant curvature and tiny rates
    need no case of their own. Polynomials through a table of their parameter, see `arclength`.
    """

    def __init__(self, roads: Sequence[Road]) -> None:
        parts = [(r, part) for r, road in enumerate(roads) for g in road.geometries for part in _split(g)]
        road = np.array([r for r, _ in parts], dtype=np.intp)
        self.length = np.array([r.length for r in roads])
        self.start = np.array([p.s for _, p in parts])
        self.steps = Steps(road, self.start, len(roads))
        self._kind = np.array([_kind(p) for _, p in parts])
        heading = np.array([p.heading for _, p in parts])
        bend = np.array([p.curvature_start for _, p in parts])
        rate = np.array([(p.curvature_end - p.curvature_start) / p.length for _, p in parts])
        x, y = np.array([p.x for _, p in parts]), np.array([p.y for _, p in parts])
        columns = (self.start, x, y, heading, np.cos(heading), np.sin(heading), bend, rate)
        self._table = np.stack(columns, axis=1)
        self._spirals = bool(np.any(self._kind == SPIRAL))
        self._polynomials = _Polynomials([p for _, p in parts]) if np.any(self._kind == POLYNOMIAL) else None
        sealed(self)

    def evaluate(self, road: Ints, s: Floats) -> Frame:
        """Give the frames of roads (N,) at s (N,) [m]; beyond a road's ends along the end tangent."""
        inside = np.minimum(np.maximum(s, 0.0), self.length[road])
        part = self.steps.find(road, inside)
        start, x, y, heading, cos, sin, bend, rate = self._table[part].T
        ds = inside - start
        half = 0.5 * bend * ds
        small = np.abs(half) < 1e-3
        ratio = np.where(small, 1.0 - half * half / 6.0, np.sin(half) / np.where(small, 1.0, half))
        u, v = ds * ratio * np.cos(half), ds * ratio * np.sin(half)
        turn, curvature, speed = ds * (bend + 0.5 * rate * ds), bend + rate * ds, np.ones_like(ds)
        kind = self._kind[part]
        if self._spirals and len(rows := np.flatnonzero(kind == SPIRAL)):
            u[rows], v[rows] = _spiral(ds[rows], bend[rows], rate[rows])
        if self._polynomials is not None and len(rows := np.flatnonzero(kind == POLYNOMIAL)):
            values = self._polynomials.evaluate(part[rows], ds[rows])
            for column, value in zip((u, v, turn, curvature, rate, speed), values, strict=True):
                column[rows] = value
        frame = Frame(x + cos * u - sin * v, y + sin * u + cos * v, heading + turn, curvature, rate, speed)
        return _extend(frame, s - inside)


def _extend(frame: Frame, beyond: Floats) -> Frame:
    """Go on along the tangent by `beyond` [m] where that is not zero."""
    rows = np.flatnonzero(beyond)
    if not len(rows):
        return frame
    heading = frame.heading[rows]
    frame.x[rows] += beyond[rows] * np.cos(heading)
    frame.y[rows] += beyond[rows] * np.sin(heading)
    straight = {"curvature": 0.0, "rate": 0.0, "speed": 1.0}
    out = {f.name: np.array(getattr(frame, f.name)) for f in fields(frame)}
    for name, value in straight.items():
        out[name][rows] = value
    return Frame(**out)


def _kind(part: Geometry) -> int:
    if part.kind in ("poly3", "paramPoly3"):
        return POLYNOMIAL
    return SPIRAL if part.curvature_start != part.curvature_end else ARC


def _spiral(ds: Floats, bend: Floats, rate: Floats) -> tuple[Floats, Floats]:
    g = ds[:, None] * NODES
    turn = g * (bend[:, None] + 0.5 * rate[:, None] * g)
    return ds * (np.cos(turn) @ WEIGHTS), ds * (np.sin(turn) @ WEIGHTS)


def _split(geometry: Geometry) -> list[Geometry]:
    """Cut a spiral into parts that turn by at most 1 rad; give anything else as it is."""
    if _kind(geometry) != SPIRAL:
        return [geometry]
    turn = max(abs(geometry.curvature_start), abs(geometry.curvature_end)) * geometry.length
    count = max(int(np.ceil(turn)), 1)
    step = geometry.length / count
    rate = (geometry.curvature_end - geometry.curvature_start) / geometry.length
    parts = []
    x, y, heading = geometry.x, geometry.y, geometry.heading
    for i in range(count):
        bend = geometry.curvature_start + rate * step * i
        parts.append(replace(geometry, s=geometry.s + i * step, x=x, y=y, heading=heading, length=step,
                             curvature_start=bend, curvature_end=bend + rate * step))  # fmt: skip
        u, v = _spiral(np.array([step]), np.array([bend]), np.array([rate]))
        x += float(np.cos(heading) * u[0] - np.sin(heading) * v[0])
        y += float(np.sin(heading) * u[0] + np.cos(heading) * v[0])
        heading += step * (bend + 0.5 * rate * step)
    return parts


class _Polynomials:
    """The polynomial elements among the parts, with one flat table of parameters over distance."""

    def __init__(self, parts: list[Geometry]) -> None:
        own = [i for i, part in enumerate(parts) if _kind(part) == POLYNOMIAL]
        tables = [invert(parts[i]) for i in own]
        counts = np.array([len(table.p) for table in tables])
        self.number = np.full(len(parts), -1, dtype=np.intp)
        self.number[own] = np.arange(len(own))
        self.first = np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.intp)
        self.intervals = counts - 1
        self.step = np.array([table.step for table in tables])
        self.p = np.concatenate([table.p for table in tables])
        self.slope = np.concatenate([table.slope for table in tables])
        self.curve = np.array([(parts[i].u, parts[i].v) for i in own])
        sealed(self)

    def evaluate(self, part: Ints, ds: Floats) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats]:
        """Give local u, v [m], turn [rad], curvature, its rate, and speed at ds [m] in the parts."""
        number = self.number[part]
        p, slope = self._parameter(number, ds)
        curve = self.curve[number]
        (u, v), (du, dv), (ddu, ddv), (dddu, dddv) = (powers(curve, p[:, None], k).T for k in range(4))
        speed = np.maximum(np.hypot(du, dv), 1e-9)
        curvature = (du * ddv - dv * ddu) / speed**3
        change = (du * dddv - dv * dddu) / speed**3
        rate = (change - 3.0 * curvature * (du * ddu + dv * ddv) / speed**2) / speed
        return u, v, np.arctan2(dv, du), curvature, rate, speed * slope

    def _parameter(self, number: Ints, ds: Floats) -> tuple[Floats, Floats]:
        """Give p and dp/ds by cubic Hermite interpolation of the table."""
        step = self.step[number]
        cell = np.clip((ds / step).astype(np.intp), 0, self.intervals[number] - 1)
        f = ds / step - cell
        i = self.first[number] + cell
        p0, p1, m0, m1 = self.p[i], self.p[i + 1], self.slope[i] * step, self.slope[i + 1] * step
        rise = p1 - p0
        c, d = 3.0 * rise - 2.0 * m0 - m1, m0 + m1 - 2.0 * rise
        return p0 + f * (m0 + f * (c + f * d)), (m0 + f * (2.0 * c + 3.0 * f * d)) / step
