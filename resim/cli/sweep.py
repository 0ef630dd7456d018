"""`resim sweep`: how late, how wrong, how blind may perception be?"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import sweep_app
from resim.cli.runs import register
from resim.core.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

    from resim.batch.sweeps import Tell
    from resim.pipeline.sweep import Sweep


@sweep_app.command("run")
def sweep(
    file: Annotated[
        Path, typer.Argument(help="Sweep (TOML): recordings, builds, parameters and their ranges, plan.")
    ],
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
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

    What was finished is committed, run by run: after an interruption, --resume does what is missing.
    """
    from resim.batch import journal
    from resim.batch.cluster import cluster
    from resim.batch.sweeps import begin, compact, execute, inputs, table
    from resim.pipeline.sweep import read_sweep

    part = _shard(shard)
    wanted = read_sweep(file)
    runs = table(wanted, part)
    count = workers or os.cpu_count() or 1
    if dry_run:
        _estimate(wanted, runs, count)
        return
    begin(out, inputs(wanted, out), resume=resume or part[1] > 1)
    numbers = set(runs["run"])
    done = len(numbers & {entry["run"] for entry in journal.read(out / "journal")})
    with ExitStack() as stack:
        tell = stack.enter_context(_progress(len(runs), done))
        if scheduler is None:
            execute(wanted, out, workers=count, shard=part, tell=tell)
        else:
            there = stack.enter_context(cluster(scheduler))
            typer.echo(f"dashboard: {there.dashboard}", err=True)
            execute(wanted, out, workers=there.threads, shard=part, pool=there.pool, tell=tell)
    missing, failed = compact(wanted, out)
    if missing:
        typer.echo(f"{out}: this shard is done; {missing} runs of others are missing")
        return
    typer.echo(f"{out / 'runs'}: {len(runs)} runs, {failed} without a result")
    register(out)


def _estimate(wanted: Sweep, runs: pd.DataFrame, workers: int) -> None:
    """Do a few runs, and say how long all of them take."""
    from resim.batch.sweeps import sample

    each, size, failures = sample(wanted, runs)
    if failures:
        typer.echo(f"a run fails: {failures[0]}")
    if each is None:
        return
    seconds = each * len(runs) / workers
    told = f"{seconds:.0f} s" if seconds < 600.0 else f"{seconds / 3600.0:.1f} h"
    typer.echo(
        f"{len(runs)} runs of {each:.2f} s each, about {told} with {workers} processes, {size * len(runs) / 1e6:.1f} MB"
    )


def _shard(text: str) -> tuple[int, int]:
    first, _, count = text.partition("/")
    if not (first.isdigit() and count.isdigit() and 1 <= int(first) <= int(count)):
        raise InputError("--shard", f"{text!r} is no shard", "Give I/N with I from 1 to N, such as 3/8.")
    return int(first), int(count)


@contextmanager
def _progress(total: int, done: int) -> Iterator[Tell]:
    """A bar on a terminal: runs, rate, failures, time left."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    bar = Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.speed:.1f}/s"),
        TimeRemainingColumn(), console=console, transient=True, disable=not console.is_terminal,
    )  # fmt: skip
    failures = 0
    with bar:
        task = bar.add_task("0 failed", total=total, completed=done)

        def tell(failed: bool) -> None:
            nonlocal failures
            failures += failed
            bar.update(task, description=f"{failures} failed", advance=1)

        yield tell
