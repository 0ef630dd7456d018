"""Levels: who is on a bridge and who is under it, and so cannot meet.

A height is that of the road's surface under the centre of a box, as the map has it (`resim.road.measured_heights`). The
grade of the way driven is that of a line of least squares over REACH before and after.

Two are apart where their heights differ by more than CLEAR and what roads can rise by on the way, at every place at
which they can meet: where each of them is now, and where the straight lines ahead of both cross. Who drives along one
line can be on one ramp, whose grade changes ahead: there roads may rise by STEEP. Where a height is unknown nobody is
apart: a wrong "apart" would be a false "safe".
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from resim.core.geometry import Bools, Floats
from resim.core.tracks import Tracks

REACH = 1.0
"""Time [s] before and after a sample over which a grade is."""
DRIVEN, STEEPEST = 2.0, 0.2
"""Spread [m] of the way in that time, from which on it tells a grade; and the steepest grade that is believed."""
CLEAR = 2.0
"""Difference of heights [m] up to which two are on one level."""
RISE, STEEP = 0.03, 0.15
"""What roads may rise [m per m of way] beyond the grade that is driven: to where lines cross, and along one line."""
ALONG = np.sin(np.radians(30.0))
"""Sine of the angle between two headings up to which they drive along one line, either way."""
FARTHEST, BEHIND = 200.0, 20.0
"""How far [m] ahead straight lines are looked at for where they cross, and how far behind: boxes are long."""


class Level(NamedTuple):
    """Where somebody is: x, y [m], heading [rad], height z [m, NaN unknown] and grade [m per m along the heading].

    All of one shape, or of shapes that broadcast.
    """

    x: Floats
    y: Floats
    heading: Floats
    z: Floats
    grade: Floats


def levels(tracks: Tracks) -> Level | None:
    """Give the level (N, T) of everybody; None where no height is known."""
    if tracks.z is None or not np.isfinite(tracks.z[tracks.valid]).any():
        return None
    grade = np.zeros(tracks.z.shape)
    for n, own in enumerate(tracks.valid):
        rows = np.flatnonzero(own)
        if len(rows):
            way = driven_way(tracks.x[n, rows], tracks.y[n, rows], tracks.heading[n, rows])
            grade[n, rows] = grades(tracks.t[rows], tracks.z[n, rows], way)
    return Level(tracks.x, tracks.y, tracks.heading, np.where(tracks.valid, tracks.z, np.nan), grade)


def driven_way(x: Floats, y: Floats, heading: Floats) -> Floats:
    """Give the way (K,) [m] driven along the heading since the first of positions (K,), negative in reverse."""
    steps = np.diff(x) * np.cos(heading[:-1]) + np.diff(y) * np.sin(heading[:-1])
    return np.concatenate([[0.0], np.cumsum(steps)])


def grades(t: Floats, z: Floats, way: Floats) -> Floats:
    """Give the grades (K,) [m per m of way] of samples at t (K,) [s], with heights z and ways (K,) [m].

    The slope of the line of least squares of the known heights around; 0 where it hardly moves.
    """
    known = np.isfinite(z)
    if not known.any():
        return np.zeros(len(t))
    at, t, z, way = t, t[known], z[known] - z[known][0], way[known] - way[known][0]
    terms = np.stack([np.ones(len(t)), way, z, way**2, way * z])
    sums = np.concatenate([np.zeros((5, 1)), np.cumsum(terms, axis=1)], axis=1)
    first = np.searchsorted(t, at - REACH - 1e-9)
    after = np.searchsorted(t, at + REACH + 1e-9, side="right")
    n, s, h, ss, sh = sums[:, after] - sums[:, first]
    count = np.maximum(n, 1.0)
    spread = np.maximum(ss / count - (s / count) ** 2, 0.0)
    moves = spread > DRIVEN**2
    grade = np.where(moves, (sh / count - s * h / count**2) / np.where(moves, spread, 1.0), 0.0)
    return np.asarray(np.clip(grade, -STEEPEST, STEEPEST))


def over(one: Floats, other: Floats) -> Bools:
    """Say who are one above the other at one place, from their heights [m]; never where a height is unknown."""
    return np.asarray(np.abs(one - other) > CLEAR)


def apart(a: Level, b: Level) -> Bools:
    """Say who are on two levels, and cannot meet; never where a height is unknown. a, b: shapes that broadcast."""
    cos_a, sin_a, cos_b, sin_b = np.cos(a.heading), np.sin(a.heading), np.cos(b.heading), np.sin(b.heading)
    dx, dy = b.x - a.x, b.y - a.y
    far, turn = np.hypot(dx, dy), cos_a * sin_b - sin_a * cos_b
    beside = np.abs(turn) < ALONG
    rise = np.where(beside, STEEP, RISE)
    there = np.abs(b.z - a.z - a.grade * (cos_a * dx + sin_a * dy)) > CLEAR + rise * far
    here = np.abs(a.z - b.z + b.grade * (cos_b * dx + sin_b * dy)) > CLEAR + rise * far
    with np.errstate(invalid="ignore", divide="ignore"):
        way_a = (dx * sin_b - dy * cos_b) / turn
        way_b = (dx * sin_a - dy * cos_a) / turn
        meet = (np.abs(turn) > 1e-3) & (np.minimum(way_a, way_b) >= -BEHIND)
        meet &= np.maximum(way_a, way_b) <= FARTHEST
        off = np.abs(a.z + a.grade * way_a - b.z - b.grade * way_b)
        crossing = off > CLEAR + RISE * (np.abs(way_a) + np.abs(way_b))
    return np.asarray(there & here & (crossing | ~meet))


def apart_from(tracks: Tracks, row: int) -> Bools | None:
    """Say (N, T) when who is on another level than the object of that row; None where no height is known."""
    found = levels(tracks)
    if found is None or not np.isfinite(found.z[row]).any():
        return None
    return apart(Level(*(column[row] for column in found)), found)
