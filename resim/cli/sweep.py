"""`resim sweep`: how late, how wrong, how blind may perception be?"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from resim.cli.app import BadVerdictError, Vehicle, sweep_app
from resim.cli.runs import register
from resim.cli.terminal import say
from resim.core.errors import InputError
from resim.core.sealed import read_sealed

if TYPE_CHECKING:
    import pandas as pd

    from resim.sweeps.execution import Tell
    from resim.sweeps.file import Sweep


@sweep_app.command("run")
def sweep(
    file: Annotated[
        Path, typer.Argument(help="Sweep (TOML): recordings, builds, parameters and their ranges, plan.")
    ],
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    vehicle: Vehicle = "kinematic",
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the sweep that --out holds.")] = False,
    shard: Annotated[
        str, typer.Option(metavar="I/N", help="Do every N-th run only, from the I-th on: for job arrays.")
    ] = "1/1",
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; all cores, if not given.")] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Dask scheduler of a cluster, such as tcp://head:8786."),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Say how many runs it is, how long it takes, how large it gets.")
    ] = False,
) -> None:
    """Re-simulate recordings over and over, with the parameters of a plan, and judge every run.

    What was finished is committed, run by run: after an interruption, --resume does what is missing. Ends with 1 where
    every run failed.
    """
    from resim.execution import journal
    from resim.execution.cluster import cluster
    from resim.execution.workers import in_child
    from resim.results import locked
    from resim.sweeps.execution import begin, compact, execute
    from resim.sweeps.file import read_sweep

    part = _shard(shard)
    wanted = read_sweep(file, vehicle)
    told, runs = in_child(_checked, (wanted, out, part, dry_run))
    count = workers or os.cpu_count() or 1
    if runs is not None:
        _estimate(wanted, runs, count)
        return
    if part[1] > 1 and wanted.file.plan == "adaptive":
        problem = "an adaptive plan has no shards: what to run next follows from all results"
        raise InputError("--shard", problem, "Use many workers with --scheduler, or another plan.")
    begin(out, told, resume=resume or part[1] > 1)
    numbers = {entry["run"] for entry in journal.read(out / "journal")}
    done = sum(number % part[1] == part[0] - 1 for number in numbers)
    with locked(out, "a command that deletes it", shared=True):
        with ExitStack() as stack:
            expect, tell = stack.enter_context(_progress(part[1], done))
            pool = None
            if scheduler is not None:
                there = stack.enter_context(cluster(scheduler))
                say(f"dashboard: {there.dashboard}", err=True)
                pool, count = there.pool, there.threads
            execute(
                wanted,
                out,
                workers=count,
                shard=part,
                pool=pool,
                expect=expect,
                tell=tell,
                found=_say_findings,
            )
        missing, failed = compact(wanted, out)
    if missing:
        say(f"{out}: this shard is done; {missing} runs of others are missing")
        return
    manifest = read_sealed(out / "manifest.json", "Go on by --resume.")
    say(f"{out / 'runs'}: {manifest['runs']} runs, {failed} failed")
    for found in manifest.get("boundaries", ()):
        _tell_boundary(found, len(wanted.file.build) > 1)
    register(out)
    if failed == manifest["runs"]:
        raise BadVerdictError(f"{out}: every run failed, such as run 0: {_first_failure(out)}")


def _first_failure(out: Path) -> str:
    from resim.execution import journal

    return next(str(e["row"]["failure"]) for e in journal.read(out / "journal") if e["run"] == 0)


def _say_findings(recording: str, findings: tuple[str, ...]) -> None:
    for line in findings:
        say(f"{recording}: finding: {line}")


def _checked(
    task: tuple[Sweep, Path, tuple[int, int], bool],
) -> tuple[dict[str, Any], pd.DataFrame | None]:
    """Check in a child process that the builds take what is swept; give the inputs, and the runs if they are wanted."""
    from resim.sweeps.execution import inputs, table

    sweep, out, part, wanted = task
    runs = table(sweep, part)
    return inputs(sweep, out), runs if wanted else None


def _tell_boundary(found: dict[str, Any], builds: bool) -> None:
    """Say what an adaptive plan found."""
    of = f"{found['recording']}, {found['build']}" if builds else found["recording"]
    cells = len(found["cells"])
    told = (
        f"the outcome changes in {cells} cell{'s' * (cells != 1)} of the stated width"
        if cells
        else "the outcome is the same at all points tried"
    )
    if not found["known"]:
        told = "the boundary is not known to the stated width: give more points"
    say(f"{of}: {told} ({found['points']} points)")


def _estimate(wanted: Sweep, runs: pd.DataFrame, workers: int) -> None:
    """Do a few runs, and say how long all of them take."""
    from resim.sweeps.execution import sample

    if runs.empty:  # as of a shard more than there are runs
        say("0 runs")
        return
    each, size, failures = sample(wanted, runs, workers)
    if failures:
        say(f"a run fails: {failures[0]}")
    if each is None:
        return
    seconds = each * len(runs) / workers
    told = f"{seconds:.0f} s" if seconds < 600.0 else f"{seconds / 3600.0:.1f} h"
    count = f"{'at least ' * (wanted.file.plan == 'adaptive')}{len(runs)} runs of {each:.2f} s each"
    say(f"{count}, about {told} with {workers} processes, {size * len(runs) / 1e6:.1f} MB")


def _shard(text: str) -> tuple[int, int]:
    first, _, count = text.partition("/")
    if not (first.isdigit() and count.isdigit() and 1 <= int(first) <= int(count)):
        raise InputError("--shard", f"{text!r} is no shard", "Give I/N with I from 1 to N, such as 3/8.")
    return int(first), int(count)


@contextmanager
def _progress(shards: int, done: int) -> Iterator[tuple[Callable[[int], None], Tell]]:
    """A bar on a terminal: runs, rate, failures, time left."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    bar = Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(), console=console, transient=True, disable=not console.is_terminal,
    )  # fmt: skip
    failures = 0
    with bar:
        task = bar.add_task("0 failed", total=None, completed=done, rate="")

        def expect(total: int) -> None:
            bar.update(task, total=-(-total // shards))

        def tell(failed: bool) -> None:
            nonlocal failures
            failures += failed
            speed = bar.tasks[0].speed
            rate = "" if speed is None else f"{speed:.1f}/s"
            bar.update(task, description=f"{failures} failed", advance=1, rate=rate)

        yield expect, tell
