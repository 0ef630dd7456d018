"""What a child process does for one run of a sweep; what it has loaded serves the next."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from resim.core.errors import InputError
from resim.core.plugins.frozen import FrozenFile
from resim.core.schema import Row
from resim.metrics.criteria import read_criteria
from resim.perception.model import PerceptionModel, read_model
from resim.recordings.checked import finding_lines
from resim.recordings.content import refuse_changed
from resim.resimulation import ResimulationOptions, load_checked
from resim.simulation.function.interface import Build, load_build
from resim.sweeps.engines import ENGINES, EngineName, Fingerprint, is_repeated
from resim.sweeps.one_run import PreparedRuns, prepare_sweep, run_once

PRELOADED = ("resim.resimulation.run",)
"""What a child has before it starts."""
Values = tuple[tuple[str, float], ...]
"""Parameters by name, as a sweep has them, and their values."""


@dataclass(frozen=True)
class RunTask:
    """One run: `values` are of the parameters that are swept. hash: of the recording's content. vehicle: its model.

    engine: what simulates it. repeated: the share of runs with a fingerprint, as they are repeated in SUMO.
    """

    run: int
    folder: Path
    hash: str
    build: FrozenFile
    perception: FrozenFile | None
    criteria: FrozenFile
    accept: tuple[str, ...]
    values: Values
    seed: int
    vehicle: str
    engine: EngineName = "sumo"
    repeated: float = 0.0


@dataclass(frozen=True)
class RunResult:
    """What a run came to (`row`), how long it took [s], and lines on the findings in its recording.

    fingerprint: of the drive, None of one that is not to be repeated.
    """

    row: Row
    time: float
    findings: tuple[str, ...]
    fingerprint: Fingerprint | None


def run(task: RunTask) -> RunResult:
    """Do the run."""
    prepared = _prepared(task.folder, task.hash, task.criteria, task.accept)
    build, model = with_values(_build(task.build), task.values), swept_model(task.perception, task.values)
    begin = time.perf_counter()
    options = ResimulationOptions(vehicle=task.vehicle, engine=ENGINES[task.engine])
    drive, row = run_once(prepared, build, model, task.seed, options)
    taken = time.perf_counter() - begin
    drawn = is_repeated(drive.case.hash, task.run, task.repeated)
    findings = finding_lines(prepared.recording.recording.findings)
    return RunResult(row, taken, findings, drive.fingerprint() if drawn else None)


@lru_cache(maxsize=32)
def _prepared(folder: Path, digest: str, criteria: FrozenFile, accept: tuple[str, ...]) -> PreparedRuns:
    refuse_changed(folder, digest)
    prepared = prepare_sweep(load_checked(folder, accept=accept), read_criteria(criteria), accept)
    refuse_changed(folder, digest)  # nor was it, while it was read
    return prepared


@lru_cache(maxsize=32)
def _build(frozen: FrozenFile) -> Build:
    return load_build(frozen)


@lru_cache(maxsize=32)
def swept_model(frozen: FrozenFile | None, values: Values) -> PerceptionModel | None:
    """Give the model with the parameters of it that are swept, None without one. Raises InputError."""
    if frozen is None:
        return None
    mine = tuple(
        f"{name.removeprefix('perception.')}={value!r}"
        for name, value in values
        if name.startswith("perception.")
    )
    return read_model(frozen, mine)


def with_values(build: Build, values: Values) -> Build:
    """Give the build with the parameters of the function and of the build that are swept. Raises InputError."""
    own = {n.removeprefix("function."): value for n, value in values if n.startswith("function.")}
    of = {n.removeprefix("build."): value for n, value in values if n.startswith("build.")}
    if strange := [name for name in of if name != "cycle_time"]:
        raise InputError(
            build.path, f"a build has no parameter {strange[0]!r} to sweep", "There is build.cycle_time."
        )
    if cycle := [value for value in of.values() if value <= 0.0]:
        raise InputError(
            build.path, f"build.cycle_time {cycle[0]:g} s: expected more than 0", "Correct the range."
        )
    return replace(
        build, parameters={**build.parameters, **own}, cycle_time=of.get("cycle_time", build.cycle_time)
    )
