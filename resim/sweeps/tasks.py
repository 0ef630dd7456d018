"""What a child process does for runs of a sweep; what it has loaded serves the next."""

from __future__ import annotations

import time
import zlib
from collections.abc import Sequence
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
from resim.simulation.reactive.settings import ReactiveSettings
from resim.sweeps.engines import ENGINES, Fingerprint, is_repeated
from resim.sweeps.one_run import PreparedRuns, prepare_sweep, run_together
from resim.sweeps.sweep_file import EngineName
from resim.sweeps.varied import SweptDriver, VariedRuns, vary_recording

PRELOADED = ("resim.resimulation.run",)
"""What a child has before it starts."""
Values = tuple[tuple[str, float], ...]
"""Parameters by name, as a sweep has them, and their values."""


@dataclass(frozen=True)
class RunTask:
    """One run: `values` are of the parameters that are swept. hash: of the recording's content. vehicle: its model.

    engine: what simulates it. traffic: how it reacts, None where it does not. repeated: the share of runs with a
    fingerprint, as they are repeated in SUMO. varied: how the recording is varied, None where it is not.
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
    traffic: ReactiveSettings | None = None
    varied: VariedRuns | None = None


RunBatch = tuple[RunTask, ...]
"""Runs that one process does at once."""
MOST = 32
"""Runs of a batch: more save little, and their lists take memory."""
GROUPS = 8
"""Groups of runs alike, of each recording and build, whose first batch is proved before any other result counts."""
SPREAD = 64
"""Batches of a sweep, evenly over all, of which one run each is proved before any other result counts."""
_EACH = 4
"""Batches that each worker has at least, so that all end at about the same time."""


@dataclass(frozen=True)
class RunResult:
    """What a run came to (`row`), how long it took [s] as its share of its batch, and lines on the findings in its
    recording.

    fingerprint: of the drive, None of one that is not to be repeated.
    """

    row: Row
    time: float
    findings: tuple[str, ...]
    fingerprint: Fingerprint | None


def run(tasks: RunBatch) -> tuple[RunResult, ...]:
    """Do runs that are alike (`in_batches`), at once where their engine and function can."""
    task = tasks[0]
    prepared = _prepared(task.folder, task.hash, task.criteria, task.accept)
    told: Row = {}
    if task.varied is not None:
        seen = None if task.perception is None else task.perception.hash
        setup = SweptDriver(task.build.hash, seen, task.vehicle, task.traffic)
        varied, told = vary_recording(prepared.recording, task.hash, task.varied, dict(task.values), setup)
        prepared = replace(prepared, recording=varied)
    build = with_values(_build(task.build), task.values)
    sensed = [(swept_model(one.perception, one.values), one.seed) for one in tasks]
    begin = time.perf_counter()
    options = ResimulationOptions(vehicle=task.vehicle, engine=ENGINES[task.engine], traffic=task.traffic)
    done = run_together(prepared, build, sensed, options)
    taken = (time.perf_counter() - begin) / len(tasks)
    findings = finding_lines(prepared.recording.recording.findings)
    drawn = [is_repeated(d.case.hash, one.run, one.repeated) for one, (d, _) in zip(tasks, done, strict=True)]
    return tuple(
        RunResult({**row, **told}, taken, findings, drive.fingerprint() if again else None)
        for (drive, row), again in zip(done, drawn, strict=True)
    )


def in_batches(tasks: Sequence[RunTask], workers: int) -> list[RunBatch]:
    """Group runs into batches, each of runs that are alike in all but their seeds and perceptions; in SUMO of one each.

    They are smaller than MOST where each of the workers would have few.
    """
    alike: dict[object, list[RunTask]] = {}
    for task in tasks:
        key = replace(task, run=0, seed=0, values=_values_in_common(task), repeated=0.0)
        alike.setdefault(key, []).append(task)
    most = min(MOST, max(len(tasks) // (_EACH * workers), 1))
    out = []
    for group in alike.values():
        size = most if group[0].engine == "direct" else 1
        out += [tuple(group[k : k + size]) for k in range(0, len(group), size)]
    return out


def has_parts(batch: RunBatch) -> bool:
    """Say whether a batch can be done in halves."""
    return len(batch) > 1


def to_prove_first(batches: Sequence[RunBatch]) -> list[RunBatch]:
    """Give the batches that are done first: some of their runs are to be repeated.

    Only then is it known that the build's `step_batch` answers as its `step`, and both the same to the same. Of the
    first batch of each recording and build these are the first, middle and last run; batches of other parameters of the
    function are of other groups: up to GROUPS of them are chosen, evenly. As a fault may show with some perceptions
    only, there is one run of up to SPREAD batches of several besides, evenly over all of the sweep.
    """
    groups = dict[object, dict[object, RunBatch]]()
    for batch in batches:
        if batch[0].repeated > 0.0:
            one = batch[0]
            of_values = groups.setdefault((one.folder, one.build), {})
            of_values.setdefault(_values_in_common(one), batch)
    chosen = [batch for found in groups.values() for batch in _evenly([*found.values()], GROUPS)]
    marked = {batch[0].run: {0, len(batch) // 2, len(batch) - 1} for batch in chosen}
    for batch in _evenly([one for one in batches if one[0].repeated > 0.0 and has_parts(one)], SPREAD):
        drawn = min(range(len(batch)), key=lambda k: zlib.crc32(str(batch[k].run).encode()))
        marked.setdefault(batch[0].run, {drawn})
    return [
        tuple(replace(task, repeated=1.0) if k in mine else task for k, task in enumerate(batch))
        for batch in batches
        if (mine := marked.get(batch[0].run))
    ]


def _evenly(batches: list[RunBatch], most: int) -> list[RunBatch]:
    """The first, the last, and some between."""
    count = min(len(batches), most)
    return [batches[k * (len(batches) - 1) // max(count - 1, 1)] for k in range(count)]


def _values_in_common(task: RunTask) -> Values:
    """Those that all runs of a batch have: of the function and the build, not of perception."""
    return tuple(value for value in task.values if not value[0].startswith("perception."))


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
