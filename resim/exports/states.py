"""What all formats write of a source: states at times in whole nanoseconds, with heights and accelerations."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from resim.core.geometry import Floats
from resim.core.tracks import Tracks
from resim.report.player import PlayedDrive
from resim.report.player.drive import Layer
from resim.road.opendrive import RoadNetwork
from resim.scenario.openscenario import HEIGHT, HEIGHTS

SECOND = 10**9
"""ns."""


class TimedMessage(NamedTuple):
    """A message of a source: its time [ns], and what it says as bytes."""

    t: int
    body: bytes


@dataclass(frozen=True)
class ExportedState:
    """One object at one time: id, kind, and in the map's frame.

    Attributes:
        id: As in the recording.
        kind: One of `resim.core.tracks.KINDS`.
        length: m.
        width: m.
        height: m, as is usual for its kind.
        x: m, middle of the box.
        y: m, middle of the box.
        z: m, road under the middle of the box.
        heading: rad, anticlockwise from +x, from -pi to pi.
        v: m/s along the heading.
        a: m/s² along the heading.
        yaw_rate: rad/s.
    """

    id: str
    kind: str
    length: float
    width: float
    height: float
    x: float
    y: float
    z: float
    heading: float
    v: float
    a: float
    yaw_rate: float


def first_second(drive: PlayedDrive) -> int:
    """Give what is to be taken off all times [s]: 0, or the first second where that is negative, which many forbid."""
    begins = [float(layer.tracks.t[0]) for layer in drive.layers if len(layer.tracks.t)]
    return min(0, *map(math.floor, begins), 0)


def first_time(drive: PlayedDrive, first: int) -> int:
    """Give the first time [ns] of any source, from a whole second `first` on; 0 where nothing is ever there."""
    begins = [float(layer.tracks.t[0]) for layer in drive.layers if len(layer.tracks.t)]
    return nanoseconds(min(begins), first) if begins else 0


def nanoseconds(t: float, first: int = 0) -> int:
    """Give a time [s] from a whole second `first` on in ns: exact to half of one, however large it is."""
    whole = math.floor(t)
    return (whole - first) * SECOND + round((t - whole) * SECOND)


_MOST = 1 << 63


def numbers(drive: PlayedDrive) -> dict[str, int]:
    """Give the number of each id of a drive: that which it is; the others are counted on from the largest of these."""
    names = dict.fromkeys(
        [drive.ego, *(name for layer in drive.layers for name in layer.tracks.ids.tolist())]
    )
    own = {
        name: int(name) for name in names if name.isdecimal() and name.isascii() and str(int(name)) == name
    }
    others = [name for name in names if name not in own]
    first = max(own.values(), default=0) + 1
    if first + len(others) > _MOST:
        own, others, first = {}, [*names], 1
    return own | {name: number for number, name in enumerate(others, start=first)}


def topic_of(source: str) -> str:
    """Give a source's name as it stands in names of topics."""
    return source.replace(" ", "_")


def derived(layer: Layer) -> tuple[str, ...]:
    """Give what a source does not say of everybody at all times, and files have all the same (`states`)."""
    values = {name: getattr(layer.tracks, name) for name in ("z", "a", "yaw_rate")}
    there = layer.tracks.valid
    return tuple(name for name, value in values.items() if value is None or np.isnan(value[there]).any())


def states(
    layer: Layer, network: RoadNetwork, only: str | None = None
) -> Iterator[tuple[float, list[ExportedState]]]:
    """Give by time [s] where everybody is whose state is known then; only: give this object alone.

    What a source does not say is derived: accelerations and yaw rates are slopes, heights those of the map, or where it
    has none of the object's own samples, or else of the others'.
    """
    tracks, columns = layer.tracks, _columns(layer, network)
    wanted = np.ones(len(tracks), dtype=bool) if only is None else tracks.ids == only
    kinds, heights = tracks.kind.tolist(), [HEIGHTS.get(kind, HEIGHT) for kind in tracks.kind.tolist()]
    fixed = [
        *zip(tracks.ids.tolist(), kinds, tracks.length.tolist(), tracks.width.tolist(), heights, strict=True)
    ]
    for k, t in enumerate(tracks.t.tolist()):
        rows = np.flatnonzero(tracks.valid[:, k] & wanted).tolist()
        yield t, [ExportedState(*fixed[n], *columns[:, n, k].tolist()) for n in rows]


_KNOWN: WeakKeyDictionary[Layer, tuple[RoadNetwork, Floats]] = WeakKeyDictionary()
"""What topics of one source share."""


def _columns(layer: Layer, network: RoadNetwork) -> Floats:
    """What `ExportedState` has from x on (7, N, T); worked out once as long as the source is there."""
    road, columns = _KNOWN.get(layer, (None, None))
    if columns is None or road is not network:
        tracks = _whole(layer.tracks, network)
        a, yaw_rate, z = tracks.a, tracks.yaw_rate, tracks.z
        assert a is not None
        assert yaw_rate is not None
        assert z is not None
        heading = np.angle(np.exp(1j * tracks.heading))
        columns = np.stack([tracks.x, tracks.y, z, heading, tracks.v, a, yaw_rate])
        _KNOWN[layer] = network, columns
    return columns


def _whole(tracks: Tracks, network: RoadNetwork) -> Tracks:
    """The tracks with all optional columns, and a value of each in every sample that is there."""
    a = _filled(tracks.a, _slopes(tracks, tracks.v))
    yaw_rate = _filled(tracks.yaw_rate, _slopes(tracks, tracks.heading, turns=True))
    return replace(tracks, a=a, yaw_rate=yaw_rate, z=_heights(tracks, network))


def _filled(values: Floats | None, others: Floats) -> Floats:
    """The values (N, T), and others where they are NaN."""
    return others if values is None else np.where(np.isnan(values), others, values)


def _heights(tracks: Tracks, network: RoadNetwork) -> Floats:
    """Heights (N, T) [m] of the road under everybody."""
    there = tracks.valid
    z = np.full(tracks.x.shape, np.nan) if tracks.z is None else np.where(there, tracks.z, np.nan)
    lost = there & np.isnan(z)
    if lost.any() and network.has_heights:
        found = network.to_road(tracks.x[lost], tracks.y[lost])
        z[lost] = network.z(found.road, found.s, found.t, lane=found.lane)
    for row in z:
        known = np.flatnonzero(~np.isnan(row))
        if len(known):
            row[:] = np.interp(tracks.t, tracks.t[known], row[known])
    known = z[there & ~np.isnan(z)]
    return _filled(z, np.full(z.shape, float(np.median(known)) if len(known) else 0.0))


def _slopes(tracks: Tracks, values: Floats, *, turns: bool = False) -> Floats:
    """Central differences (N, T) of each object's own samples; 0 where it has one alone."""
    out = np.zeros(values.shape)
    for n in range(len(tracks)):
        own = np.flatnonzero(tracks.valid[n])
        if len(own) > 1:
            row = np.unwrap(values[n, own]) if turns else values[n, own]
            out[n, own] = np.gradient(row, tracks.t[own])
    return out
