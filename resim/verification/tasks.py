"""What a child process does for one recording of a suite."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from resim.core.files import file_hash
from resim.core.plugins.frozen import FrozenFile
from resim.metrics.criteria import read_criteria
from resim.perception.model import read_model
from resim.recordings import Recording
from resim.recordings.content import refuse_changed
from resim.report import SHEET, write_player_page, write_report
from resim.report.player import of_resimulation, smaller
from resim.resimulation import (
    AssessmentOptions,
    Basis,
    PerceptionSetup,
    Resimulation,
    ResimulationAssessment,
    ResimulationOptions,
    assess_resimulation,
    load_checked,
    resimulate,
)
from resim.resimulation.traces import SpeedTraces, speed_traces
from resim.results import whole_file
from resim.simulation.function.interface import load_build
from resim.simulation.reactive.settings import ReactiveSettings
from resim.verification.builds import compare_builds
from resim.verification.cases import BuildTraces, VerificationCase
from resim.verification.entries import ComparedRecording, RecordingSource, VerifiedRecording
from resim.verification.page.drive import REPORTED
from resim.verification.tolerance import Tolerances
from resim.verification.verify import Demands, verify_recording

PRELOADED = ("resim.resimulation.run",)
"""What a child has before it starts."""
BUILDS = ("before", "now")
"""The older build and the newer one."""
PLAYED = 60_000
"""Samples of a layer in the page of a drive: of 50 objects at 25 Hz those of 48 s."""
CURVES = ("risk", "TTC")
"""Measures that the player draws."""


@dataclass(frozen=True)
class VerificationTask:
    """One recording to verify, or to run with two builds where `against` is one.

    source: what verification.json says of where it lies. hash: that its content must have, None where it could not be
    read. reports: folder for the re-simulation reports, drives: for pages with the player; None for none.
    """

    source: RecordingSource
    folder: Path
    hash: str | None
    build: FrozenFile
    against: FrozenFile | None
    criteria: FrozenFile
    bases: tuple[Basis, ...]
    perception: FrozenFile | None
    settings: tuple[str, ...]
    seeds: tuple[int, ...]
    agreement: float
    tolerances: Tolerances
    vary: tuple[str, ...]
    accept: tuple[str, ...]
    vehicle: str
    traffic: ReactiveSettings | None = None
    reports: Path | None = None
    drives: Path | None = None

    @property
    def name(self) -> str:
        """The recording's name."""
        return self.source.name


def run(task: VerificationTask) -> VerificationCase:
    """Verify the recording and write the page that plays it; gives what is told of it, and how long it took [s]."""
    begin = time.perf_counter()
    with _unchanged(task):
        recording = load_checked(task.folder, accept=task.accept)
        how = _verify if task.against is None else _compare
        entry, traces, played = how(task, recording)
        drive = _write_drive(task, played)
    return VerificationCase(entry, traces, time.perf_counter() - begin, drive=drive)


@contextmanager
def _unchanged(task: VerificationTask) -> Iterator[None]:
    """Raise InputError where the recording is not the one of the task, before or after it was read."""
    refuse_changed(task.folder, task.hash)
    yield
    refuse_changed(task.folder, task.hash)


Played = Mapping[str, tuple[Resimulation, ResimulationAssessment]]
"""What the page of a drive plays, by its name there."""


def _verify(task: VerificationTask, recording: Recording) -> tuple[VerifiedRecording, SpeedTraces, Played]:
    demands = Demands(read_criteria(task.criteria), task.tolerances, task.agreement, task.vary)
    found = verify_recording(
        recording, load_build(task.build), demands,
        ResimulationOptions(bases=task.bases, vehicle=task.vehicle, traffic=task.traffic),
        _perceiving(task), task.accept,
    )  # fmt: skip
    return found.entry(task.source), speed_traces(found.result), {task.name: found.played}


def _compare(task: VerificationTask, recording: Recording) -> tuple[ComparedRecording, BuildTraces, Played]:
    old, new = (load_build(one) for one in (task.against, task.build) if one is not None)
    options = ResimulationOptions(bases=("GT",), vehicle=task.vehicle, traffic=task.traffic)
    found = compare_builds(
        recording, (old, new), read_criteria(task.criteria), options, _perceiving(task), task.accept
    )
    traces = BuildTraces(speed_traces(found.old), speed_traces(found.new))
    played = {}
    if task.drives is not None:
        for result in (found.new, found.old):
            assessed = assess_resimulation(result, AssessmentOptions(only=CURVES))
            played[f"{task.name} · {result.build.label}"] = (result, assessed)
    return found.entry(task.source), traces, played


def drive_page(name: str) -> str:
    """Give the name of the page that plays a recording and its re-simulation."""
    return f"{name}.html"


def _write_drive(task: VerificationTask, played: Played) -> str | None:
    """Write the page that plays the drive; give its hash, None where none is wanted."""
    if task.drives is None:
        return None
    with whole_file(task.drives / drive_page(task.name), None) as file:
        drives = [
            smaller(replace(of_resimulation(result, assessed), name=name), PLAYED)
            for name, (result, assessed) in played.items()
        ]
        write_player_page(drives, file, shared=(task.drives / SHEET).is_file())
        return file_hash(file)


def reports_of(name: str, *, builds: bool) -> list[str]:
    """Give the names of a recording's re-simulation reports: one, or one of each build."""
    return [f"{name}.{which}.html" for which in BUILDS] if builds else [f"{name}.html"]


def report(task: VerificationTask) -> dict[str, str]:
    """Re-simulate the recording once more, and write its reports into `task.reports`; give their hashes by name."""
    assert task.reports is not None
    pages = reports_of(task.name, builds=task.against is not None)
    with ExitStack() as stack:
        files = [stack.enter_context(whole_file(task.reports / name, None)) for name in pages]
        with _unchanged(task):
            _write_reports(task, files)
        return {name: file_hash(file) for name, file in zip(pages, files, strict=True)}


def _write_reports(task: VerificationTask, files: Sequence[Path]) -> None:
    recording, how = (
        load_checked(task.folder, accept=task.accept),
        AssessmentOptions(criteria=read_criteria(task.criteria)),
    )
    builds = [task.build] if task.against is None else [task.against, task.build]
    bases: tuple[Basis, ...] = task.bases if task.against is None else ("GT",)
    for file, build in zip(files, builds, strict=True):
        result = resimulate(
            recording,
            load_build(build),
            ResimulationOptions(bases=bases, vehicle=task.vehicle, traffic=task.traffic),
            perceiving=_perceiving(replace(task, seeds=task.seeds[:REPORTED])),
            accept=task.accept,
        )
        shared = (file.parent / SHEET).is_file()
        write_report(result, assess_resimulation(result, how), file, shared=shared)


def _perceiving(task: VerificationTask) -> PerceptionSetup | None:
    if task.perception is None:
        return None
    model = read_model(task.perception, task.settings)
    return PerceptionSetup(model, task.seeds, task.settings, task.perception.hash)
