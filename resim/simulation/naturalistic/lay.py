"""A vehicle of SUMO on the exact lanes of the map: its speed is SUMO's, its lateral motion is laid anew.

SUMO's vehicles jump to another lane, or cross to it at constant lateral speed. Here a change begins when SUMO says, and
lasts as long as a draw says (`resim.scenario.generation.lane_curve`); SUMO keeps both lanes for it meanwhile.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from lxml import etree

from resim.core.errors import ResimError
from resim.core.geometry import Floats
from resim.road.opendrive import RoadNetwork
from resim.scenario.generation.lane_curve import Shift, lane_curve
from resim.scenario.generation.lanes import LanePlace, route_over
from resim.scenario.generation.told import DrivenRoute
from resim.simulation.naturalistic.sumo_run import STEP, SumoTrack

LEAST, SHORTEST = 20.0, 14.0
"""Way [m] of a lane change at least, however slow the vehicle is; and where its lanes end: no vehicle turns sharper."""
SHRUNK = 0.4
"""Part of its length to which a change may shrink where its lanes end."""
SEAM = 0.1
"""Length [m] of the lane between two edges of one road in a net: SUMO takes none that is shorter."""
MOST_LANES = 64
MapLanes = Mapping[str, tuple[tuple[str, int], ...]]
"""Of each lane of the net, the lanes (road, lane) of the map that it passes."""


class SampledSpeed:
    """Speeds v (K,) [m/s] at times t (K,) [s], linear between, as SUMO's ballistic steps are; the last one stays."""

    def __init__(self, t: Floats, v: Floats) -> None:
        self._t, self._v = np.append(t, t[-1] + 1e4), np.append(v, v[-1])
        self._a = np.diff(self._v) / np.diff(self._t)
        self._way = np.concatenate([[0.0], np.cumsum(0.5 * (self._v[1:] + self._v[:-1]) * np.diff(self._t))])

    def states(self, t: Floats) -> Floats:
        """Give way, speed and acceleration (3, K) at times t (K,) [s]."""
        row = np.clip(np.searchsorted(self._t, t, side="right") - 1, 0, len(self._a) - 1)
        dt, a, v = t - self._t[row], self._a[row], self._v[row]
        return np.stack([self._way[row] + v * dt + 0.5 * a * dt * dt, np.maximum(v + a * dt, 0.0), a])

    def time_at(self, way: float) -> float:
        """Give the first time [s] at which it has gone so far [m]; inf where it never does."""
        row = int(np.clip(np.searchsorted(self._way, way, side="left") - 1, 0, len(self._a) - 1))
        far, v, a = way - float(self._way[row]), float(self._v[row]), float(self._a[row])
        root = np.sqrt(max(v * v + 2.0 * a * far, 0.0))
        if far <= 0.0:
            return float(self._t[row])
        return float(self._t[row]) + 2.0 * far / (v + root) if v + root > 0.0 else np.inf


@dataclass(frozen=True, eq=False)
class LaidVehicle:
    """A vehicle on the map's lanes, there from `begin` to `end` [s].

    off: how far [m] its place along the lane is from SUMO's, at the end.
    """

    track: SumoTrack
    route: DrivenRoute
    begin: float
    end: float
    off: float

    def states(self, t: Floats) -> Floats:
        """Give x, y, heading, v, a and yaw rate (6, K) at times t (K,) [s] at which it is there."""
        way, v, a = self.route.speed.states(t)
        x, y, heading, curvature = self.route.curve.at(np.minimum(way, self.route.curve.length))
        return np.stack([x, y, heading, v, a, curvature * v])


def read_map_lanes(net: Path) -> MapLanes:
    """Give which lanes of the map each lane of a net passes; () for the seams between edges."""
    out = {}
    for element in etree.parse(str(net)).getroot().iterfind("edge/lane"):
        told = element.find("param[@key='origId']")
        names = (told.get("value", "") if told is not None else "").split()
        out[element.get("id", "")] = tuple(
            (road, int(lane)) for road, _, lane in (n.rsplit("_", 2) for n in names)
        )
    return out


def lay(network: RoadNetwork, lanes: MapLanes, track: SumoTrack, durations: Sequence[float]) -> LaidVehicle:
    """Lay a vehicle on the map. durations: of its changes [s]. Raises ResimError where the map does not allow it."""
    speed = SampledSpeed(track.t, _without_seams(lanes, track) * track.v)
    start = _start(network, lanes, track)
    passed = [lane for name in track.lanes for lane in lanes[name]]
    via = list(dict.fromkeys(road for road, _ in passed if network.roads[road].junction is not None))
    shifts: list[Shift] = []
    for number, ((t, count), lasts) in enumerate(zip(track.changes, durations, strict=True)):
        begun, done = speed.states(np.array([t - STEP, t - STEP + lasts]))[0]
        begun = max(begun, shifts[-1].way + shifts[-1].length if shifts else 0.0)
        length = max(done - begun, LEAST)
        shifts.append(
            Shift(
                float(begun), float(length), count, 0.0, number, least=float(max(SHRUNK * length, SHORTEST))
            )
        )
    whole = float(speed.states(track.t[-1:])[0, 0])
    far = max([whole, *(shift.way + shift.length for shift in shifts)])
    curve, pieces, changed = lane_curve(network, start, 0.0, shifts, route_over(network, via), far + 1.0)
    route = DrivenRoute(curve, pieces, changed, speed)
    end = min(float(track.t[-1]), speed.time_at(curve.length))
    vehicle = LaidVehicle(track, route, float(track.t[0]), end, 0.0)
    off = _off(vehicle)
    return LaidVehicle(track, route, float(track.t[0]), end, off)


def _without_seams(lanes: MapLanes, track: SumoTrack) -> float:
    """The map's way over SUMO's, which has a seam between two edges of one road."""
    edges = [name.rpartition("_")[0] for name in track.lanes if lanes[name]]
    passed = track.vehicle.edges[
        : track.vehicle.edges.index(next(e for e in reversed(edges) if e[0] != ":")) + 1
    ]
    roads = [lanes[next(name for name in _of_edge(lanes, edge))][0][0] for edge in passed]
    seams = sum(one == two for one, two in pairwise(roads))
    whole = float(np.sum(0.5 * (track.v[1:] + track.v[:-1]) * np.diff(track.t)))
    return 1.0 - SEAM * seams / whole if whole > SEAM * seams else 1.0


def _of_edge(lanes: MapLanes, edge: str) -> Iterator[str]:
    return (f"{edge}_{k}" for k in range(MOST_LANES) if lanes.get(f"{edge}_{k}"))


def _start(network: RoadNetwork, lanes: MapLanes, track: SumoTrack) -> LanePlace:
    """Where the centre of the vehicle is when it appears."""
    here = lanes[track.lanes[0]]
    if not here:
        raise ResimError(
            f"vehicle {track.vehicle.id} appears on {track.lanes[0]}, which is no lane of the map"
        )
    at = network.to_road(track.x[:1], track.y[:1])
    road, lane, s = here[0][0], here[0][1], float(at.s[0])
    if str(at.road[0]) != road:
        raise ResimError(f"vehicle {track.vehicle.id} appears on road {at.road[0]}, not on road {road}")
    found = network.roads[road]
    up = found.along(lane, found.section_index(s))
    half = 0.5 * track.vehicle.length
    return LanePlace(road, lane, min(max(s - half if up else s + half, 0.0), found.length), up)


def _off(vehicle: LaidVehicle) -> float:
    """How far along [m] the front is from SUMO's at the last moment at which both are there."""
    track = vehicle.track
    k = min(int(np.searchsorted(track.t, vehicle.end + 1e-6)), len(track.t)) - 1
    x, y, heading = vehicle.states(track.t[k : k + 1])[:3, 0]
    half = 0.5 * track.vehicle.length
    along = (track.x[k] - x) * np.cos(heading) + (track.y[k] - y) * np.sin(heading) - half
    return float(along)
