"""Traffic on a map, cut into recordings: tracks at any rate, the truth of what vehicles do, and nobody in anybody."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from resim.core.errors import ResimError
from resim.core.geometry import Floats, wrap_angle
from resim.core.overlaps import first_overlaps
from resim.core.tracks import Tracks
from resim.road.opendrive import RoadNetwork
from resim.road.sumo import sumo_net
from resim.scenario.generation.generate import sample_times
from resim.scenario.generation.told import lane_changes, speeding, standing, turns
from resim.scenario.generation.truth import TrueManeuver
from resim.simulation.naturalistic.demand import read_edges, spawn
from resim.simulation.naturalistic.lay import LaidVehicle, MapLanes, lay, read_map_lanes
from resim.simulation.naturalistic.settings import NaturalisticSettings
from resim.simulation.naturalistic.sumo_run import SumoTrack, run_sumo

AFTER = 1.0
"""Time [s] for which SUMO goes on behind the last recording."""
FEWEST = 5
"""Samples of a vehicle in a recording at least; fewer say nothing of it."""
LEAP = 0.1
"""m that a vehicle may be off in a sample from where its speed takes it; more is where a line of the map is torn."""


@dataclass(frozen=True, eq=False)
class TrafficWindow:
    """One recording of the traffic.

    Attributes:
        begin: When it begins, since the end of the warm-up [s].
        tracks: Its vehicles, t from 0.
        maneuvers: What they do; one that is under way at an end begins before 0 or ends after the recording.
        left_out: Ids of vehicles that are left out, with the reason.
    """

    begin: float
    tracks: Tracks
    maneuvers: tuple[TrueManeuver, ...]
    left_out: tuple[tuple[str, str], ...]


@dataclass
class _Traffic:
    """What is laid so far. gone: ids left out, with the reason."""

    network: RoadNetwork
    lanes: MapLanes
    settings: NaturalisticSettings
    seed: int
    laid: dict[str, LaidVehicle] = field(default_factory=dict)
    gone: dict[str, str] = field(default_factory=dict)

    def vehicle(self, track: SumoTrack) -> LaidVehicle | None:
        """Give the vehicle on the map's lanes; None where it is left out."""
        name = track.vehicle.id
        if name in self.gone:
            return None
        if name not in self.laid:
            rng = np.random.default_rng([self.seed, 2, int(name)])
            durations = self.settings.lane_change.duration.draw(rng, len(track.changes))
            try:
                self.laid[name] = lay(self.network, self.lanes, track, durations.tolist())
            except ResimError as e:
                self.gone[name] = str(e)
                return None
        return self.laid[name]


def traffic_windows(
    network: RoadNetwork, settings: NaturalisticSettings, *, duration: float, rate: float, seed: int
) -> Iterator[TrafficWindow]:
    """Let SUMO drive on the map for so many seconds after the warm-up, and give its recordings one after the other.

    rate: samples a second [Hz]. The same settings and seed give the same recordings. Raises ResimError.
    """
    net = sumo_net(network).path
    start = settings.demand.warm_up
    vehicles = spawn(read_edges(net), network, settings, start + duration, seed)
    longest = settings.lane_change.duration
    lasts = longest.max if longest.max is not None else (longest.mean or 0.0) + 3.0 * longest.sd
    tracks = run_sumo(net, vehicles, end=start + duration + AFTER, change_lasts=lasts, seed=seed)
    traffic = _Traffic(network, read_map_lanes(net), settings, seed)
    count = max(math.ceil(duration / settings.recording - 1e-6), 1)
    for k in range(count):
        begin = start + k * settings.recording
        length = min(settings.recording, start + duration - begin)
        own = [one for one in tracks if one.t[0] < begin + length and one.t[-1] > begin]
        yield _window(traffic, own, begin, length, rate, begin - start)
        for one in own:  # a vehicle that is gone is not needed any more
            if one.t[-1] < begin + length:
                traffic.laid.pop(one.vehicle.id, None)


def _window(
    traffic: _Traffic, own: Sequence[SumoTrack], begin: float, length: float, rate: float, told: float
) -> TrafficWindow:
    times = sample_times(length, rate)
    laid = [vehicle for track in own if (vehicle := traffic.vehicle(track)) is not None]
    tracks = _tracks(laid, times, begin)
    for n, t, far in _leaps(tracks):
        traffic.gone[str(tracks.ids[n])] = f"the map makes it leap by {far:.2f} m at {begin + t:.2f} s"
    tracks = tracks.select([name for name in tracks.ids.tolist() if name not in traffic.gone])
    for n, m, t in first_overlaps(tracks):
        blamed = _blamed(traffic, str(tracks.ids[n]), str(tracks.ids[m]))
        traffic.gone.setdefault(blamed, f"overlaps at {begin + t:.2f} s")
    kept = [vehicle for vehicle in laid if vehicle.track.vehicle.id not in traffic.gone]
    tracks = tracks.select(
        [vehicle.track.vehicle.id for vehicle in kept if vehicle.track.vehicle.id in tracks.ids]
    )
    maneuvers = [row for vehicle in kept for row in _maneuvers(traffic.network, vehicle, tracks, begin)]
    here = {track.vehicle.id for track in own}
    gone = tuple((name, why) for name, why in traffic.gone.items() if name in here)
    return TrafficWindow(told, tracks, tuple(maneuvers), gone)


def _leaps(tracks: Tracks) -> Iterator[tuple[int, float, float]]:
    """Give who leaps, as where a road's line has a gap or a kink: its row, when [s], and how far [m] at most."""
    driven = tracks.v * np.exp(1j * tracks.heading)
    place = tracks.x + 1j * tracks.y
    off = np.diff(place, axis=1) - 0.5 * (driven[:, 1:] + driven[:, :-1]) * np.diff(tracks.t)
    far = np.nan_to_num(np.abs(off))
    for n in np.flatnonzero((far > LEAP).any(axis=1)).tolist():
        k = int(np.argmax(far[n]))
        yield n, float(tracks.t[k + 1]), float(far[n, k])


def _blamed(traffic: _Traffic, one: str, other: str) -> str:
    """Who is left out of two that overlap: who changes lane, else who comes later."""
    changes = [bool(traffic.laid[name].track.changes) for name in (one, other)]
    if changes[0] != changes[1]:
        return one if changes[0] else other
    return max((one, other), key=int)


def _tracks(laid: Sequence[LaidVehicle], times: Floats, begin: float) -> Tracks:
    kept, out = [], []
    for vehicle in laid:
        there = (times + begin >= vehicle.begin) & (times + begin <= vehicle.end)
        if there.sum() < FEWEST:
            continue
        states = np.full((6, len(times)), np.nan)
        states[:, there] = vehicle.states(times[there] + begin)
        kept.append(vehicle.track.vehicle)
        out.append(states)
    x, y, heading, v, a, yaw_rate = np.stack(out, axis=1) if out else np.empty((6, 0, len(times)))
    return Tracks(
        t=times, ids=np.array([one.id for one in kept], dtype=str),
        kind=np.array([one.kind for one in kept], dtype=str), x=x, y=y, heading=wrap_angle(heading), v=v,
        length=np.array([one.length for one in kept]), width=np.array([one.width for one in kept]),
        valid=np.isfinite(x), yaw_rate=yaw_rate, a=a,
    )  # fmt: skip


def _maneuvers(
    network: RoadNetwork, vehicle: LaidVehicle, tracks: Tracks, begin: float
) -> Iterator[TrueManeuver]:
    """What a vehicle does in a recording, by the recording's clock: maneuvers whose moment lies in it."""
    name = vehicle.track.vehicle.id
    if name not in tracks.ids:
        return
    row = tracks.index(name)
    t = tracks.t[tracks.valid[row]]
    for told in (*lane_changes(name, vehicle.route), *turns(name, network, vehicle.route)):
        moved = told._replace(start=told.start - begin, end=told.end - begin, t=told.t - begin)
        if t[0] - 1e-9 <= moved.t <= t[-1] + 1e-9:
            yield moved
    here = tracks.valid[row]
    states = np.stack([c[row, here] for c in (tracks.x, tracks.y, tracks.heading, tracks.v)])
    yield from standing(name, t, states[3])
    yield from speeding(name, network, t, states)
