"""Measured heights against those of the map: a height tells on which of the roads one above the other an object is.

The height that counts is that road's, not the measured one, so that two on one road are never apart. A wrong height
would part who meets, so nothing is believed of an object where the map does not bear its height out: at nearly all its
places one of the lanes there has it, to within `LEVEL`, and is nearer to it by `CLEAR` than any above or below; and
from place to place the lanes that are nearest to it rise no more than roads do. Heights that are all off by one amount
(such as those over the ellipsoid) are taken to the map's by it. Nothing is believed on a map without heights, nor where
there is no lane.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Bools, Floats
from resim.core.levels import CLEAR, over
from resim.core.objects import linked
from resim.core.sightings import SAME
from resim.core.tracks import Tracks
from resim.road.opendrive import RoadNetwork
from resim.road.opendrive.index import LEVEL

EVERY = 0.5
"""Time [s] between the places of an object that are looked up."""
STEP, STEEP = 1.0, 0.15
"""Difference of height [m] between lanes that an object drives over from one to the other, besides what the steepest
roads rise on the way."""
MOST = 0.9
"""Share of an object's places at which it has to be on a lane's height."""
HANDED, MISS, HARDEST = 1.0, 2.0, 10.0
"""Of one id that goes on as another: time [s] between them, how far [m] the other may begin from where it was going to,
and what turning and braking add to that [m/s²]."""
BIN = 1.0
"""Width [m] of the classes in which an offset of all heights is looked for."""


class HeightTrack(NamedTuple):
    """An object's samples: t [s], increasing, x, y and height z [m], NaN where not measured, each (K,)."""

    id: str
    t: Floats
    x: Floats
    y: Floats
    z: Floats


@dataclass(frozen=True, eq=False)
class MeasuredHeights:
    """z: of each track (K,) m in the map's heights, NaN where none is believed.

    offset: m that all were above the map's. why: of everybody, why nothing is believed, or "". doubted: by the
    number of the track, why nothing of its is believed.
    """

    z: tuple[Floats, ...]
    offset: float = 0.0
    why: str = ""
    doubted: Mapping[int, str] = field(default_factory=dict)


def with_heights(tracks: Tracks, network: RoadNetwork) -> Tracks:
    """Give the tracks with the heights that are believed; none where none is."""
    if tracks.z is None:
        return tracks
    own = [np.flatnonzero(rows) for rows in tracks.valid]
    names = tracks.ids.tolist()
    made = [
        HeightTrack(names[n], tracks.t[k], tracks.x[n, k], tracks.y[n, k], tracks.z[n, k])
        for n, k in enumerate(own)
    ]
    z = np.full(tracks.z.shape, np.nan)
    for n, values in enumerate(measured_heights(made, network).z):
        z[n, own[n]] = values
    return replace(tracks, z=z if np.isfinite(z).any() else None)


def measured_heights(tracks: Sequence[HeightTrack], network: RoadNetwork) -> MeasuredHeights:
    """Look at the heights of tracks in the map."""
    unknown = tuple(np.full(len(k.t), np.nan) for k in tracks)
    if not any(np.isfinite(k.z).any() for k in tracks):
        return MeasuredHeights(unknown)
    if not network.has_heights:
        return MeasuredHeights(unknown, why="the map has no heights that could bear them out")
    looked = [_places(k) for k in tracks]
    row = np.repeat(np.arange(len(tracks)), [len(k) for k in looked])
    x, y, z, known = (np.concatenate(column) for column in zip(*map(_at, tracks, looked), strict=True))
    known = known.astype(bool)
    point, surface = network.surfaces(x, y)
    above, told = z[point] - surface, known[point]
    offset = _offset(above[told], row[point[told]], point[told])
    if offset is None:
        return MeasuredHeights(unknown, why="they are not on the roads of the map, nor all off by one amount")
    level = _nearest(z - offset, point, surface)
    off = np.abs(z - offset - level)
    on = off <= LEVEL
    as_near = (np.abs(above - offset) < off[point] + CLEAR) & over(surface, level[point])
    on[point[as_near]] = False  # it could be on either of two roads
    out, doubted = [], {}
    for n, k in enumerate(tracks):
        own = row == n
        if own.any() and (why := _doubt(k, looked[n], level[own], on[own], known[own])):
            doubted[n] = why
        sure = known[own] & on[own] & (n not in doubted)
        out.append(_between(k, looked[n][known[own]], np.where(sure, level[own], np.nan)[known[own]]))
    for n, why in _handed_over(tracks, out).items():
        doubted[n], out[n] = why, unknown[n]
    return MeasuredHeights(tuple(out), offset, "", dict(sorted(doubted.items())))


def _handed_over(tracks: Sequence[HeightTrack], z: Sequence[Floats]) -> dict[int, str]:
    """Give the tracks whose height leaps where one id is continued by another, and why, by their numbers.

    All that can be one object are doubted together. z: of each track (K,) m, as it is believed of that alone.
    """
    there = [np.flatnonzero(np.isfinite(k.x + k.y)) for k in tracks]
    some = [n for n, k in enumerate(there) if len(k)]
    out: dict[int, str] = {}
    for group in _groups(tracks, there, some):
        known = [(n, np.flatnonzero(np.isfinite(z[n]))) for n in group]
        known = sorted(((n, k) for n, k in known if len(k)), key=lambda nk: float(tracks[nk[0]].t[nk[1][0]]))
        leaps = [
            (rise, one, other)
            for (one, k), (other, m) in pairwise(known)
            if (rise := abs(float(z[other][m[0]] - z[one][k[-1]])))
            > _can_rise(tracks[one], k, tracks[other], m)
        ]
        if leaps:
            rise, one, other = max(leaps)
            ids = f"{tracks[one].id!r} goes on as {tracks[other].id!r}"
            out |= dict.fromkeys(group, f"{ids}, which is {rise:.1f} m above or below")
    return out


def _can_rise(one: HeightTrack, known: NDArray[np.intp], other: HeightTrack, told: NDArray[np.intp]) -> float:
    """Give by how much [m] the road can have risen between the last known height of one and the first of another."""
    k, m = known[-1], told[0]
    way = math.hypot(other.x[m] - one.x[k], other.y[m] - one.y[k])
    _, _, velocity = _end(one, np.flatnonzero(np.isfinite(one.x + one.y)))
    return STEP + STEEP * max(way, abs(velocity) * float(other.t[m] - one.t[k]))


def _groups(
    tracks: Sequence[HeightTrack], there: Sequence[NDArray[np.intp]], some: Sequence[int]
) -> list[list[int]]:
    """Give the tracks that can be one object, in groups of two and more: where one ends, another begins soon after."""
    begins = np.array([float(tracks[n].t[there[n][0]]) for n in some])
    places = np.array([complex(tracks[n].x[there[n][0]], tracks[n].y[there[n][0]]) for n in some])
    links: tuple[list[int], list[int]] = ([], [])
    for k, n in enumerate(some):
        t, place, velocity = _end(tracks[n], there[n])
        dt = begins - t
        soon = (dt > 0.0) & (dt <= HANDED + SAME)
        near = np.abs(places - place - velocity * dt) <= MISS + HARDEST * dt * dt
        after = np.flatnonzero(soon & near).tolist()
        links[0].extend([k] * len(after))
        links[1].extend(after)
    return [[some[k] for k in group] for group in linked(*links, len(some))]


def _end(track: HeightTrack, there: NDArray[np.intp]) -> tuple[float, complex, complex]:
    """When [s] and where [m] a track ends, and its velocity [m/s] there. there: its samples with a place."""
    t, place = track.t[there], track.x[there] + 1j * track.y[there]
    before = max(int(np.searchsorted(t, t[-1] - EVERY)) - 1, 0)
    velocity = (place[-1] - place[before]) / (t[-1] - t[before]) if before < len(t) - 1 else 0j
    return float(t[-1]), complex(place[-1]), complex(velocity)


def _places(track: HeightTrack) -> NDArray[np.intp]:
    """Samples of a track with heights that are looked up: of all, and of those with a height."""
    there = np.flatnonzero(np.isfinite(track.x + track.y))
    told = there[np.isfinite(track.z[there])]
    return np.union1d(_every(track.t, there), _every(track.t, told)) if len(told) else told


def _every(t: Floats, own: NDArray[np.intp]) -> NDArray[np.intp]:
    """Of samples at t [s] the first of each EVERY, those before and after gaps of more, and the last."""
    first = own[np.unique(np.floor(t[own] / EVERY), return_index=True)[1]]
    gap = np.flatnonzero(np.diff(t[own]) > EVERY)
    return np.unique(np.concatenate([first, own[gap], own[gap + 1], own[-1:]]))


def _at(track: HeightTrack, places: NDArray[np.intp]) -> tuple[Floats, Floats, Floats, Bools]:
    """x, y, z [m] at places of a track, and whether z is measured there; elsewhere it is what lies between."""
    t, x, y, z = (column[places] for column in track[1:])
    known = np.isfinite(z)
    return x, y, np.interp(t, t[known], z[known]) if known.any() else z, known


def _nearest(z: Floats, point: NDArray[np.intp], surface: Floats) -> Floats:
    """Give the height [m] of the lane at each place (P,) that is nearest to its height z [m]; NaN where there is none.

    surface (M,) m: of lanes at places `point` (M,).
    """
    out = np.full(len(z), np.nan)
    order = np.lexsort((np.abs(z[point] - surface), point))
    first = order[np.unique(point[order], return_index=True)[1]]
    out[point[first]] = surface[first]
    return out


def _between(track: HeightTrack, places: NDArray[np.intp], level: Floats) -> Floats:
    """Give the heights (K,) [m] of a track from those at places (P,): at samples with a height, at and between places
    that are known and not far apart in time."""
    out = np.full(len(track.t), np.nan)
    if not len(places):
        return out
    own = np.flatnonzero(np.isfinite(track.z + track.x + track.y))
    at, t = track.t[own], track.t[places]
    after = np.searchsorted(t, at).clip(max=len(t) - 1)
    near = (t[after] - t[np.maximum(after - 1, 0)] <= 2.0 * EVERY) | (t[after] == at)
    out[own] = np.where(near, np.interp(at, t, level), np.nan)
    return out


def _offset(above: Floats, row: NDArray[np.intp], point: NDArray[np.intp]) -> float | None:
    """How far [m] the heights of most objects are above some lane: 0, else the amount that most have; None for none.

    above (M,) m: of places over lanes, of objects `row` (M,) at places `point` (M,).
    """
    if not len(above):
        return 0.0
    every = len(np.unique(row))
    if 2 * _fitting(above, row, point) >= every:
        return 0.0
    classes, counts = np.unique(np.floor(above / BIN), return_counts=True)
    known = dict(zip(classes.tolist(), counts.tolist(), strict=True))
    low = max(known, key=lambda c: (known[c] + known.get(c + 1.0, 0), -c)) * BIN
    offset = float(np.median(above[(above >= low) & (above < low + 2.0 * BIN)]))
    return offset if 2 * _fitting(above - offset, row, point) > every else None


def _fitting(above: Floats, row: NDArray[np.intp], point: NDArray[np.intp]) -> int:
    """How many objects are on a lane's height at MOST of their places."""
    count = 0
    for n in np.unique(row):
        own = row == n
        places = len(np.unique(point[own]))
        count += len(np.unique(point[own & (np.abs(above) <= LEVEL)])) >= MOST * places
    return count


def _doubt(track: HeightTrack, places: NDArray[np.intp], level: Floats, on: Bools, known: Bools) -> str:
    """Why nothing is believed of an object's heights.

    level (P,) m: of the nearest lane at its places; on, known (P,): whether the height is the lane's, and is measured.
    """
    held = np.isfinite(level)
    if not (held & known).any():
        return "it is on no lane of the map that would bear its height out"
    if (share := float(on[held & known].mean())) < MOST:
        off = 100.0 * (1.0 - share)
        return (
            f"at {off:.0f} % of its places it is over {LEVEL:g} m off the height of every lane there, "
            "or about as near to another one, above or below"
        )
    rise, way = np.abs(np.diff(level[held])), np.diff(_way(track)[places[held]])
    leap = np.flatnonzero(rise > STEP + STEEP * way)
    if len(leap):
        return (
            f"it would have leapt to a road {rise[leap[0]]:.1f} m above or below within {way[leap[0]]:.0f} m"
        )
    return ""


def _way(track: HeightTrack) -> Floats:
    """Give the way (K,) [m] along the track at its samples, as of places EVERY apart: noise is no way."""
    own = _every(track.t, np.flatnonzero(np.isfinite(track.x + track.y)))
    steps = np.hypot(np.diff(track.x[own]), np.diff(track.y[own]))
    way: Floats = np.interp(track.t, track.t[own], np.concatenate([[0.0], np.cumsum(steps)]))
    return way
