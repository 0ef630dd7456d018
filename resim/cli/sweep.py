"""`resim sweep`: how late, how wrong, how blind may perception be?"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import app
from resim.core.errors import InputError

if TYPE_CHECKING:
    from resim.batch.sweeps import Tell


@app.command()
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
) -> None:
    """Re-simulate recordings over and over, with the parameters of a plan, and judge every run."""
    from resim.batch import journal
    from resim.batch.sweeps import begin, compact, execute, inputs, table
    from resim.pipeline.sweep import read_sweep

    part = _shard(shard)
    wanted = read_sweep(file)
    begin(out, inputs(wanted, out), resume=resume or part[1] > 1)
    runs = set(table(wanted, part)["run"])
    done = len(runs & {entry["run"] for entry in journal.read(out / "journal")})
    with _progress(len(runs), done) as tell:
        execute(wanted, out, workers=workers or os.cpu_count() or 1, shard=part, tell=tell)
    missing = compact(wanted, out)
    if missing:
        typer.echo(f"{out}: this shard is done; {missing} runs of others are missing")
    else:
        typer.echo(f"{out / 'runs'}: {len(table(wanted))} runs")


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
