"""Trajectories of OpenSCENARIO: polylines, clothoids and NURBS, over time or over the way.

Source: ASAM OpenSCENARIO XML 1.3, "Shape", "Timing", "FollowTrajectoryAction".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.interpolate import BSpline

from resim.core.geometry import Floats, wrap_angle
from resim.recordings.storyboard.document import ScenarioElement
from resim.recordings.storyboard.places import ScenarioPlace, ScenarioPlaces

_SAME = 1e-9
"""s or m; a time this near to a vertex is its."""
_SAMPLES = 200
"""Points of a NURBS between two knots: between them it is straight."""
_MOST_SAMPLES = 100_000
_HIGHEST_ORDER = 20
_NODES, _WEIGHTS = (0.5 * value for value in np.polynomial.legendre.leggauss(8))
_LONGEST = 1e6
"""Largest length [m] of a clothoid."""


@dataclass(frozen=True, eq=False)
class ScenarioCurve:
    """Where a trajectory leads.

    Attributes:
        begin: First time [s], or way [m].
        end: Last time [s], or way [m].
        timed: Whether it is over time, else over the way that is driven.
        at: Gives x, y [m] and heading [rad] (3, T) at times or ways (T,) within.
        stations: Times or ways of its vertices (K,).
    """

    begin: float
    end: float
    timed: bool
    at: Callable[[Floats], Floats]
    stations: Floats

    def over(self, scale: float, offset: float) -> ScenarioCurve:
        """Give the curve at scale times its times, and offset [s] later; scale is above 0."""
        at = self.at
        return replace(
            self, begin=scale * self.begin + offset, end=scale * self.end + offset,
            at=lambda t: at((t - offset) / scale), stations=scale * self.stations + offset,
        )  # fmt: skip


def scenario_curve(trajectory: ScenarioElement, places: ScenarioPlaces, *, timed: bool) -> ScenarioCurve:
    """Give the curve of a Trajectory.

    Args:
        trajectory: The element.
        places: Reads its positions.
        timed: Whether its times count, else the way.

    Raises:
        InputError: It has no such shape, is closed, or lacks times.
    """
    if trajectory.flag("closed"):
        raise trajectory.refused("is closed: how often it is driven depends on the player", "Open it.")
    shape = trajectory.needed("Shape").only()
    if shape.tag == "Polyline":
        return _polyline(shape, places, timed)
    if shape.tag == "Clothoid":
        return _clothoid(shape, places, timed)
    if shape.tag == "Nurbs":
        return _nurbs(shape, places, timed)
    raise shape.refused("is not read", "Shapes that are read are Polyline, Clothoid and Nurbs.")


def _polyline(shape: ScenarioElement, places: ScenarioPlaces, timed: bool) -> ScenarioCurve:
    vertices = [*shape.children("Vertex")]
    if len(vertices) < 2:
        raise shape.refused(f"has {len(vertices)} vertices, expected 2 or more")
    found = [places.of(one.needed("Position")) for one in vertices]
    times = np.array([one.number("time") for one in vertices]) if timed else None
    if times is not None and len(late := np.flatnonzero(np.diff(times) <= 0.0)):
        before, now = times[late[0]], times[late[0] + 1]
        raise vertices[late[0] + 1].refused(f"time {now:g} s does not follow {before:g} s")
    x, y, stated = _columns(found)
    if times is None:
        keep = np.r_[True, np.hypot(np.diff(x), np.diff(y)) > _SAME]
        x, y, stated = x[keep], y[keep], stated[keep]
        if len(x) < 2:
            raise shape.refused("stays where it begins")
        times = np.r_[0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y)))]
    return _straight_pieces(times, x, y, stated, timed)


def _columns(places: list[ScenarioPlace]) -> tuple[Floats, Floats, Floats]:
    """x, y [m] and the headings [rad] that are stated, else NaN, each (K,)."""
    rows = np.array([(p.x, p.y, np.nan if p.heading is None else p.heading) for p in places])
    return rows[:, 0], rows[:, 1], rows[:, 2]


def _straight_pieces(p: Floats, x: Floats, y: Floats, stated: Floats, timed: bool) -> ScenarioCurve:
    """A curve that is straight from station p (K,) to station; its heading is the tangent where none is stated."""
    tangent = _directions(np.diff(x), np.diff(y), stated)
    first = np.where(np.isfinite(stated[:-1]), stated[:-1], tangent)
    turn = wrap_angle(np.where(np.isfinite(stated[1:]), stated[1:], tangent) - first)

    def at(t: Floats) -> Floats:
        k = np.clip(np.searchsorted(p, t, side="right") - 1, 0, len(p) - 2)
        f = np.clip((t - p[k]) / (p[k + 1] - p[k]), 0.0, 1.0)
        heading = first[k] + f * turn[k]
        inner = (k > 0) & (np.abs(t - p[k]) <= _SAME)  # between two tangents the one between
        into = first[k - 1] + turn[k - 1]
        heading = np.where(inner, heading + 0.5 * wrap_angle(into - heading), heading)
        return np.stack([x[k] + f * (x[k + 1] - x[k]), y[k] + f * (y[k + 1] - y[k]), heading])

    return ScenarioCurve(float(p[0]), float(p[-1]), timed, at, p)


def _directions(dx: Floats, dy: Floats, stated: Floats) -> Floats:
    """Directions (K - 1,) [rad] of pieces; one without length has that of the one before, the first of one after."""
    moves = np.hypot(dx, dy) > 1e-6
    out = np.arctan2(dy, dx)
    if not moves.any():
        told = stated[np.isfinite(stated)]
        return np.full(len(dx), told[0] if len(told) else 0.0)
    last = np.maximum.accumulate(np.where(moves, np.arange(len(dx)), -1))
    return np.asarray(out[np.where(last < 0, np.argmax(moves), last)])


def _clothoid(shape: ScenarioElement, places: ScenarioPlaces, timed: bool) -> ScenarioCurve:
    start = places.of(shape.needed("Position"))
    length, bend = shape.number("length"), shape.number("curvature")
    rate = shape.number("curvaturePrime" if shape.get("curvaturePrime") is not None else "curvatureDot")
    turned = abs(bend) * length + 0.5 * abs(rate) * length**2
    if not 0.0 < length <= _LONGEST or turned > 1e4:
        raise shape.refused(f"has length {length:g} m and turns by up to {turned:g} rad, which is none")
    begin, end = (shape.number("startTime"), shape.number("stopTime")) if timed else (0.0, length)
    if begin >= end:
        raise shape.refused(f"stopTime {end:g} s does not follow startTime {begin:g} s")
    pieces = max(int(np.ceil(turned)), 1)
    borders = np.linspace(0.0, length, pieces + 1)
    heading = start.faced

    def turn(s: Floats) -> Floats:
        return heading + s * (bend + 0.5 * rate * s)

    def gained(s0: Floats, s1: Floats) -> Floats:
        s = 0.5 * (s0 + s1)[:, None] + (s1 - s0)[:, None] * _NODES
        return np.asarray((s1 - s0) * (np.exp(1j * turn(s)) @ _WEIGHTS))

    corner = start.x + 1j * start.y + np.r_[0.0, np.cumsum(gained(borders[:-1], borders[1:]))]

    def at(p: Floats) -> Floats:
        s = np.clip((p - begin) / (end - begin), 0.0, 1.0) * length
        k = np.clip(np.searchsorted(borders, s, side="right") - 1, 0, pieces - 1)
        z = corner[k] + gained(borders[k], s)
        return np.stack([z.real, z.imag, turn(s)])

    return ScenarioCurve(begin, end, timed, at, np.array([begin, end]))


def _nurbs(shape: ScenarioElement, places: ScenarioPlaces, timed: bool) -> ScenarioCurve:
    """A NURBS, its control points' times of the same weights as their places."""
    points, order = [*shape.children("ControlPoint")], shape.number("order")
    knots = np.array([one.number("value") for one in shape.children("Knot")])
    if order != int(order) or not 2 <= order <= min(_HIGHEST_ORDER, len(points)):
        raise shape.refused(f"has order {order:g} and {len(points)} control points; expected 2 to as many")
    k = int(order) - 1
    if len(knots) != len(points) + k + 1 or np.any(np.diff(knots) < 0.0) or knots[k] >= knots[-k - 1]:
        problem = f"has {len(knots)} knots, expected {len(points) + k + 1}, none less than the one before"
        raise shape.refused(problem)
    weights = np.array([one.number("weight", 1.0) for one in points])
    if weights.min() <= 0.0:
        raise shape.refused(f"has a control point of weight {weights.min():g}, expected more than 0")
    x, y, _ = _columns([places.of(one.needed("Position")) for one in points])
    times = np.array([one.number("time") for one in points]) if timed else np.zeros(len(points))
    inner = np.unique(knots[k : len(knots) - k])
    per_piece = max(min(_SAMPLES, _MOST_SAMPLES // len(inner)), 2)
    u = np.unique(np.concatenate([np.linspace(a, b, per_piece) for a, b in pairwise(inner)]))
    with np.errstate(all="ignore"):
        found = BSpline(knots, np.stack([x, y, times, np.ones(len(points))], axis=1) * weights[:, None], k)(u)
        x, y, t = (found[:, :3] / found[:, 3:]).T
    p = t if timed else np.r_[0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y)))]
    if not np.isfinite(found).all() or np.any(np.diff(p) <= 0.0):
        raise shape.refused("goes back in time, or stays where it is" if timed else "stays where it is")
    return _straight_pieces(p, x, y, np.full(len(x), np.nan), timed)
