"""Tracks and plans packed small: quantised, differences of differences, in bytes of 7 bits, in base64.

An integer is zigzag-coded (0, -1, 1, -2 ... are 0, 1, 2, 3 ...) and written with 7 bits a byte, the lowest first; all
bytes but the last have their highest bit set. Of a row its first or second differences are written, the shorter ones.
"""

from __future__ import annotations

from base64 import b64encode
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats, unwrap_angle
from resim.core.tracks import Tracks
from resim.metrics.drive import Plans

Integers = NDArray[np.int64]
Bytes = NDArray[np.uint8]

UNITS = {"t": 1e-4, "x": 1e-2, "y": 1e-2, "heading": 1e-3, "v": 1e-2}
"""s, m, m, rad, m/s that one step of the packed numbers is."""
CHANNELS = ("x", "y", "heading", "v")
"""What is packed of an object, in this order."""
FARTHEST = 1e9
"""Largest packed place [m] and speed [m/s]: beyond it the script's numbers are not exact."""

Stride = tuple[int, int, int]
"""First of the layer's times, how many on to the next, how many."""


@dataclass(frozen=True)
class PackedObject:
    """An object: at which of the times it is there, and with which differences each of CHANNELS is packed.

    length, width: m, None where not known.
    """

    id: str
    kind: str
    length: float | None
    width: float | None
    times: list[Stride]
    orders: list[int]


@dataclass(frozen=True)
class PackedTracks:
    """Times and objects; data: the times' second differences, then each object's channels."""

    count: int
    objects: list[PackedObject]
    data: str


@dataclass(frozen=True)
class PackedPlans:
    """Plans; data: when each was made, how many points it has, and all x, then all y, each by first differences."""

    count: int
    points: int
    data: str


def varints(values: Integers) -> Bytes:
    """Give the bytes of integers (K,)."""
    zigzag = ((values << 1) ^ (values >> 63)).astype(np.uint64)
    size = np.ones(len(values), dtype=np.int64)
    for k in range(1, 10):
        size += zigzag >> np.uint64(7 * k) > 0
    ends = np.cumsum(size)
    out = np.zeros(int(ends[-1]) if len(ends) else 0, dtype=np.uint8)
    for k in range(int(size.max()) if len(size) else 0):
        has = size > k
        low = (zigzag[has] >> np.uint64(7 * k)) & np.uint64(0x7F)
        out[(ends - size)[has] + k] = low | (np.uint64(0x80) * (size[has] > k + 1)).astype(np.uint64)
    return out


def differences(values: Integers, order: int) -> Integers:
    """Give the first or second differences (K,) of integers (K,) that begin after zeros."""
    for _ in range(order):
        values = np.diff(values, prepend=np.int64(0))
    return values


def packed_tracks(tracks: Tracks, origin: Floats) -> PackedTracks:
    """Pack the tracks; origin: x, y [m] that places count from."""
    parts, objects = [varints(differences(_steps(tracks.t, "t"), 2))], []
    for n, name in enumerate(tracks.ids.tolist()):
        there = np.flatnonzero(tracks.valid[n])
        if not len(there):
            continue
        orders = []
        for channel, zero in zip(CHANNELS, (*origin.tolist(), 0.0, 0.0), strict=True):
            values = getattr(tracks, channel)[n, there]
            values = unwrap_angle(values) if channel == "heading" else values - zero
            steps = _steps(values, channel)
            both = [varints(differences(steps, order)) for order in (1, 2)]
            orders.append(1 if len(both[0]) <= len(both[1]) else 2)
            parts.append(both[orders[-1] - 1])
        size = (_size(tracks.length[n]), _size(tracks.width[n]))
        objects.append(PackedObject(name, str(tracks.kind[n]), *size, strides(there), orders))
    return PackedTracks(len(tracks.t), objects, _text(parts))


def strides(places: NDArray[np.intp]) -> list[Stride]:
    """Give increasing places (K,) as runs of equal distances."""
    out: list[Stride] = []
    k, steps = 0, np.diff(places)
    while k < len(places):
        if k == len(steps):
            return [*out, (int(places[k]), 1, 1)]
        differs = np.flatnonzero(steps[k:] != steps[k])
        count = (int(differs[0]) if len(differs) else len(steps) - k) + 1
        out.append((int(places[k]), int(steps[k]), count))
        k += count
    return out


def packed_plans(plans: Plans, origin: Floats) -> PackedPlans | None:
    """Pack the plans' points, None where there is none; origin: x, y [m] that places count from."""
    known = [(when, plan[np.isfinite(plan[:, 1:3]).all(axis=1)]) for when, plan in plans]
    known = [(when, plan) for when, plan in known if len(plan)]
    if not known:
        return None
    rows = np.concatenate([plan for _, plan in known])
    made = _steps(np.array([when for when, _ in known]), "t")
    counts = np.array([len(plan) for _, plan in known], dtype=np.int64)
    parts = [made, counts, _steps(rows[:, 1] - origin[0], "x"), _steps(rows[:, 2] - origin[1], "y")]
    return PackedPlans(len(known), len(rows), _text([varints(differences(part, 1)) for part in parts]))


def _steps(values: Floats, channel: str) -> Integers:
    """Values in whole steps of their unit."""
    return np.round(np.clip(values, -FARTHEST, FARTHEST) / UNITS[channel]).astype(np.int64)


def _size(value: float) -> float | None:
    return round(float(value), 3) if np.isfinite(value) and value > 0.0 else None


def _text(parts: list[Bytes]) -> str:
    return b64encode(np.concatenate(parts).tobytes()).decode("ascii")
