"""One recording, one build: describe, re-simulate, describe again, compare. What every command calls."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from resim.core.errors import ResimError
from resim.core.files import file_hash
from resim.core.objects import GAP
from resim.core.sightings import SAME
from resim.core.tracks import Tracks
from resim.recordings import Recording
from resim.resimulation import fidelity
from resim.resimulation.doubts import doubts
from resim.resimulation.fidelity import STEPS, StepErrors
from resim.resimulation.notes import misfits, notes, perception_notes
from resim.resimulation.perceived import PerceptionSetup
from resim.resimulation.result import (
    Basis,
    PreparedRecording,
    Resimulation,
    ResimulationOptions,
    of_seed,
    own_tracks,
    pipeline_step,
)
from resim.road.checked import check_map, refuse_flaws
from resim.road.measured_heights import with_heights
from resim.road.opendrive import RoadNetwork
from resim.scenario.scenario import Scenario, describe
from resim.simulation.case import SimulatedDrive
from resim.simulation.function.interface import Build
from resim.simulation.perception import Perception

PRELOADED = (
    "resim.road.kernel",
    "resim.metrics.measures.kernel",
    "resim.metrics.risk.kernel",
    "resim.perception.runtime.kernel",
    "resim.simulation.sumo.library",
)
"""What takes long to load is imported where it is called; a child that simulates has it before it starts."""

FAR = 10_000.0
"""Distance [m] of an EGO from the roads beyond which there is nothing to simulate."""

FASTEST = 150.0
"""Largest speed [m/s] of a trace: beyond it no measured object drives, and SUMO takes none."""

LOOK = 0.1
"""Time [s] between the speeds looked at."""

LONGEST = 600.0
"""Largest time [s] of one run: memory and time of a fit grow with its square and more."""

MS = 1000.0
"""Milliseconds in a second."""

Progress = Callable[[str], None]

STAGES = ("map", "fit GT", "fit SD", "run GT", "fit rGT", "run SD", "fit rSD", "errors", "run GT+M")
"""What `resimulate` tells its progress, in order, as far as the bases ask for it."""


@dataclass
class _Clock:
    """Wall-clock times of the stages, and who wants to hear of them."""

    progress: Progress
    times: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        self.progress(name)
        begin = time.perf_counter()
        yield
        self.times[name] = time.perf_counter() - begin


def resimulate(
    recording: Recording,
    build: Build,
    options: ResimulationOptions = ResimulationOptions(),
    *,
    perceiving: PerceptionSetup | None = None,
    accept: Collection[str] = (),
    progress: Progress = lambda stage: None,
) -> Resimulation:
    """Re-simulate a recording with a build, on each basis that the recording has, and compare every step.

    perceiving: a perception model to run GT with as well, once a seed. accept: codes of errors in the map to
    continue despite; InputError for any other.
    """
    clock = _Clock(progress)
    prepared = prepare(recording, options.bases, accept, clock)
    result = Resimulation(prepared, build, options)
    for basis in options.bases:
        if basis in prepared.measured:
            result = _simulated(result, basis, clock)
    with clock.stage("errors"):
        result = replace(result, errors=_errors(result), misfits=_misfits(result))
    result = replace(
        result,
        warnings=tuple(notes(result)),
        times=clock.times,
        hashes={
            "build": build.hash,
            "map": file_hash(recording.map),
            "net": prepared.checked.net.hash,
            **_recording_hashes(recording),
        },
    )
    if perceiving is None:
        return result
    with clock.stage("run GT+M"):
        *_, last = over_seeds(result, perceiving)
        return with_notes(last, perceiving)


def prepare(
    recording: Recording, bases: Collection[Basis], accept: Collection[str] = (), clock: _Clock | None = None
) -> PreparedRecording:
    """Look over the map, and describe what was measured: GT, and SD where it is asked for."""
    clock = clock or _Clock(lambda stage: None)
    with clock.stage("map"):
        checked = check_map(recording.map)
        refuse_flaws(checked.network, checked.flaws, accept)
    whole = measured_tracks(recording, checked.network)
    for tracks in whole.values():
        _refuse_far(recording, tracks, checked.network)
    measured = {basis: _split(recording, tracks) for basis, tracks in whole.items()}
    described: dict[Basis, Scenario] = {}
    for basis in measured:
        if basis == "GT" or basis in bases:
            with clock.stage(f"fit {basis}"):
                described[basis] = _describe(measured[basis], recording, checked.network, basis)
                _refuse_absurd(recording, described[basis], checked.network, basis)
    found = {
        basis: doubts(recording, basis, tracks, described.get(basis), checked.network)
        for basis, tracks in whole.items()
    }
    return PreparedRecording(recording, checked, whole, measured, described, found)


def _simulated(result: Resimulation, basis: Basis, clock: _Clock) -> Resimulation:
    """Add rGT or rSD: the drive, and what describes it."""
    source, scenario, options = f"r{basis}", result.described[basis], result.options
    with clock.stage(f"run {basis}"):
        case = options.case(scenario, result.network, result.build)
        drive = case.drive(window=options.gui)
    with clock.stage(f"fit {source}"):
        refits = {**result.refits}
        if _is_describable(drive):
            refits[source] = _describe(drive.truth, result.recording, result.network, source, scenario)
    return replace(result, drives={**result.drives, source: drive}, refits=refits)


def _is_describable(drive: SimulatedDrive) -> bool:
    """Whether a drive lasted long enough for splines."""
    return int(drive.truth.valid[0].sum()) >= 2


def over_seeds(result: Resimulation, perceiving: PerceptionSetup) -> Iterator[Resimulation]:
    """Run GT with a perception model, seed after seed, each when it is asked for; with all before it."""
    from resim.perception.runtime.sensor import Sensor

    sensor = Sensor(perceiving.model)
    for seed in perceiving.seeds:
        result = run_on_gt(result, perception=sensor, seed=seed)
        yield result


def with_notes(result: Resimulation, perceiving: PerceptionSetup) -> Resimulation:
    """Give the re-simulation with what qualifies its drives with a perception model. perceiving: with their seeds."""
    drives = [result.drives[of_seed(seed)] for seed in perceiving.seeds]
    asked = (f"{result.build.label}: {drive.unpinned}" for drive in drives if drive.unpinned)
    return replace(
        result,
        perceiving=perceiving,
        warnings=tuple(dict.fromkeys([*result.warnings, *perception_notes(perceiving, drives), *asked])),
        hashes={**result.hashes, "perception": perceiving.hash},
    )


def describe_recording(recording: Recording, network: RoadNetwork) -> dict[Basis, Scenario]:
    """Describe what a recording measured by splines, GT and where there is one SD."""
    return {
        basis: _describe(_split(recording, tracks), recording, network, basis)
        for basis, tracks in measured_tracks(recording, network).items()
    }


def measured_tracks(recording: Recording, network: RoadNetwork | None = None) -> dict[Basis, Tracks]:
    """Give GT, and SD where there is one, each as long as the EGO is there.

    Heights are those that the network bears out, none without it (`resim.road.measured_heights`).
    """
    every = _measured(recording)
    if network is None:
        return {basis: replace(tracks, z=None) for basis, tracks in every.items()}
    return {basis: with_heights(tracks, network) for basis, tracks in every.items()}


def _measured(recording: Recording) -> dict[Basis, Tracks]:
    where = recording.folder or recording.name
    gt = _ego_window(recording.gt, recording.ego, f"{where}: gt")
    if (sd := recording.sd_by_gt()) is None:
        return {"GT": gt}
    if not recording.senses_ego:
        sd = _as_long_as_driven(sd, recording)
    sd = _ego_window(sd, recording.ego, f"{where}: sd")
    if sd.t[0] > gt.t[-1] or sd.t[-1] < gt.t[0]:
        raise ResimError(
            f"{where}: gt lasts from {gt.t[0]:g} to {gt.t[-1]:g} s and sd from {sd.t[0]:g} to {sd.t[-1]:g} s: "
            "they do not overlap in time. Give both the same clock."
        )
    return {"GT": gt, "SD": sd}


def _as_long_as_driven(sd: Tracks, recording: Recording) -> Tracks:
    """The SD before its first and after its last sample, too, while the GT has the EGO, which it is without.

    Who sees nobody writes no rows: where these end, the drive does not.
    """
    ego = recording.gt.select([recording.ego])
    first, last = ego.t[ego.valid[0]][[0, -1]].tolist()
    step = float(np.median(np.diff(sd.t))) if len(sd.t) > 1 else np.inf
    before = np.arange(sd.t[0] - step, first + SAME, -step)[::-1]
    after = np.arange(sd.t[-1] + step, last - SAME, step)
    start, end = (
        [when] if way * (when - known) > SAME else []
        for when, known, way in ((first, sd.t[0], -1.0), (last, sd.t[-1], 1.0))
    )
    t = np.concatenate([start, before, sd.t, after, end])
    if len(t) == len(sd.t):
        return sd
    others = sd.without(recording.ego).at(t, max_gap=0.0)
    return Tracks.concatenate([others, recording.ego_at(t)])


def _refuse_far(recording: Recording, tracks: Tracks, network: RoadNetwork) -> None:
    """Raise ResimError for an EGO beyond everything that the map can say."""
    row = tracks.index(recording.ego)
    at = network.to_road(tracks.x[row], tracks.y[row])  # whichever level
    length = np.array([network.roads[str(road)].length for road in at.road])
    off = np.nan_to_num(np.hypot(at.t, at.s - np.clip(at.s, 0.0, length)))
    if off.max() > FAR:
        raise ResimError(
            f"{recording.folder or recording.name}: EGO {recording.ego!r} is {off.max() / 1e3:.0f} km from the roads "
            f"of {recording.map} at t = {tracks.t[off.argmax()]:g} s. Give positions in the map's frame."
        )


def _refuse_absurd(recording: Recording, scenario: Scenario, network: RoadNetwork, basis: str) -> None:
    """Raise ResimError naming who, fitted to what was measured, drives faster than anything does."""
    t = scenario.ego.spawn_time + np.arange(0.0, scenario.duration, LOOK)
    tracks = scenario.tracks(network, t)
    fast = np.abs(np.nan_to_num(tracks.v))
    row, at = np.unravel_index(int(fast.argmax()), fast.shape)
    if fast[row, at] > FASTEST:
        raise ResimError(
            f"{recording.folder or recording.name}: {basis}: object {str(tracks.ids[row])!r} would drive at "
            f"{fast[row, at]:.4g} m/s at t = {t[at]:.2f} s, as its rows have it; up to {FASTEST:g} m/s are "
            "re-simulated. Look at its rows with `resim check`, and correct them or leave the object out."
        )


def _split(recording: Recording, tracks: Tracks) -> Tracks:
    try:
        return tracks.split(GAP, keep=recording.ego)
    except ResimError as e:
        raise ResimError(f"{recording.folder or recording.name}: {e}") from e


def _ego_window(tracks: Tracks, ego: str, where: str) -> Tracks:
    own = tracks.valid[tracks.index(ego)]
    if own.sum() < 2:
        raise ResimError(f"{where}: EGO {ego!r} has {int(own.sum())} sample(s), expected two or more")
    first, last = tracks.t[own][[0, -1]].tolist()
    if last - first > LONGEST:
        text = (
            f"{where}: EGO {ego!r} is there for {last - first:g} s, from {first:g} to {last:g} s; up to {LONGEST:g} s "
            "are re-simulated in one run. "
        )
        if _in_ms(tracks, tracks.index(ego)):
            raise ResimError(f"{text}By its speeds and positions t is in ms. Give t in seconds.")
        raise ResimError(f"{text}Cut the recording to the scenario.")
    return tracks.window(first, last)


def _in_ms(tracks: Tracks, row: int) -> bool:
    """Whether the object's speeds are about a thousand times what its positions and times say."""
    own = tracks.valid[row]
    t, x, y, v = tracks.t[own], tracks.x[row, own], tracks.y[row, own], np.abs(tracks.v[row, own])
    moved, told = float(np.hypot(np.diff(x), np.diff(y)).sum()), float((np.diff(t) * v[1:]).sum())
    return moved > 0.0 and MS / 2.0 < told / moved < MS * 2.0


def _describe(
    tracks: Tracks, recording: Recording, network: RoadNetwork, what: str, driven: Scenario | None = None
) -> Scenario:
    return describe(
        tracks, network, ego=recording.ego, map_name=map_name(recording.map),
        description=f"{recording.name}: {what}", environment=recording.environment, driven=driven,
    )  # fmt: skip


def map_name(road: Path) -> str:
    """Give the name under which results keep the map: its own, where no other system or file minds it."""
    return road.name if re.fullmatch(r"[\w.-]+\.xodr", road.name, re.ASCII) else "map.xodr"


def run_on_gt(result: Resimulation, *, perception: Perception | None = None, seed: int = 0) -> Resimulation:
    """Add a drive on GT with a perception (None: ideal), as rGT+M with its seed; its pipeline error is the EGO's.

    What describes it is the EGO, and who was handed over: other traffic is that of rGT, and its fit with it.
    """
    return runs_on_gt(result, [(perception, seed)])[0]


def runs_on_gt(result: Resimulation, runs: Sequence[tuple[Perception | None, int]]) -> list[Resimulation]:
    """Give for each perception and seed what `run_on_gt` gives; the engine may drive them at once."""
    cases = [
        result.options.case(
            result.described["GT"], result.network, result.build, perception=perception, seed=seed
        )
        for perception, seed in runs
    ]
    return [_with(result, drive) for drive in result.options.engine.drive(cases)]


def _with(result: Resimulation, drive: SimulatedDrive) -> Resimulation:
    """The re-simulation with a drive on GT, described, and its pipeline error."""
    recording, network, source = result.recording, result.network, of_seed(drive.case.seed)
    refits, errors = {**result.refits}, {**result.errors}
    if _is_describable(drive):
        refits[source] = _describe(drive.truth.select(own_tracks(drive)), recording, network, source)
        errors[pipeline_step(source)] = fidelity.pipeline_error(
            refits[source], result.prepared.whole["GT"], network
        )
    return replace(result, drives={**result.drives, source: drive}, refits=refits, errors=errors)


def _errors(result: Resimulation) -> dict[str, StepErrors]:
    """Of every step between what was measured, described and simulated, in the order of STEPS."""
    out: dict[str, StepErrors] = {}
    recording, network, whole = result.recording, result.network, result.prepared.whole
    if "SD" in whole:
        out["S"] = fidelity.sensor_error(whole["GT"], whole["SD"], ego=recording.ego)
        if not recording.senses_ego:
            for column in (out["S"].x, out["S"].y, out["S"].v, out["S"].heading):
                column[0] = np.nan  # the ground truth stands in for it: no error was measured
    for basis, scenario in result.described.items():
        out[f"FIT_{basis}"] = fidelity.fit_error(scenario, result.measured[basis], network)
    for source, drive in result.simulated().items():
        out[f"SIM_{source.removeprefix('r')}"] = fidelity.simulation_error(
            drive.truth, drive.case.scenario, network
        )
        if (refit := result.refits.get(source)) is not None:
            out[f"FIT_{source}"] = fidelity.fit_error(refit, drive.truth, network)
            out[pipeline_step(source)] = fidelity.pipeline_error(refit, whole["GT"], network)
    return {step: out[step] for step in STEPS if step in out}


def _misfits(result: Resimulation) -> dict[str, str]:
    """What `misfits` says of every source that is described."""
    positions = {source: tracks.to_frame() for source, tracks in result.tracks().items()}
    return misfits(result.scenarios(), positions, result.network)


def _recording_hashes(recording: Recording) -> dict[str, str]:
    if recording.folder is None:
        return {}
    names = (
        "recording.toml",
        *(f"{table}.{end}" for table in ("gt", "sd", "plan") for end in ("csv", "parquet")),
    )
    return {name: file_hash(recording.folder / name) for name in names if (recording.folder / name).is_file()}
