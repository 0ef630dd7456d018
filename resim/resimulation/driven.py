"""One vehicle of traffic as the EGO: driven by an AD function in closed loop, or with sensors, or both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

from resim.core.errors import ResimError
from resim.core.geometry import Floats
from resim.core.plugins.frozen import FrozenFile
from resim.core.tracks import Tracks
from resim.perception.model import read_model
from resim.perception.runtime.sensor import Sensor
from resim.resimulation.run import map_name
from resim.resimulation.sensed import SensedTracks, WithinSight, perceive_along, planned, sensed_tracks
from resim.road.opendrive import load
from resim.scenario.scenario import describe
from resim.simulation.case import Case, HandedOver, SimulatedDrive
from resim.simulation.direct import Direct
from resim.simulation.function.interface import load_build
from resim.simulation.perception import IdealPerception, Perception
from resim.simulation.reactive.settings import ReactiveSettings
from resim.simulation.vehicles.registry import vehicle_model


@dataclass(frozen=True, eq=False)
class DriveTask:
    """What is to be driven.

    Attributes:
        road: OpenDRIVE file.
        tracks: Everybody while the EGO is there, t from 0.
        ego: The vehicle.
        build: Of the function that drives it.
        perception: What it sees the others by; None for as they are.
        sight: How far [m] it sees.
        vehicle: Name of its vehicle model.
        traffic: How the others react.
        seed: Of all draws.
    """

    road: Path
    tracks: Tracks
    ego: str
    build: FrozenFile
    perception: FrozenFile | None
    sight: float
    vehicle: str
    traffic: ReactiveSettings
    seed: int


@dataclass(frozen=True, eq=False)
class DrivenVehicle:
    """What was driven.

    Attributes:
        tracks: The truth, EGO first.
        sensed: What the EGO perceived.
        build: Label of the function's build.
        build_hash: What pins it.
        plan: Its plans, None for one that makes none.
        handed_over: Who reacted.
        moments: Of who reacted, (2, M) times [s] without and with the function at which it is as far along its way.
        ended: Why it ended early, "" where it did not.
        failure: Why the function failed, or "".
    """

    tracks: Tracks
    sensed: SensedTracks
    build: str
    build_hash: str
    plan: pd.DataFrame | None
    handed_over: tuple[HandedOver, ...]
    moments: Mapping[str, Floats] = field(default_factory=dict)
    ended: str = ""
    failure: str = ""


def drive_vehicle(task: DriveTask) -> DrivenVehicle:
    """Let the function drive the vehicle among the others, who react to it.

    Raises ResimError where the build or the model cannot be used, or where it fails before it drove at all.
    """
    network, build = load(task.road), load_build(task.build)
    scenario = describe(task.tracks, network, ego=task.ego, map_name=map_name(task.road))
    case = Case(
        scenario, network, build, Direct(), the_sensor(task.perception, task.sight), vehicle_model(task.vehicle),
        traffic=task.traffic, seed=task.seed,
    )  # fmt: skip
    drive = case.drive()
    return _told(task, drive)


def _told(task: DriveTask, drive: SimulatedDrive) -> DrivenVehicle:
    build, truth, end = drive.case.build, drive.truth, float(drive.truth.t[-1])
    truth = truth.select(truth.ids[truth.valid.any(axis=1)])
    seen = [one for one in drive.perceived if -1e-9 <= one.t <= end + 1e-9]
    if not seen:
        raise ResimError(f"the EGO {task.ego} was not driven at all: {_end(drive)}")
    ended = "" if drive.end == "duration" else f"at {end:.2f} s by {_end(drive)}"
    return DrivenVehicle(
        truth, sensed_tracks(seen, truth, task.ego), build.label, build.hash, planned(drive, end), drive.handed_over,
        {one.id: _moments(task.tracks, truth, one.id) for one in drive.handed_over}, ended, drive.failure,
    )  # fmt: skip


def _end(drive: SimulatedDrive) -> str:
    names = ", ".join(one.id for one in drive.collisions)
    told = {"collision": f"a collision with {names}", "off_road": "leaving the road"}
    return told.get(drive.end, f"the function: {drive.failure}")


def _moments(before: Tracks, after: Tracks, name: str) -> Floats:
    """Times (2, M) [s] at which an object was, and is, as far along its way."""
    ways = []
    for tracks in (before, after):
        row = tracks.index(name)
        own = tracks.valid[row]
        steps = np.hypot(np.diff(tracks.x[row, own]), np.diff(tracks.y[row, own]))
        ways.append((tracks.t[own], np.concatenate([[0.0], np.cumsum(steps)])))
    (t, way), (t_after, way_after) = ways
    return np.stack([t, np.interp(way, way_after, t_after, right=np.inf)])


def sense_vehicle(tracks: Tracks, ego: str, perception: FrozenFile, sight: float, seed: int) -> SensedTracks:
    """Give what one vehicle perceives of the others, up to so many metres, while it is there."""
    seen = perceive_along(the_sensor(perception, sight), tracks, ego, np.random.default_rng(seed))
    return sensed_tracks(seen, tracks, ego)


def the_sensor(model: FrozenFile | None, sight: float) -> Perception:
    """Give the perception of a model, or that of who sees all as it is. Raises InputError."""
    return WithinSight(IdealPerception() if model is None else Sensor(read_model(model)), sight)
