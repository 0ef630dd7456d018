"""What a child process does for one recording of a suite."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from resim.core.files import file_hash
from resim.core.plugins.frozen import FrozenFile
from resim.core.tracks import Tracks
from resim.metrics.criteria import read_criteria
from resim.perception.model import read_model
from resim.recordings import Recording
from resim.recordings.content import refuse_changed
from resim.report import write_report
from resim.resimulation import (
    AssessmentOptions,
    Basis,
    Options,
    PerceptionSetup,
    Resimulation,
    assess_resimulation,
    load_checked,
    of_seed,
    resimulate,
)
from resim.results import whole_file
from resim.simulation.function.interface import load_build
from resim.verification.builds import compare_builds
from resim.verification.page.drive import REPORTED
from resim.verification.tolerance import Tolerances
from resim.verification.verify import Demands, verify_recording

RATE = 10.0
"""Samples a second [Hz] of the traces on the page."""
BUILDS = ("before", "now")
"""The older build and the newer one."""


@dataclass(frozen=True)
class VerificationTask:
    """One recording to verify, or to run with two builds where `against` is one.

    hash: that its content must have, None where it could not be read. reports: folder for the re-simulation reports,
    None for none.
    """

    name: str
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


def run(task: VerificationTask) -> dict[str, Any]:
    """Give what verification.json holds of the recording (`entry`), `traces` for the page, and how long it took [s]."""
    begin = time.perf_counter()
    with _unchanged(task):
        recording = load_checked(task.folder, accept=task.accept)
        out = _verify(task, recording) if task.against is None else _compare(task, recording)
    return {**out, "time": time.perf_counter() - begin}


@contextmanager
def _unchanged(task: VerificationTask) -> Iterator[None]:
    """Raise InputError where the recording is not the one of the task, before or after it was read."""
    refuse_changed(task.folder, task.hash)
    yield
    refuse_changed(task.folder, task.hash)


def _verify(task: VerificationTask, recording: Recording) -> dict[str, Any]:
    demands = Demands(read_criteria(task.criteria), task.tolerances, task.agreement, task.vary)
    found = verify_recording(
        recording, load_build(task.build), demands, Options(bases=task.bases, vehicle=task.vehicle), _perceiving(task),
        task.accept,
    )  # fmt: skip
    return {"entry": found.to_json(), "traces": _traces(found.result)}


def _compare(task: VerificationTask, recording: Recording) -> dict[str, Any]:
    old, new = (load_build(one) for one in (task.against, task.build) if one is not None)
    options = Options(bases=("GT",), vehicle=task.vehicle)
    found = compare_builds(
        recording, old, new, read_criteria(task.criteria), options, _perceiving(task), task.accept
    )
    traces = {which: _traces(result) for which, result in zip(BUILDS, (found.old, found.new), strict=True)}
    return {"entry": found.to_json(), "traces": traces}


def reports_of(name: str, *, builds: bool) -> list[str]:
    """Give the names of a recording's re-simulation reports: one, or one of each build."""
    return [f"{name}.{which}.html" for which in BUILDS] if builds else [f"{name}.html"]


def report(task: VerificationTask) -> dict[str, str]:
    """Re-simulate the recording once more, and write its reports into `task.reports`; give their hashes by name."""
    assert task.reports is not None
    pages = reports_of(task.name, builds=task.against is not None)
    with ExitStack() as stack:
        files = [stack.enter_context(whole_file(task.reports / name)) for name in pages]
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
            Options(bases=bases, vehicle=task.vehicle),
            perceiving=_perceiving(replace(task, seeds=task.seeds[:REPORTED])),
            accept=task.accept,
        )
        write_report(result, assess_resimulation(result, how), file)


def _perceiving(task: VerificationTask) -> PerceptionSetup | None:
    if task.perception is None:
        return None
    model = read_model(task.perception, task.settings)
    return PerceptionSetup(model, task.seeds, task.settings, task.perception.hash)


def _traces(result: Resimulation) -> dict[str, Any]:
    """The EGO's speed [m/s] in every drive over `t` [s]; in the runs with a perception model its range and median."""
    ego, gt = result.ego, result.described["GT"]
    t = np.round(np.arange(gt.ego.spawn_time, gt.ego.spawn_time + gt.duration + 1e-9, 1.0 / RATE), 9)

    def speed(tracks: Tracks) -> list[float | None]:
        v = tracks.select([ego]).at(t).v[0]
        return [round(float(value), 3) if np.isfinite(value) else None for value in v]

    out: dict[str, Any] = {"t": t.tolist(), "GT": speed(gt.tracks(result.network, t))}
    out |= {source: speed(drive.truth) for source, drive in result.simulated().items()}
    out["rGT+M"] = [speed(result.drives[of_seed(seed)].truth) for seed in result.seeds]
    return out
