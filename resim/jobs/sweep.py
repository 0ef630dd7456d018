"""Sweep perception-error models: what `resim sweep` does."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from resim.core.errors import InputError
from resim.core.files import relative
from resim.core.plugins.frozen import files_of
from resim.core.spec import read_sealed_json, to_json
from resim.execution import journal
from resim.execution.cluster import cluster
from resim.execution.workers import in_child
from resim.jobs.given import path_of
from resim.report.markup import Markup
from resim.report.notebook import notebook_html
from resim.results import SWEEP_REPORT, check_output, whole_file, write_json
from resim.sweeps.analysis import analyse
from resim.sweeps.estimate import sample
from resim.sweeps.execution import begin, compact, execute, inputs, table
from resim.sweeps.file import Sweep, read_sweep
from resim.sweeps.manifest import SweepInputs, SweepManifest
from resim.sweeps.page import write_sweep_page
from resim.sweeps.repeat import other_versions, task_of, write_traces
from resim.sweeps.repeat import repeat as repeat_task
from resim.sweeps.report import SweepReport
from resim.sweeps.result import read_swept
from resim.sweeps.tasks import RunTask

ALL = (1, 1)
"""The shard that is the whole sweep."""


@dataclass(frozen=True)
class SweepOptions:
    """How to run a sweep.

    Attributes:
        vehicle: Name of the EGO's vehicle model.
        resume: Whether to resume the sweep that the folder holds.
        shard: (I, N): every N-th run from the I-th on, 1 to N.
        workers: Processes; all cores, if None.
        scheduler: Address of a cluster's Dask scheduler; None runs here.
    """

    vehicle: str = "kinematic"
    resume: bool = False
    shard: tuple[int, int] = ALL
    workers: int | None = None
    scheduler: str | None = None

    @property
    def processes(self) -> int:
        """How many processes run here."""
        return self.workers or os.cpu_count() or 1


@dataclass(frozen=True)
class SweepListener:
    """Hears of a sweep while it runs.

    Attributes:
        begun: How many runs of this shard were done before.
        expected: How many runs it is, which grow with an adaptive plan.
        done: Of each run: whether it failed.
        findings: What is wrong with a recording: its name, and lines.
        dashboard: Of the page of the cluster.
    """

    begun: Callable[[int], None] = lambda runs: None
    expected: Callable[[int], None] = lambda runs: None
    done: Callable[[bool], None] = lambda failed: None
    findings: Callable[[str, tuple[str, ...]], None] = lambda recording, lines: None
    dashboard: Callable[[str], None] = lambda address: None


@dataclass(frozen=True, eq=False, repr=False)
class SweepRuns:
    """A sweep in its folder, as far as it was run. Shows itself in a notebook.

    Attributes:
        folder: Folder of the results.
        missing: How many runs of other shards are missing; the table is there when none is.
    """

    folder: Path
    missing: int

    @cached_property
    def manifest(self) -> SweepManifest | None:
        """What manifest.json says; None while runs are missing."""
        if self.missing:
            return None
        remedy = "Resume the sweep with --resume."
        return read_sealed_json(self.folder / "manifest.json", SweepManifest, "resim sweep", remedy)

    @property
    def failed(self) -> int:
        """How many runs failed."""
        return 0 if self.manifest is None else self.manifest.failed

    @property
    def runs(self) -> int:
        """How many runs there are."""
        return 0 if self.manifest is None else self.manifest.runs

    @cached_property
    def table(self) -> pd.DataFrame:
        """A row a run: recording, build, seed, the parameters, and what came of it."""
        return read_swept(self.folder).rows

    def failures(self) -> tuple[int, str]:
        """Give how many of the runs so far failed, and of the first of them its number and why; "" where none did."""
        if self.manifest is not None and not self.manifest.failed:
            return 0, ""
        entries = journal.read(self.folder / "journal")
        whys = {e.run: str(e.row["failure"]) for e in entries if e.row["failure"] is not None}
        return len(whys), f"run {min(whys)}: {whys[min(whys)]}" if whys else ""

    def __repr__(self) -> str:
        told = f"{self.missing} runs missing" if self.missing else f"{self.runs} runs, {self.failed} failed"
        return f"<SweepRuns {self.folder}: {told}>"

    def _repr_html_(self) -> str:
        tables = {} if self.missing else {"runs": self.table}
        return notebook_html(repr(self).strip("<>"), Markup(), tables)


def sweep(
    file: str | Path,
    out: str | Path,
    options: SweepOptions = SweepOptions(),
    *,
    listener: SweepListener = SweepListener(),
) -> SweepRuns:
    """Re-simulate recordings with the parameters of a plan, and judge every run.

    What was finished is committed, run by run: after an interruption, `resume` does what is missing.

    Args:
        file: Sweep file: recordings, builds, parameters and their ranges, plan.
        out: Folder for the results.
        options: How to run it.
        listener: Hears of it while it runs.

    Returns:
        The folder, with the table of the runs.

    Raises:
        InputError: The file cannot be used, or the folder holds another sweep.
    """
    folder, shard = path_of(out), options.shard
    wanted = read_sweep(path_of(file), options.vehicle)
    held, _ = in_child(_checked, (wanted, folder, shard, False))
    if shard != ALL and wanted.file.planned.grows:
        problem = "an adaptive plan cannot be sharded: the next runs follow from all results"
        raise InputError("--shard", problem, "Use many workers with --scheduler, or another plan.")
    begin(folder, held, resume=options.resume or shard != ALL)
    numbers = {entry.run for entry in journal.read(folder / "journal")}
    listener.begun(sum(number % shard[1] == shard[0] - 1 for number in numbers))
    with nullcontext() if options.scheduler is None else cluster(options.scheduler) as there:
        if there is not None:
            listener.dashboard(there.dashboard)
        execute(
            wanted,
            folder,
            workers=options.processes if there is None else there.threads,
            shard=shard,
            pool=None if there is None else there.pool,
            expect=lambda total: listener.expected(-(-total // shard[1])),
            tell=listener.done,
            found=listener.findings,
        )
    missing, _ = compact(wanted, folder)
    return SweepRuns(folder, missing)


@dataclass(frozen=True)
class SweepEstimate:
    """How large a sweep is.

    Attributes:
        runs: How many runs; of an adaptive plan at least as many.
        adaptive: Whether the plan is adaptive.
        each: Time of one run [s] in its batch; None where all that were tried fail, or there are none.
        seconds: Time of the whole sweep [s].
        size: Size of one run's result [bytes].
        tried: How many runs were tried.
        failures: Why runs that were tried failed, or ended before their time by the function's fault.
    """

    runs: int
    adaptive: bool
    each: float | None
    seconds: float
    size: float
    tried: int
    failures: tuple[str, ...]


def estimate(file: str | Path, out: str | Path, options: SweepOptions = SweepOptions()) -> SweepEstimate:
    """Run a few runs of a sweep as it runs them, and say how large it is; nothing is written.

    Args:
        file: Sweep file.
        out: Folder that the results would go to.
        options: How it would be run.

    Returns:
        Number of runs, time and size of each.

    Raises:
        InputError: The file cannot be used.
    """
    begin = time.monotonic()
    wanted = read_sweep(path_of(file), options.vehicle)
    _, runs = in_child(_checked, (wanted, path_of(out), options.shard, True))
    adaptive = wanted.file.planned.grows
    if runs is None or runs.empty:  # as of a shard more than there are runs
        return SweepEstimate(0, adaptive, None, 0.0, 0.0, 0, ())
    checking = time.monotonic() - begin  # as the sweep does, too
    found = sample(wanted, runs, options.processes)
    return SweepEstimate(
        len(runs), adaptive, found.each, checking + found.seconds, found.size, found.tried, found.failures
    )


def _checked(
    task: tuple[Sweep, Path, tuple[int, int], bool],
) -> tuple[SweepInputs, pd.DataFrame | None]:
    """Check in a child process that the builds take what is swept; give the inputs, and the runs if they are wanted."""
    sweep, out, shard, wanted = task
    runs = table(sweep, shard)
    return inputs(sweep, out), runs if wanted else None


def report_sweep(folder: str | Path, page: str | Path | None = None) -> SweepReport:
    """Say what a finished sweep found, and write a page and, with all numbers, a JSON file of the same name.

    Args:
        folder: Folder of the sweep.
        page: Page (.html) to write; report.html in the folder, if None.

    Returns:
        Requirements, boundaries, sensitivity, responses and the worst runs, as the JSON file has them.

    Raises:
        InputError: The folder holds no finished sweep, or the page cannot be written.
    """
    path = path_of(folder) / "report.html" if page is None else path_of(page)
    if path.suffix.lower() not in (".html", ".htm"):
        raise InputError("--out", f"{str(path)!r} is not a page", "Name an .html file.")
    with whole_file(path.with_suffix(".json"), SWEEP_REPORT) as data, whole_file(path) as drawn:
        found = in_child(_analysed, (path_of(folder), _as_called(path_of(folder))))
        write_sweep_page(found, drawn)
        write_json(to_json(found), data)
    return found


def _as_called(folder: Path) -> str:
    """A folder as commands name it: from here where it is below, else whole, as nobody knows where `..` began."""
    here = folder.absolute().is_relative_to(Path.cwd())
    return relative(folder, Path.cwd()) if here else str(folder.absolute())


def _analysed(results: tuple[Path, str]) -> SweepReport:
    """Analyse a sweep in a child process, as its criteria bring code: its folder, and that from where commands run."""
    return analyse(read_swept(results[0]), results[1])


@dataclass(frozen=True)
class RepeatedRun:
    """A run of a sweep that was repeated.

    Attributes:
        differ: Values in the sweep and now, by the columns that differ.
        versions: What was of another version in the sweep, in words.
        untraced: Why there are no traces; "" where there are.
    """

    differ: Mapping[str, tuple[Any, Any]]
    versions: tuple[str, ...]
    untraced: str


def repeat(folder: str | Path, run: int, out: str | Path, *, vehicle: str | None = None) -> RepeatedRun:
    """Repeat one run of a sweep, compare it with its row in the table, and write its traces and report.

    Args:
        folder: Folder of the finished sweep.
        run: Number of the run.
        out: Folder for what `resim run` writes; an earlier result there is replaced.
        vehicle: Another vehicle model than the sweep's.

    Returns:
        What differs.

    Raises:
        InputError: There is no such run, or an input has changed since.
    """
    check_output(path_of(out))
    swept = read_swept(path_of(folder))
    task = in_child(_task, (path_of(folder), run, vehicle))
    files = files_of(task.build, task.criteria, task.perception)
    check_output(path_of(out), inputs=(path_of(folder), task.folder, *files))
    differ = repeat_task(swept, task)
    return RepeatedRun(differ, tuple(other_versions(swept)), write_traces(task, path_of(out)) or "")


def _task(run: tuple[Path, int, str | None]) -> RunTask:
    """Look in a child process whether all is there to do a run again."""
    return task_of(read_swept(run[0]), run[1], run[2])
