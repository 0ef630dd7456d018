"""Drives planted on a stretch of a map: ways along its line and metres aside by time, as tracks and as what they are.

Places in lanes follow from how a drive was planted; of a varied recording, whose drives are near the planted ones, from
the nearest points of the line.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import mining_catalog_rules as catalog_rules
import numpy as np
from mining_ground import CLASSES, Ground
from mining_rules import (
    Event,
    Seen,
    collisions,
    differences,
    driving,
    lane_changes,
    leaders,
    on_foot,
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
    """Somebody on a line: way along it and metres to the left by time, and when it is there [s].

    yaw [rad] by time: how far it is headed to the left of its way.
    """

    name: str
    way: Profile
    aside: Profile
    end: float
    start: float = 0.0
    kind: str = "car"
    length: float = 4.7
    width: float = 1.9
    backwards: bool = False
    yaw: Profile | None = None


@dataclass(frozen=True, eq=False)
class Plant:
    """What was planted on purpose (object, label, from when to when), by drives on a ground.

    beside: a drive on another way through the same junction.
    """

    ground: Ground
    drives: Sequence[Drive]
    told: Sequence[Event]
    beside: tuple[Ground, Drive] | None = None


def tracks_of(
    ground: Ground, drives: Sequence[Drive], end: float = 0.0
) -> tuple[Tracks, np.ndarray, np.ndarray]:
    """Give the tracks of drives, until `end` [s] at least, their ways along the line and metres aside (N, T)."""
    t = np.arange(round(max(end, *(d.end for d in drives)) * RATE) + 1) / RATE
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
        if drive.yaw is not None:
            heading[n, there] += drive.yaw(own)
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
    limit = np.where(on, limit, np.nan)
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
    out = [*collisions(one), *catalog_rules.skidding(one)]
    for row in range(len(one.names)):
        out += [*on_foot(one, row), *catalog_rules.on_foot(one, row)]
        if not one.motor(row) or not one.valid[row].any():
            continue
        out += driving(one, row, lane_changes(one, row, across[row]), led)
        out += [*catalog_rules.crowd(one, row), *catalog_rules.starting(one, row)]
        out += [*turns(ground, one, row), *_by_map(ground, one, row)]
    return [
        *out,
        *catalog_rules.crashes(one, [passing_of(ground, one, row) for row in range(len(one.names))]),
    ]


def along(ground: Ground, one: Seen, row: int) -> np.ndarray:
    """Give metres (T,) along a ground's line, NaN where somebody is not there."""
    steps, out = one.steps(row), np.full(len(one.t), np.nan)
    out[steps], _ = ground.path.project(one.x[row, steps], one.y[row, steps])
    return out


def passing_of(ground: Ground, one: Seen, row: int) -> catalog_rules.Through | None:
    """Give how somebody passes the ground's junction, None without one."""
    if not ground.turns:
        return None
    begin, end, _ = ground.turns[0]
    heading = float(np.interp(begin, ground.path.s, ground.path.heading))
    return catalog_rules.Through(ground.junction, begin, end, heading, ground.turn, along(ground, one, row))


def _by_map(ground: Ground, one: Seen, row: int) -> list[Event]:
    """What follows from what the map says of the ground."""
    way, name = along(ground, one, row), one.names[row]
    out = list(catalog_rules.edges(one, row, ground.edges, ground.lanes[0].left))
    out += catalog_rules.lanes_change(one, row, way, ground.counts)
    out += catalog_rules.backing(one, row, way, ground.crossings)
    if ground.turns and ground.signs.told and not ground.signs.lit:
        out += [(name, "unprotected_way", start, end) for _, _, start, end in turns(ground, one, row)]
    if ground.turns and ground.signs.stop:
        out += catalog_rules.stop_sign(one, row, way, *ground.turns[0][:2])
    return out


ON_TWO_WAYS = (
    "turn_left", "turn_right", "straight", "u_turn", "standing", "starting", "strong_braking", "strong_acceleration",
    "skidding", "reversing", "reversing_at_junction", "leave_road", "road_widens", "lane_ends", "unprotected_way",
    "run_stop_sign",
)  # fmt: skip
"""Labels that are compared for each of two on two ways through a junction, besides collisions, how these came about,
and protected ways; those by who is ahead, or on which lane, are not."""


def two_ways(plant: Plant) -> tuple[Tracks, list[Event], set[str]]:
    """Give the tracks of two on two ways through a junction, what they do, and the labels that this is all of."""
    (first,), (other, second) = plant.drives, plant.beside
    end = max(first.end, second.end)
    parts = [
        (ground, *tracks_of(ground, [drive], end))
        for ground, drive in ((plant.ground, first), (other, second))
    ]
    views = [seen(ground, tracks, way, aside) for ground, tracks, way, aside in parts]
    out = [
        event for (ground, *_), view in zip(parts, views, strict=True) for event in truth(ground, view)
        if event[1] in ON_TWO_WAYS
    ]  # fmt: skip
    both = _joined(*views)
    through = [passing_of(ground, view, 0) for (ground, *_), view in zip(parts, views, strict=True)]
    crashed = list(catalog_rules.crashes(both, through))
    out += [*collisions(both), *crashed]
    for own, (ground, *_) in enumerate(parts):
        if ground.signs.lit:
            ways = turns(ground, views[own], 0)
            out += [
                (name, "protected_way", a, b) for name, _, a, b in ways
                if catalog_rules.held_back(both, 1 - own, through[1 - own], (a, b))
            ]  # fmt: skip
    return (
        Tracks.concatenate([tracks for _, tracks, _, _ in parts]),
        out,
        {*ON_TWO_WAYS, *CRASHES, "protected_way"},
    )


CRASHES = (
    "collision", "sideswipe", "crash_left_across_lateral", "crash_left_across_opposite", "crash_left_into_path",
    "crash_right_across_lateral", "crash_right_into_path", "crash_straight_crossing", "crash_other_crossing",
)  # fmt: skip


def _joined(one: Seen, two: Seen) -> Seen:
    """Both views as one, for what is told of places and headings alone."""
    own = {
        part.name: np.concatenate([getattr(one, part.name), getattr(two, part.name)])
        for part in fields(Seen)
        if part.name != "t" and isinstance(getattr(one, part.name), np.ndarray)
    }
    return replace(one, names=[*one.names, *two.names], kinds=[*one.kinds, *two.kinds], **own)


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
