"""Simulated drives for a space: what sweeps and verifications ran."""

from __future__ import annotations

import hashlib
import math
import os
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from resim.core.errors import InputError
from resim.core.files import relative
from resim.jobs.space_recordings import RecordingReader, SimulatedRecording
from resim.simulation.reactive.settings import ReactiveSettings, traffic_toml
from resim.simulation.vehicles.kinematic import Kinematic
from resim.space.members import INSIDE, SimulatedRun, TestDrive
from resim.sweeps.result import SweepResult, read_swept
from resim.verification.entries import MODEL, RecordingSource, VerifiedRecording
from resim.verification.folder import read as read_verification
from resim.verification.inputs import VerificationRequest
from resim.verification.report import VerificationReport
from resim.verification.tolerance import Tolerances

VARIATION, TRUST = "variation.", "variation_trust"
"""Begins the names of swept parameters that vary traffic; column of a sweep's table that says whether a verification
legitimises the variation (`resim vary`)."""

VERIFICATION, SWEEP = "verification.json", "manifest.json"
REPEATED, TRAFFIC = "../repeated", "traffic.toml"
"""Where commands write, and how traffic reacts where it is not as usual; both seen from the space's folder."""


@dataclass(frozen=True)
class Simulated:
    """What a sweep or a verification ran.

    Attributes:
        runs: Its runs.
        drives: What it verified.
        recordings: Those that were simulated, by key.
        label: Name and version of the build.
        build: Its hash.
        perception: Hash of the model, "" without one.
        moved: What moves the EGO, and how traffic reacts.
        traffic: What a command has to be told of how traffic reacts, as a TOML file, "" where nothing.
        judged: How drives are verified, "" of a sweep.
        mark: Name of the file in its folder that names all others by their hashes.
    """

    runs: tuple[SimulatedRun, ...]
    drives: tuple[TestDrive, ...]
    recordings: Mapping[str, SimulatedRecording]
    label: str
    build: str
    perception: str
    moved: str
    traffic: str = ""
    judged: str = ""
    mark: str = VERIFICATION


@dataclass(frozen=True)
class SpaceReading:
    """How folders of simulated drives are read.

    Attributes:
        space: Folder of the space, where commands are to be given.
        reader: Of recordings.
    """

    space: Path
    reader: RecordingReader

    def shown(self, path: Path) -> str:
        """Give a path as a shell takes it in the space's folder.

        Args:
            path: Any path.

        Returns:
            The path from the folder of the space, quoted.
        """
        return shlex.quote(relative(Path(os.path.realpath(path)), Path(os.path.realpath(self.space))))


def read_simulated(folder: Path, how: SpaceReading) -> Simulated:
    """Read a folder of `resim sweep` or `resim verify`.

    Args:
        folder: Its path.
        how: For which space, and by what recordings are read.

    Returns:
        Its runs, what it verified, and where the recordings are.

    Raises:
        InputError: It is neither, or of several builds.
    """
    if (folder / VERIFICATION).is_file():
        return _of_verification(folder, read_verification(folder / VERIFICATION), how)
    return _of_sweep(folder, read_swept(folder), how)


def _of_sweep(folder: Path, swept: SweepResult, how: SpaceReading) -> Simulated:
    inputs = swept.inputs
    builds = list(inputs.builds.items())
    if len(builds) > 1:
        raise InputError(
            folder, f"sweeps {len(builds)} builds, a space is covered by one", "Sweep each build alone."
        )
    perception = inputs.perception.hash if inputs.perception is not None else None
    changed = [p.name for p in swept.parameters if not p.name.startswith(VARIATION)]
    drives = {
        name: how.reader.read(_path(folder, one.path), one.hash or name)
        for name, one in inputs.recordings.items()
    }
    keys = {name: drive.key for name, drive in drives.items()}
    words = ", ".join(f"{name} is swept" for name in changed)
    varied = [p.name for p in swept.parameters]
    asked = inputs.sweep.variation
    told = "" if asked is None else (
        f"{sorted(asked.object)} {sorted(asked.maneuver)} {asked.box} {getattr(inputs.kernels, 'hash', '')}"
    )  # fmt: skip
    runs = [
        SimulatedRun(
            f"{folder.name}:{row['run']}", keys[row["recording"]], builds[0][1].hash or "", perception or "",
            _number(row["risk"]), _flag(row["collision"]), words, _trust(row.get(TRUST), varied),
            any(row[name] != 0.0 for name in varied if name.startswith(VARIATION)),
            repeat=f"resim sweep repeat {how.shown(folder)} {row['run']} --out {REPEATED}",
            same=_same(
                keys[row["recording"]], {name: row[name] for name in varied}, told, row["seed"] if perception else 0
            ),
        )
        for row in swept.rows.to_dict("records")
    ]  # fmt: skip
    moved = f"vehicle {inputs.vehicle}, traffic {inputs.sweep.reacts}"
    return Simulated(
        tuple(runs),
        (),
        {drive.key: drive for drive in drives.values()},
        builds[0][1].label,
        builds[0][1].hash or "",
        perception or "",
        moved,
        mark=SWEEP,
    )


def _of_verification(folder: Path, found: VerificationReport, how: SpaceReading) -> Simulated:
    inputs = found.inputs
    if inputs.against is not None:
        raise InputError(folder, "compares two builds: that verifies neither", "Verify the build alone.")
    build, perception = inputs.build.hash or "", _model(inputs)
    runs: list[SimulatedRun] = []
    drives: list[TestDrive] = []
    recordings: dict[str, SimulatedRecording] = {}
    for one in found.recordings:
        if one.hash is None:
            problem = f"its recording {one.name!r} could not be read: what happened in it is not known"
            raise InputError(folder, problem, "Mend it, and verify again.")
        path = _path(folder, one.folder)
        drive = how.reader.read(path, one.hash)
        key = drive.key
        recordings[key] = drive
        own = bool(build) and drive.build == build
        drives.append(TestDrive(key, one.name, build, perception, one.verdict, own))
        repeat = _repeat(folder, path, inputs, how)
        run = SimulatedRun("", key, build, perception, math.nan, drive.collided, repeat=repeat)
        runs += _runs(folder, one, run) if isinstance(one, VerifiedRecording) else [_failed(folder, one, run)]
    moved = f"vehicle {inputs.vehicle}, traffic {inputs.traffic}"
    own_traffic = inputs.traffic not in (None, ReactiveSettings())
    return Simulated(
        tuple(runs), tuple(drives), recordings, inputs.build.label, build, perception, moved,
        traffic_toml(inputs.traffic) if inputs.traffic and own_traffic else "", _judged(inputs),
    )  # fmt: skip


def _judged(inputs: VerificationRequest) -> str:
    """How drives are verified: what is verified within wider tolerances says less."""
    asked = inputs.tolerances
    units = {"d": "m", "v": "m/s", "heading": "rad"}
    limits = [f"{name} {limit:g} {units[name]}" for name, limit in asked.pipeline.ego if limit is not None]
    if asked.reaction is not None:
        limits.append(f"reaction {asked.reaction:g} s")
    digest = hashlib.sha256(asked.model_dump_json().encode()).hexdigest()[:8]
    usual = "" if asked == Tolerances() else f", by tolerances that are not the usual ones ({digest})"
    criteria = f"{Path(inputs.criteria.path).name} ({(inputs.criteria.hash or '')[:12]})"
    return (
        f"drives are verified by {criteria} with an agreement of {inputs.agreement:g}, where their EGO differs by at "
        f"most {', '.join(limits) or 'anything'}{usual}"
    )


def _model(inputs: VerificationRequest) -> str:
    """The hash of the perception model; another one where parameters took the place of the file's."""
    told = _hash(inputs.perception)
    return (
        hashlib.sha256(" ".join([told, *inputs.settings]).encode()).hexdigest() if inputs.settings else told
    )


def _repeat(folder: Path, recording: Path, inputs: VerificationRequest, how: SpaceReading) -> str:
    """The command that repeats what a verification ran of a recording, but for the seed."""
    told = [f"resim run {how.shown(recording)} --build {how.shown(_path(folder, inputs.build.path))}"]
    told.append(f"--out {REPEATED}")
    if inputs.vehicle != Kinematic.name:
        told.append(f"--vehicle {inputs.vehicle}")
    if inputs.traffic is not None:
        told.append(f"--traffic {'reactive' if inputs.traffic == ReactiveSettings() else TRAFFIC}")
    if inputs.perception is not None:
        told.append(f"--perception {how.shown(_path(folder, inputs.perception.path))} --seeds 1")
        told += [f"--set {shlex.quote(one)}" for one in inputs.settings]
    return " ".join([*told, *(f"--accept {code}" for code in inputs.accept)])


def _runs(folder: Path, one: VerifiedRecording, run: SimulatedRun) -> Iterator[SimulatedRun]:
    """The runs that a verification judged a recording by. run: what they have in common, `collided` of the drive."""
    name = f"{folder.name}:{one.name}"
    if one.way == MODEL:
        risks = one.risk.each().get(MODEL, ())
        for seed, risk in zip(one.seeds, risks, strict=True):
            known = math.nan if seed.failure or risk is None else risk
            ended: bool | None = seed.end == "collision"  # off the road nobody says what it would have met
            if seed.failure or (not ended and (seed.end != "duration" or run.collided is None)):
                ended = None
            repeat = f"{run.repeat} --seed {seed.seed}"
            yield replace(
                run, name=f"{name}:{seed.seed}", risk=known, collided=ended, repeat=repeat,
                same=_same(run.recording, {}, "", seed.seed),
            )  # fmt: skip
        return
    risk = one.risk.each().get(one.way, (None,))[0]
    collided = (
        run.collided if one.verdict == "verified" else None
    )  # it ends as the drive did; of another nobody says
    same = _same(run.recording, {}, "" if one.way == "rGT" else one.way, 0)
    yield replace(run, name=name, risk=math.nan if risk is None else risk, collided=collided, same=same)


def _failed(folder: Path, one: RecordingSource, run: SimulatedRun) -> SimulatedRun:
    """The run of a recording that could not be verified: nobody says how it ends."""
    return replace(
        run, name=f"{folder.name}:{one.name}", collided=None, same=_same(run.recording, {}, "failed", 0)
    )


def accidents(given: Iterable[Simulated]) -> set[str]:
    """Give the recordings that the build drove and in which its EGO collides, or nobody says that it does not, or that
    broke off.

    Args:
        given: What was simulated, of one build.

    Returns:
        Their keys.
    """
    return {key for one in given for key, drive in one.recordings.items() if drive.is_accident(one.build)}


def _same(recording: str, values: Mapping[str, float], varied: str, seed: int) -> str:
    """What tells a run from others of the same build and model, whoever did it.

    values: of parameters that vary traffic; varied: how they do.
    """
    moved = sorted((name, float(value)) for name, value in values.items() if value != 0.0)
    return f"{recording} {moved} {varied if moved else ''} {seed}"


def _trust(told: object, varied: Sequence[str]) -> str:
    """The trust of a run; unknown where a variation has none."""
    return told if isinstance(told, str) and told else "unknown" if varied else INSIDE


def one_build(given: Sequence[tuple[Path, Simulated]]) -> Simulated:
    """Give the one whose build and perception all have.

    Args:
        given: Folders, and what they hold.

    Returns:
        The first of them.

    Raises:
        InputError: They are of several builds, perception models, vehicle models or kinds of traffic, or verified by
            different criteria or tolerances.
    """
    (_, first), *others = given
    judged = [(folder, one.judged) for folder, one in given if one.judged]
    if other := next((folder for folder, how in judged if how != judged[0][1]), None):
        problem = f"its {dict(judged)[other]}; in {judged[0][0]}, {judged[0][1]}"
        raise InputError(other, problem, "Verify all with the same criteria and tolerances.")
    for folder, one in others:
        if (one.build, one.perception, one.moved) != (first.build, first.perception, first.moved):
            what = "build" if one.build != first.build else "perception model"
            if (one.build, one.perception) == (first.build, first.perception):
                what = f"vehicle model or traffic ({one.moved})"
            raise InputError(
                folder, f"is of another {what} than {given[0][0]}", "Cover a space by one of each."
            )
    return first


def _path(folder: Path, name: str) -> Path:
    return Path(os.path.normpath(folder / name))


def _hash(file: object) -> str:
    return str(getattr(file, "hash", "") or "")


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float | np.floating) else math.nan


def _flag(value: object) -> bool | None:
    return None if value is None or value is pd.NA or value != value else bool(value)
