"""What the player's script reads: each drive's layers, curves and marks as plain data, and the maps they share."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from resim.core.clock import TICK
from resim.core.files import file_hash
from resim.core.geometry import Floats
from resim.report.map.data import MapData, Picture, map_data
from resim.report.markup import Markup, script_data
from resim.report.player.colors import LayerColors, layer_colors
from resim.report.player.drive import AccelerationCurve, Danger, Layer, PlayedDrive, TimelineMark
from resim.report.player.packing import (
    UNITS,
    PackedPlans,
    PackedTracks,
    packed_plans,
    packed_tracks,
)
from resim.road.opendrive import RoadNetwork

NEAR = 250.0
"""Distance [m] from the EGO's way up to which roads are drawn."""
PLAN_STEP = 0.1
"""Least time [s] between plans that are drawn."""

Numbers = list[float | None]


@dataclass(frozen=True)
class DangerData:
    """Curves over t [s]: risk, 0 to 1, and TTC [s], None where there is none; of: whose, as index into `ids`, or -1.

    unknown: 1 where not all could be computed, else 0.
    """

    t: Numbers
    risk: Numbers
    risk_of: list[int]
    ttc: Numbers
    ttc_of: list[int]
    unknown: list[int]
    ids: list[str]


@dataclass(frozen=True)
class AccelerationData:
    """The EGO's acceleration [m/s²] over t [s]; of_splines: else it is a slope of speeds."""

    t: Numbers
    a: Numbers
    of_splines: bool


@dataclass(frozen=True)
class LayerData:
    """One source as the script reads it."""

    name: str
    title: str
    shown: bool
    colors: LayerColors
    tracks: PackedTracks
    plans: PackedPlans | None
    danger: DangerData | None
    acceleration: AccelerationData | None


@dataclass(frozen=True)
class DriveData:
    """One drive as the script reads it. map: index of its map; box: west, south, east, north of the EGO's way [m].

    start, end: first and last time [s] of any layer. marks: in order of time.
    """

    name: str
    ego: str
    map: int
    box: list[float]
    start: float
    end: float
    layers: list[LayerData]
    marks: list[TimelineMark]
    notes: list[str]


@dataclass(frozen=True)
class PlayerData:
    """All that the script reads; units: of the packed numbers."""

    units: dict[str, float]
    maps: list[MapData]
    drives: list[DriveData]


def to_script(drives: Sequence[PlayedDrive]) -> Markup:
    """Give the data as JSON that can stand within a script element, whatever names are in it."""
    pictures: list[tuple[str, frozenset[str], Picture]] = []
    made = []
    for drive in drives:
        roads = near_roads(drive)
        file = file_hash(drive.network.path)
        known = [k for k, (digest, ids, _) in enumerate(pictures) if digest == file and ids == roads]
        if not known:
            pictures.append((file, roads, Picture(cut_network(drive.network, roads), None)))
        k = known[0] if known else len(pictures) - 1
        made.append(_drive(drive, k, pictures[k][2].origin))
    data = PlayerData(dict(UNITS), [map_data(picture) for *_, picture in pictures], made)
    return script_data(
        json.dumps(data, default=vars, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    )


def near_roads(drive: PlayedDrive) -> frozenset[str]:
    """Give the ids of the roads near the EGO's way; all where none is."""
    way = shapely.union_all([shapely.linestrings(xy) for xy in _ways(drive) if len(xy) > 1])
    shapes = [s for s in drive.network.lane_shapes(5.0) if len(s.centre) > 1]
    far = shapely.distance(np.array([shapely.linestrings(s.centre) for s in shapes], dtype=object), way)
    found = frozenset(s.road for s, d in zip(shapes, np.atleast_1d(far), strict=True) if d <= NEAR)
    return found or frozenset(drive.network.roads)


def _ways(drive: PlayedDrive) -> list[Floats]:
    """Where the EGO went (K, 2) [m], by layer."""
    out = []
    for layer in drive.layers:
        tracks = layer.tracks
        if drive.ego in tracks.ids:
            row = tracks.index(drive.ego)
            own = tracks.valid[row]
            out.append(np.column_stack([tracks.x[row, own], tracks.y[row, own]]))
    return out


def cut_network(network: RoadNetwork, roads: frozenset[str]) -> RoadNetwork:
    """Give the network with these roads alone, and the junctions that they are in."""
    kept = {name: road for name, road in network.roads.items() if name in roads}
    inside = {road.junction for road in kept.values()}
    junctions = {name: j for name, j in network.junctions.items() if name in inside}
    return replace(network, roads=kept, junctions=junctions)


def _drive(drive: PlayedDrive, number: int, origin: Floats) -> DriveData:
    places = np.concatenate([np.empty((0, 2)), *_ways(drive)]) - origin
    if not len(places):
        places = np.zeros((1, 2))
    times = np.concatenate([layer.tracks.t for layer in drive.layers if len(layer.tracks.t)])
    return DriveData(
        drive.name, drive.ego, number,
        np.round([*places.min(axis=0), *places.max(axis=0)], 2).tolist(),
        round(float(times.min()), 4), round(float(times.max()), 4),
        [_layer(layer, origin) for layer in drive.layers],
        sorted(map(_mark, drive.marks), key=lambda mark: mark.start), list(drive.notes),
    )  # fmt: skip


def _mark(mark: TimelineMark) -> TimelineMark:
    return replace(mark, start=round(mark.start, 4), end=round(mark.end, 4))


def _layer(layer: Layer, origin: Floats) -> LayerData:
    plans, last = [], -np.inf
    for when, plan in layer.plans:
        if when >= last + PLAN_STEP - TICK:
            plans.append((when, plan))
            last = when
    return LayerData(
        layer.name, layer.title, layer.shown, layer_colors(layer.name, layer.of), packed_tracks(layer.tracks, origin),
        packed_plans(plans, origin), None if layer.danger is None else _danger(layer.danger),
        None if layer.acceleration is None else _acceleration(layer.acceleration),
    )  # fmt: skip


def _danger(found: Danger) -> DangerData:
    ids = sorted({*found.risk_of, *found.ttc_of} - {""})
    number = {name: k for k, name in enumerate(ids)} | {"": -1}
    return DangerData(
        _numbers(found.t, 4), _numbers(found.risk, 6), [number[i] for i in found.risk_of],
        _numbers(found.ttc, 3), [number[i] for i in found.ttc_of],
        found.unknown.astype(int).tolist(), ids,
    )  # fmt: skip


def _acceleration(found: AccelerationCurve) -> AccelerationData:
    return AccelerationData(_numbers(found.t, 3), _numbers(found.a, 2), found.of_splines)


def _numbers(values: Floats, digits: int) -> Numbers:
    return [round(v, digits) + 0.0 if np.isfinite(v) else None for v in values.tolist()]
