"""One run of a finished sweep, done once more: is it the same, and what happened in it?"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from pydantic import MISSING

from resim.core.errors import InputError, ResimError
from resim.core.files import file_hash
from resim.core.plugins.frozen import FrozenFile
from resim.core.provenance import versions
from resim.execution.child import Failure
from resim.execution.workers import run_all
from resim.metrics.criteria import freeze_criteria, read_criteria
from resim.perception.model import freeze_model
from resim.recordings.content import content_hash
from resim.report import write_report
from resim.resimulation import (
    AssessmentOptions,
    PerceptionSetup,
    ResimulationOptions,
    assess_resimulation,
    load_checked,
    resimulate,
)
from resim.results import whole_folder, write_assessment, write_resimulation
from resim.simulation.function.interface import freeze_build, load_build
from resim.simulation.vehicles.registry import vehicle_model
from resim.sweeps.one_run import RATE
from resim.sweeps.result import SweepResult
from resim.sweeps.tasks import RunTask, run, swept_model, with_values
from resim.sweeps.varied import VariedRuns
from resim.verification.inputs import HashedFile

LONGEST = 600.0
"""s of wall clock for the traces and the report of one run."""


@dataclass(frozen=True)
class TraceTask:
    """A run of which to write the traces and the report into a folder."""

    task: RunTask
    out: Path


def task_of(swept: SweepResult, number: int, vehicle: str | None = None) -> RunTask:
    """Give the task of a run. vehicle: another model than the sweep's.

    Raises InputError where there is no such run, or where an input has changed since, ResimError for no such model.
    """
    vehicle_model(vehicle or swept.inputs.vehicle)
    row = _row(swept, number)
    inputs, file = swept.inputs, swept.file
    hashes: dict[str, Callable[[Path], str]] = {
        "recording": content_hash, "build": lambda p: freeze_build(p).hash,
        "criteria": lambda p: freeze_criteria(p).hash, "perception": lambda p: freeze_model(p).hash,
    }  # fmt: skip
    told = {
        "recording": inputs.recordings[row["recording"]], "build": inputs.builds[row["build"]],
        "criteria": inputs.criteria, "perception": inputs.perception,
    }  # fmt: skip
    held = {
        name: _unchanged(swept.folder, one, hashes[name]) for name, one in told.items() if one is not None
    }
    values = tuple((p.name, float(row[p.name])) for p in swept.parameters)
    return RunTask(
        number, held["recording"].path, held["recording"].hash, held["build"], held.get("perception"),
        held["criteria"], file.accept, values, int(row["seed"]),
        vehicle or swept.inputs.vehicle, file.engine, traffic=file.reacts, varied=_varied(swept),
    )  # fmt: skip


def _varied(swept: SweepResult) -> VariedRuns | None:
    """How recordings are varied, as long as what says so is what it was."""
    told, inputs = swept.file.variation, swept.inputs
    if told is None or inputs.kernels is MISSING:
        return None
    verified = inputs.verified
    return VariedRuns(
        told, _unchanged(swept.folder, inputs.kernels, file_hash),
        None if verified is MISSING else _unchanged(swept.folder, verified, file_hash), swept.file.accept,
    )  # fmt: skip


def _row(swept: SweepResult, number: int) -> pd.Series[Any]:
    mine = swept.rows[swept.rows["run"] == number]
    if mine.empty:
        last = int(swept.rows["run"].max())
        raise InputError(swept.folder, f"has no run {number}", f"Its runs are 0 to {last}.")
    return mine.iloc[0]


def _unchanged(folder: Path, told: HashedFile, hash_of: Callable[[Path], str]) -> FrozenFile:
    """An input, as long as it is what it was."""
    path = Path(os.path.normpath(folder / told.path))
    remedy = "Restore it as it was in the sweep; without it the run cannot be repeated."
    try:
        found = hash_of(path)
    except (OSError, ResimError) as e:
        raise InputError(path, f"an input of the sweep, cannot be read: {e}", remedy) from e
    if found != told.hash:
        problem = f"has changed since the sweep: its hash is {found[:12]}…, was {str(told.hash)[:12]}…"
        raise InputError(path, problem, remedy)
    return FrozenFile(path, found)


def repeat(swept: SweepResult, task: RunTask) -> dict[str, tuple[Any, Any]]:
    """Do a run again, in a child process, and give the columns that differ: in the table, and now."""
    row = _row(swept, task.run)
    _, result = next(run_all(run, [(task,)], workers=1, time_limit=swept.file.time_limit))
    now = {"end": "failed", "failure": result.reason} if isinstance(result, Failure) else result[0].row
    made = list(swept.rows.columns)[list(swept.rows.columns).index("end") :]
    pairs = {name: (_plain(row[name]), _plain(now.get(name))) for name in made}
    return {name: pair for name, pair in pairs.items() if pair[0] != pair[1]}


def _plain(value: Any) -> Any:
    """A value of the table as Python has it, None for none."""
    if value is None or (isinstance(value, float) and value != value) or value is pd.NA:
        return None
    return value.item() if hasattr(value, "item") else value


def other_versions(swept: SweepResult) -> list[str]:
    """Say what was of another version in the sweep than now."""
    then, now = swept.manifest.versions, versions()
    return [f"{name} {v}, now {now.get(name)}" for name, v in then.items() if now.get(name) != v]


def write_traces(task: RunTask, out: Path) -> str | None:
    """Write what `resim run` writes of this run, traces and report, into a folder; give why not, where it crashes."""
    if task.varied is not None:
        return "a run of a variation is repeated, but its traces are not written"
    _, result = next(run_all(_write, [TraceTask(task, out)], workers=1, time_limit=LONGEST))
    return result.reason if isinstance(result, Failure) else None


def _write(traces: TraceTask) -> None:
    """Re-simulate GT with the run's build, model and seed: the same run, with all that is around it."""
    task = traces.task
    build, model = with_values(load_build(task.build), task.values), swept_model(task.perception, task.values)
    perceiving = None
    if model is not None and task.perception is not None:
        told = [
            (name.removeprefix("perception."), v) for name, v in task.values if name.startswith("perception.")
        ]
        overrides = tuple(f"{name}={v!r}" for name, v in told)
        perceiving = PerceptionSetup(model, (task.seed,), overrides, task.perception.hash)
    recording = load_checked(task.folder, accept=task.accept)
    options = ResimulationOptions(
        bases=("GT",), vehicle=task.vehicle, seed=0 if perceiving else task.seed, traffic=task.traffic
    )
    result = resimulate(recording, build, options, perceiving=perceiving, accept=task.accept)
    how = AssessmentOptions(criteria=read_criteria(task.criteria), rate=RATE)  # as the sweep judged it
    assessed = assess_resimulation(result, how, model=True)
    with whole_folder(traces.out) as folder:
        write_resimulation(result, folder)
        write_assessment(assessed, folder, folder)
        write_report(result, assessed, folder / "report.html")
