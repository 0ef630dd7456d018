"""Measured heights against those of the map: which are believed, in the heights of the map.

A wrong height would part who meets, so heights count only where the map bears them out: at nearly all places of an
object one of the lanes there has its height, to within `LEVEL`. Heights that are all off by one amount (such as those
over the ellipsoid) are taken to the map's by it. Nothing is believed of an object whose height jumps, nor on a map
without heights.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Bools, Floats
from resim.core.tracks import Tracks
from resim.road.opendrive import RoadNetwork
from resim.road.opendrive.index import LEVEL

EVERY = 0.5
"""Time [s] between the places of an object that are looked up, and within which no height jumps."""
JUMP = 2.0
"""Change of height [m] within that time that is no driving."""
STEEP = 0.15
"""Grade of the steepest roads."""
MEDIAN = 5
"""Samples of which a jump is that of the median: noise is none."""
MOST = 0.9
"""Share of an object's places at which it has to be on a lane's height."""
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
    x, y, z = (
        np.concatenate([getattr(k, c)[s] for k, s in zip(tracks, looked, strict=True)])
        for c in ("x", "y", "z")
    )
    point, surface = network.surfaces(x, y)
    above = z[point] - surface
    offset = _offset(above, row[point], point)
    if offset is None:
        return MeasuredHeights(unknown, why="they are not on the roads of the map, nor all off by one amount")
    held, on = np.zeros(len(row), dtype=bool), np.zeros(len(row), dtype=bool)
    held[point] = True
    on[point[np.abs(above - offset) <= LEVEL]] = True
    out, doubted = [], {}
    for n, k in enumerate(tracks):
        own, known = row == n, np.isfinite(k.z)
        why = _doubt(k, known, held[own], on[own]) if known.any() else ""
        if why:
            doubted[n] = why
        off = _near(k.t, k.t[looked[n][held[own] & ~on[own]]])
        out.append(np.where(off | bool(why), np.nan, k.z - offset))
    return MeasuredHeights(tuple(out), offset, "", doubted)


def _places(track: HeightTrack) -> NDArray[np.intp]:
    """Samples with a height, EVERY apart."""
    own = np.flatnonzero(np.isfinite(track.z + track.x + track.y))
    return own[np.unique(np.floor(track.t[own] / EVERY), return_index=True)[1]]


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


def _doubt(track: HeightTrack, known: Bools, held: Bools, on: Bools) -> str:
    """Why nothing is believed of an object's heights; held, on: at which of its places there is a lane, and one at its
    height."""
    if not held.any():
        return "it is on no lane of the map that would bear its height out"
    if (share := float(on[held].mean())) < MOST:
        off = 100.0 * (1.0 - share)
        return f"at {off:.0f} % of its places it is over {LEVEL:g} m off the height of every lane there"
    if (far := _jump(track, known)) > JUMP:
        return f"its height jumps by {far:.1f} m within {EVERY:g} s"
    return ""


def _jump(track: HeightTrack, known: Bools) -> float:
    """The largest change [m] of a height over EVERY, less what the steepest road rises on the way."""
    t, x, y, z = (column[known] for column in track[1:])
    if len(z) < 2:
        return 0.0
    reach = np.arange(-(MEDIAN // 2), MEDIAN // 2 + 1)
    around = np.clip(np.arange(len(z))[:, None] + reach, 0, len(z) - 1)
    middle = np.median(z[around], axis=1)
    after = np.searchsorted(t, t + EVERY + 1e-9, side="right") - 1
    way = np.hypot(x[after] - x, y[after] - y)
    return float((np.abs(middle[after] - middle) - STEEP * way).max())


def _near(t: Floats, times: Floats) -> Bools:
    """Which times (T,) [s] are within EVERY of one of others."""
    out = np.zeros(len(t), dtype=bool)
    for time in times.tolist():
        out |= np.abs(t - time) <= EVERY
    return out
