"""Recordings of traffic with an EGO: an AD function drives one of the vehicles, or it senses the others, or both."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from resim.core.files import joined
from resim.core.geometry import Floats
from resim.core.plugins.frozen import FrozenFile
from resim.core.tracks import Tracks
from resim.execution.workers import in_child
from resim.perception.model import freeze_model, read_model
from resim.recordings import Recording
from resim.resimulation.driven import DrivenVehicle, DriveTask, drive_vehicle, sense_vehicle
from resim.road.opendrive import RoadNetwork
from resim.scenario.generation.told import speeding, standing
from resim.scenario.generation.truth import TrueManeuver
from resim.simulation.function.interface import freeze_build, load_build
from resim.simulation.naturalistic.settings import TrafficEgoSettings
from resim.simulation.naturalistic.windows import TrafficWindow
from resim.simulation.vehicles.registry import vehicle_model

FEWEST = 25
"""Samples of a vehicle that is to be the EGO. What a function drives of them is recorded however short it is."""
MOTION = ("x", "y", "heading", "v", "a", "yaw_rate")


@dataclass(frozen=True)
class TrafficEgo:
    """Who drives the EGO of traffic, and by what it sees the others.

    Attributes:
        settings: What the settings say of it.
        build: The function's build, None where SUMO drives.
        perception: The perception model, None where the EGO sees the others as they are.
    """

    settings: TrafficEgoSettings
    build: FrozenFile | None
    perception: FrozenFile | None

    def provenance(self) -> dict[str, str]:
        """Give what a recording says of it."""
        out = {}
        if self.build is not None:
            out["driver"] = f"{self.build.path.name}, vehicle model {self.settings.vehicle}"
        if self.perception is not None:
            out["perception"] = f"{self.perception.path.name}, SHA-256 {self.perception.hash}"
        return out


def read_ego(
    file: Path, settings: TrafficEgoSettings, build: Path | None, perception: Path | None
) -> TrafficEgo | None:
    """Read what the settings or the call name, and refuse early what cannot be used; None where nothing is named.

    Args:
        file: Of the settings, from which their paths are seen.
        settings: Of the EGO.
        build: Build file of the call, None for that of the settings.
        perception: Perception model of the call, None for that of the settings.

    Returns:
        Who drives and what is sensed, None where nothing is asked.

    Raises:
        InputError: A file is wrong.
        ResimError: The vehicle model is unknown.
    """
    driver = build or (joined(file, settings.build) if settings.build is not None else None)
    seen = perception or (joined(file, settings.perception) if settings.perception is not None else None)
    if driver is None and seen is None:
        return None
    vehicle_model(settings.vehicle)
    model = None if seen is None else freeze_model(seen)
    if model is not None:
        read_model(model)
    pinned = None if driver is None else freeze_build(driver)
    if pinned is not None:
        in_child(_loads, pinned)
    return TrafficEgo(settings, pinned, model)


def _loads(build: FrozenFile) -> str:
    return load_build(build).label


@dataclass(frozen=True, eq=False)
class EgoWindow:
    """A window of traffic with its EGO.

    Attributes:
        recording: With what was sensed, and the plans; its name and provenance are still to be said.
        window: Begin, tracks and truth.
        note: How the drive ended early, "" where it did not.
        failed: Whether the function failed.
    """

    recording: Recording
    window: TrafficWindow
    note: str = ""
    failed: bool = False


def with_ego(
    window: TrafficWindow, ego: TrafficEgo, network: RoadNetwork, rate: float, seed: int
) -> EgoWindow | None:
    """Give the part of the window in which its EGO is there, driven and sensed as is asked; None without an EGO.

    Args:
        window: Traffic.
        ego: Who drives and what is sensed.
        network: Its map.
        rate: Samples a second [Hz].
        seed: Of the perception.

    Returns:
        The part as a recording, None where nobody is there for long enough.

    Raises:
        ResimError: The function cannot be used.
    """
    name = _longest(window.tracks, ego.settings.kind)
    if name is None:
        return None
    # whom a function meets nobody knows before it drove: one that stands meets those from far behind
    part = _cut(window, name, ego.settings.around if ego.build is None else np.inf)
    if ego.build is None:
        assert ego.perception is not None
        sensed = sense_vehicle(part.tracks, name, ego.perception, ego.settings.sight, seed)
        recording = Recording(
            name="", map=network.path, ego=name, gt=part.tracks, gt_rate=rate, sd=sensed.tracks, sd_rate=rate,
            sd_gt_id=sensed.gt_id,
        )  # fmt: skip
        return EgoWindow(recording, part)
    said = ego.settings
    task = DriveTask(
        network.path,
        part.tracks,
        name,
        ego.build,
        ego.perception,
        said.sight,
        said.vehicle,
        said.reactive,
        seed,
    )
    driven = _with_those_near(in_child(drive_vehicle, task), name, said.around)
    made = replace(part, tracks=driven.tracks, maneuvers=tuple(_truth(part, driven, name, network)))
    times = driven.sensed.tracks.t
    recording = Recording(
        name="", map=network.path, ego=name, gt=driven.tracks, gt_rate=rate, sd=driven.sensed.tracks,
        sd_rate=round(1.0 / float(np.median(np.diff(times))), 6) if len(times) > 1 else rate,
        sd_gt_id=driven.sensed.gt_id, build=driven.build, build_hash=driven.build_hash, plan=driven.plan,
        provenance=_reactions(driven),
    )  # fmt: skip
    return EgoWindow(recording, made, driven.ended, bool(driven.failure))


def _longest(tracks: Tracks, kind: str) -> str | None:
    """The vehicle of a kind that is there longest, the lowest row of several; None where none is there for long."""
    lasts = tracks.valid.sum(axis=1) * (tracks.kind == kind)
    row = int(np.argmax(lasts)) if len(lasts) else 0
    return str(tracks.ids[row]) if len(lasts) and lasts[row] >= FEWEST else None


def _cut(window: TrafficWindow, ego: str, around: float) -> TrafficWindow:
    """The window as long as somebody is there, with who comes within so many metres of it; its times from 0 on."""
    tracks = window.tracks
    own = tracks.t[tracks.valid[tracks.index(ego)]]
    first, last = float(own[0]), float(own[-1])
    part = tracks.window(first, last).shifted(-first)
    part = part.select(part.ids[(part.valid.sum(axis=1) > 1) & _near(part, ego, around)])
    moved = (m._replace(start=m.start - first, end=m.end - first, t=m.t - first) for m in window.maneuvers)
    kept = tuple(m for m in moved if m.object in part.ids and _is_there(part, m.object, m.t))
    return replace(window, begin=window.begin + first, tracks=part, maneuvers=kept)


def _near(tracks: Tracks, ego: str, around: float) -> np.ndarray:
    """Who (N,) ever comes within so many metres of the EGO."""
    row = tracks.index(ego)
    away = np.hypot(tracks.x - tracks.x[row], tracks.y - tracks.y[row])
    return np.asarray(np.nanmin(np.where(tracks.valid & tracks.valid[row], away, np.inf), axis=1) <= around)


def _with_those_near(driven: DrivenVehicle, ego: str, around: float) -> DrivenVehicle:
    """What was driven with who came near it, reacted to it, or was sensed."""
    tracks = driven.tracks
    known = {one.id for one in driven.handed_over} | set(driven.sensed.gt_id.tolist())
    keep = _near(tracks, ego, around) | np.isin(tracks.ids, sorted(known))
    return replace(driven, tracks=tracks.select(tracks.ids[keep]))


def _is_there(tracks: Tracks, name: str, t: float) -> bool:
    own = tracks.t[tracks.valid[tracks.index(name)]]
    return bool(own[0] - 1e-9 <= t <= own[-1] + 1e-9)


def _truth(
    part: TrafficWindow, driven: DrivenVehicle, ego: str, network: RoadNetwork
) -> Iterator[TrueManeuver]:
    """What is known of a driven window: of who kept to its trace what it was, of who reacted when it did so.

    Where a driver that reacts changed lanes of its own, the truth of that vehicle ends. Of the EGO, which the function
    drives, and of who reacts, speeding and standing follow from the motion.
    """
    until = {one.id: one.lane_changes[0].t for one in driven.handed_over if one.lane_changes}
    other = {ego, *driven.moments}
    for m in part.maneuvers:
        if m.object in driven.tracks.ids and m.label != "speeding" and m.object != ego:
            if m.object in other and m.label == "standing":
                continue
            moved = _moved(m, driven.moments.get(m.object))
            if moved.t < until.get(m.object, np.inf) and _is_there(driven.tracks, m.object, moved.t):
                yield moved
    k = driven.tracks
    for row, name in enumerate(k.ids.tolist()):
        here = k.valid[row]
        states = np.stack([c[row, here] for c in (k.x, k.y, k.heading, k.v)])
        yield from speeding(name, network, k.t[here], states)
        if name in other:
            yield from standing(name, k.t[here], states[3])


def _moved(maneuver: TrueManeuver, moments: Floats | None) -> TrueManeuver:
    """A maneuver of who was handed over, when it is at the same places."""
    if moments is None:
        return maneuver

    def when(t: float) -> float:
        before, after = moments
        return t if t < before[0] else np.inf if t > before[-1] else float(np.interp(t, before, after))

    start, end, t = (when(one) for one in (maneuver.start, maneuver.end, maneuver.t))
    return maneuver._replace(start=start, end=end if np.isfinite(end) else maneuver.end, t=t)


def _reactions(driven: DrivenVehicle) -> dict[str, str]:
    out = {}
    if driven.handed_over:
        out["reacted"] = "; ".join(f"{one.id} from {one.t:.2f} s" for one in driven.handed_over)
    own = [one for one in driven.handed_over if one.lane_changes]
    if own:
        out["truth"] = "; ".join(
            f"lane changes of {one.id} are not in it from {one.lane_changes[0].t:.2f} s on" for one in own
        )
    if driven.ended:
        out["ended"] = driven.ended
    return out
