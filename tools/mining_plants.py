"""Drives planted on a stretch of a map: ways along its line and metres aside by time, as tracks and as what they are.

Places in lanes follow from how a drive was planted; of a varied recording, whose drives are near the planted ones, from
the nearest points of the line.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from mining_ground import CLASSES, Ground
from mining_rules import (
    Event,
    Seen,
    collisions,
    critical,
    cuts,
    differences,
    follow_lane,
    lane_changes,
    leaders,
    on_foot,
    passes,
    ramps,
    speeds,
    swerving,
    tailgating,
    wrong_way,
)
from scipy.spatial import cKDTree

from resim.core.tracks import Tracks

RATE, FINE = 25.0, 1e-3
"""Hz; s over which speeds are told of places."""
SLOW_LIMIT = 50.0 / 3.6
"""m/s: a road without a type whose limit is not above it is one of a town (scenarios/mining/labels.toml)."""
POINTS = 0.02
"""m between the points of a line to which varied drives are held."""
Profile = Callable[[np.ndarray], np.ndarray]


def quintic(t: np.ndarray, begin: float, lasts: float, size: float) -> np.ndarray:
    """A smooth step of a size."""
    u = np.clip((t - begin) / lasts, 0.0, 1.0)
    return size * (10.0 * u**3 - 15.0 * u**4 + 6.0 * u**5)


def stepped(start: float, *steps: tuple[float, float, float]) -> Profile:
    """Give places that begin at `start` and move by smooth steps (begin, lasts, size)."""
    return lambda t: start + sum((quintic(t, *one) for one in steps), np.zeros_like(t))


def driven(start: float, v: float, *steps: tuple[float, float, float]) -> Profile:
    """Give ways of a drive from `start` [m] at v [m/s], which changes by smooth steps (begin, lasts, size)."""

    def way(t: np.ndarray) -> np.ndarray:
        out = start + v * t
        for begin, lasts, size in steps:
            u = np.clip((t - begin) / lasts, 0.0, 1.0)
            out = out + size * lasts * (2.5 * u**4 - 3.0 * u**5 + u**6)
            out = out + size * np.clip(t - begin - lasts, 0.0, None)
        return out

    return way


@dataclass(frozen=True)
class Drive:
    """Somebody on a line: way along it and metres to the left by time, and when it is there [s]."""

    name: str
    way: Profile
    aside: Profile
    end: float
    start: float = 0.0
    kind: str = "car"
    length: float = 4.7
    width: float = 1.9
    backwards: bool = False


@dataclass(frozen=True, eq=False)
class Plant:
    """What was planted on purpose (object, label, from when to when), by drives on a ground."""

    ground: Ground
    drives: Sequence[Drive]
    told: Sequence[Event]


def tracks_of(ground: Ground, drives: Sequence[Drive]) -> tuple[Tracks, np.ndarray, np.ndarray]:
    """Give the tracks of drives, their ways along the line and metres aside (N, T)."""
    t = np.arange(round(max(d.end for d in drives) * RATE) + 1) / RATE
    shape = len(drives), len(t)
    x, y, heading, v, way, aside = (np.full(shape, np.nan) for _ in range(6))
    for n, drive in enumerate(drives):
        there = (t >= drive.start - 1e-9) & (t <= drive.end + 1e-9)
        own = t[there]
        places = [ground.path.xy(drive.way(at), drive.aside(at)) for at in (own - FINE, own, own + FINE)]
        (x0, y0), (x[n, there], y[n, there]), (x1, y1) = places
        vx, vy = (x1 - x0) / (2.0 * FINE), (y1 - y0) / (2.0 * FINE)
        v[n, there], way[n, there], aside[n, there] = np.hypot(vx, vy), drive.way(own), drive.aside(own)
        along = np.interp(way[n, there], ground.path.s, ground.path.heading)
        heading[n, there] = np.where(v[n, there] > 1e-4, np.arctan2(vy, vx), along)
        if drive.backwards:
            v[n], heading[n] = -v[n], heading[n] + np.pi
    tracks = Tracks(
        t=t, ids=np.array([d.name for d in drives], dtype=str), kind=np.array([d.kind for d in drives], dtype=str),
        x=x, y=y, heading=np.angle(np.exp(1j * heading)), v=v, length=np.array([d.length for d in drives]),
        width=np.array([d.width for d in drives]), valid=np.isfinite(x),
    )  # fmt: skip
    return tracks, way, aside


def placed(ground: Ground, tracks: Tracks) -> tuple[np.ndarray, np.ndarray]:
    """Give ways along the line and metres aside (N, T) of any tracks near it, by its nearest points."""
    s = np.arange(-40.0, ground.length + 40.0, POINTS)
    x, y = ground.path.xy(s, np.zeros(len(s)))
    line = x + 1j * y
    ahead = np.gradient(line) / np.abs(np.gradient(line))
    way, aside = np.full(tracks.x.shape, np.nan), np.full(tracks.x.shape, np.nan)
    own = tracks.x[tracks.valid] + 1j * tracks.y[tracks.valid]
    _, near = cKDTree(np.column_stack([x, y])).query(np.column_stack([own.real, own.imag]))
    off = (own - line[near]) * np.conj(ahead[near])
    way[tracks.valid], aside[tracks.valid] = s[near] + off.real, off.imag
    return way, aside


def seen(ground: Ground, tracks: Tracks, way: np.ndarray, aside: np.ndarray) -> Seen:
    """Give everybody in the lanes of a ground."""
    lanes, valid = ground.lanes, tracks.valid
    bounds = [lane.right for lane in lanes]
    lane = np.full(way.shape, -1)
    for k in range(len(lanes)):
        lane[valid & (aside > bounds[k]) & (aside <= lanes[k].left)] = k
    same = np.array([one.same for one in lanes])
    centre = np.array([one.centre for one in lanes])
    on, sign = lane >= 0, np.where(same[lane], 1.0, -1.0)
    station = np.full(way.shape, np.nan)
    for k in range(len(lanes)):
        here = on & (lane == k)
        station[here] = (1.0 if same[k] else -1.0) * ground.station(k, way[here])
    line = np.interp(way, ground.path.s, ground.path.heading)
    rel = tracks.heading - line - np.where(sign > 0.0, 0.0, np.pi)
    near = [(k, step) for k in range(len(lanes)) for step in (-1, 1)]
    beside = {
        (k, step): k + step for k, step in near
        if 0 <= k + step < len(lanes) and lanes[k].same == lanes[k + step].same
    }  # fmt: skip
    left = [beside.get((k, -1 if one.same else 1), -1) for k, one in enumerate(lanes)]
    right = [beside.get((k, 1 if one.same else -1), -1) for k, one in enumerate(lanes)]
    limit = ground.path.speed_limit_at(np.nan_to_num(way).ravel()).reshape(way.shape)
    roads = np.array([[ground.road_at(one) for one in row] for row in np.nan_to_num(way)])
    told = ~np.isin(roads, ["", "unknown"])
    town = np.where(told, np.char.startswith(roads, "town"), limit <= SLOW_LIMIT) & on
    inside = np.zeros(way.shape, dtype=bool)
    for begin, end, _ in ground.turns:
        inside |= (way >= begin) & (way <= end)
    return Seen(
        tracks.ids.tolist(), tracks.kind.tolist(), tracks.length, tracks.width, tracks.t, valid, tracks.x, tracks.y,
        tracks.heading, tracks.v, differences(tracks.t, tracks.v, valid), lane, lane, station,
        sign * (aside - centre[lane]), aside, rel, np.where(on, lane, -1), left, right, _classes(ground), limit, town,
        inside,
    )  # fmt: skip


def _classes(ground: Ground) -> list[str]:
    """By lane, what kind of road it is of."""
    ramped = any(lane.kind in CLASSES for lane in ground.lanes)
    road = ground.road_at(0.0)
    plain = "main" if road == "motorway" or (ramped and road != "town") else "other"
    plain = plain if road not in ("", "unknown") or ramped else ""
    return [CLASSES.get(lane.kind, plain) for lane in ground.lanes]


def truth(ground: Ground, one: Seen) -> list[Event]:
    """Give everything that objects do on a ground."""
    led = leaders(one)
    across = differences(one.t, one.aside, one.valid)
    out = list(collisions(one))
    for row, name in enumerate(one.names):
        out += on_foot(one, row)
        if not one.motor(row) or not one.valid[row].any():
            continue
        changes = lane_changes(one, row, across[row])
        out += [(name, change.label, change.start, change.end) for change in changes]
        for change in changes:
            out += cuts(one, row, change, led)
        for rule in (tailgating, critical):
            out += rule(one, row, led)
        for rule in (ramps, passes, wrong_way, swerving, speeds):
            out += rule(one, row)
        out += follow_lane(one, row, changes)
        out += turns(ground, one, row)
    return out


def turns(ground: Ground, one: Seen, row: int) -> list[Event]:
    """Ways through the ground's junctions, of who was seen before and behind them."""
    steps, out = one.steps(row), []
    way, _ = ground.path.project(one.x[row, steps], one.y[row, steps])
    for begin, end, label in ground.turns:
        inside = np.flatnonzero((way >= begin) & (way <= end))
        if len(inside) and way[0] < begin and way[-1] > end:
            out.append(
                (one.names[row], label, float(one.t[steps[inside[0]]]), float(one.t[steps[inside[-1]]]))
            )
    return out
