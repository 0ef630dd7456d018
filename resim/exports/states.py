"""What all formats write of a source: states at times in whole nanoseconds, with heights and accelerations."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

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
    return min(0, *(math.floor(float(layer.tracks.t[0])) for layer in drive.layers if len(layer.tracks.t)))


def nanoseconds(t: float, first: int = 0) -> int:
    """Give a time [s] from a whole second `first` on in ns: exact to half of one, however large it is."""
    whole = math.floor(t)
    return (whole - first) * SECOND + round((t - whole) * SECOND)


_MOST = 1 << 63


def numbers(drive: PlayedDrive) -> dict[str, int]:
    """Give the number of each id of a drive: that which it is, if all are numbers, else counted, the EGO's first."""
    names = dict.fromkeys(
        [drive.ego, *(name for layer in drive.layers for name in layer.tracks.ids.tolist())]
    )
    if all(
        name.isdecimal() and name.isascii() and str(int(name)) == name and int(name) < _MOST for name in names
    ):
        return {name: int(name) for name in names}
    return {name: number for number, name in enumerate(names, start=1)}


def topic_of(source: str) -> str:
    """Give a source's name as it stands in names of topics."""
    return source.replace(" ", "_")


def derived(layer: Layer) -> tuple[str, ...]:
    """Give what a source does not say, and files have all the same: z of the map, a and yaw_rate by differences."""
    return tuple(name for name in ("z", "a", "yaw_rate") if getattr(layer.tracks, name) is None)


def states(layer: Layer, network: RoadNetwork) -> Iterator[tuple[float, list[ExportedState]]]:
    """Give by time [s] where everybody is whose state is known then."""
    tracks = _whole(layer.tracks, network)
    a, yaw_rate, z = tracks.a, tracks.yaw_rate, tracks.z
    assert a is not None
    assert yaw_rate is not None
    assert z is not None
    heading = np.angle(np.exp(1j * tracks.heading))
    columns = np.stack([tracks.x, tracks.y, z, heading, tracks.v, a, yaw_rate])
    columns = np.where(np.isnan(columns), 0.0, columns)
    kinds, heights = tracks.kind.tolist(), [HEIGHTS.get(kind, HEIGHT) for kind in tracks.kind.tolist()]
    fixed = [
        *zip(tracks.ids.tolist(), kinds, tracks.length.tolist(), tracks.width.tolist(), heights, strict=True)
    ]
    for k, t in enumerate(tracks.t.tolist()):
        rows = np.flatnonzero(tracks.valid[:, k]).tolist()
        yield t, [ExportedState(*fixed[n], *columns[:, n, k].tolist()) for n in rows]


def _whole(tracks: Tracks, network: RoadNetwork) -> Tracks:
    """The tracks with all optional columns."""
    a = _slopes(tracks, tracks.v) if tracks.a is None else tracks.a
    yaw_rate = tracks.yaw_rate
    if yaw_rate is None:
        yaw_rate = _slopes(tracks, tracks.heading, turns=True)
    z = tracks.z
    if z is None:
        z = np.zeros(tracks.x.shape)
        if network.has_heights:
            found = network.to_road(tracks.x[tracks.valid], tracks.y[tracks.valid])
            z[tracks.valid] = network.z(found.road, found.s, found.t, lane=found.lane)
    return replace(tracks, a=a, yaw_rate=yaw_rate, z=z)


def _slopes(tracks: Tracks, values: Floats, *, turns: bool = False) -> Floats:
    """Central differences (N, T) of each object's own samples; 0 where it has one alone."""
    out = np.zeros(values.shape)
    for n in range(len(tracks)):
        own = np.flatnonzero(tracks.valid[n])
        if len(own) > 1:
            row = np.unwrap(values[n, own]) if turns else values[n, own]
            out[n, own] = np.gradient(row, tracks.t[own])
    return out
