"""What a child process does for one recording of a suite."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from resim.core.files import file_hash
from resim.core.plugins.frozen import FrozenFile
from resim.metrics.criteria import read_criteria
from resim.perception.model import read_model
from resim.recordings import Recording
from resim.recordings.content import refuse_changed
from resim.report import write_report
from resim.resimulation import (
    AssessmentOptions,
    Basis,
    PerceptionSetup,
    ResimulationOptions,
    assess_resimulation,
    load_checked,
    resimulate,
)
from resim.resimulation.traces import SpeedTraces, speed_traces
from resim.results import whole_file
from resim.simulation.function.interface import load_build
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


@dataclass(frozen=True)
class VerificationTask:
    """One recording to verify, or to run with two builds where `against` is one.

    source: what verification.json says of where it lies. hash: that its content must have, None where it could not be
    read. reports: folder for the re-simulation reports, None for none.
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
    reports: Path | None = None

    @property
    def name(self) -> str:
        """The recording's name."""
        return self.source.name


def run(task: VerificationTask) -> VerificationCase:
    """Give what verification.json says of the recording, the traces for the page, and how long it took [s]."""
    begin = time.perf_counter()
    with _unchanged(task):
        recording = load_checked(task.folder, accept=task.accept)
        entry, traces = _verify(task, recording) if task.against is None else _compare(task, recording)
    return VerificationCase(entry, traces, time.perf_counter() - begin)


@contextmanager
def _unchanged(task: VerificationTask) -> Iterator[None]:
    """Raise InputError where the recording is not the one of the task, before or after it was read."""
    refuse_changed(task.folder, task.hash)
    yield
    refuse_changed(task.folder, task.hash)


def _verify(task: VerificationTask, recording: Recording) -> tuple[VerifiedRecording, SpeedTraces]:
    demands = Demands(read_criteria(task.criteria), task.tolerances, task.agreement, task.vary)
    found = verify_recording(
        recording, load_build(task.build), demands,
        ResimulationOptions(bases=task.bases, vehicle=task.vehicle), _perceiving(task), task.accept,
    )  # fmt: skip
    return found.entry(task.source), speed_traces(found.result)


def _compare(task: VerificationTask, recording: Recording) -> tuple[ComparedRecording, BuildTraces]:
    old, new = (load_build(one) for one in (task.against, task.build) if one is not None)
    options = ResimulationOptions(bases=("GT",), vehicle=task.vehicle)
    found = compare_builds(
        recording, (old, new), read_criteria(task.criteria), options, _perceiving(task), task.accept
    )
    return found.entry(task.source), BuildTraces(speed_traces(found.old), speed_traces(found.new))


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
            ResimulationOptions(bases=bases, vehicle=task.vehicle),
            perceiving=_perceiving(replace(task, seeds=task.seeds[:REPORTED])),
            accept=task.accept,
        )
        write_report(result, assess_resimulation(result, how), file)


def _perceiving(task: VerificationTask) -> PerceptionSetup | None:
    if task.perception is None:
        return None
    model = read_model(task.perception, task.settings)
    return PerceptionSetup(model, task.seeds, task.settings, task.perception.hash)
