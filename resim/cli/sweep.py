"""`resim sweep`: how late, how wrong, how blind may perception be?"""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import Vehicle, Workers, command, sweep_app
from resim.cli.inputs import A_SWEEP
from resim.cli.progress import ProgressReporter
from resim.cli.runs import register
from resim.cli.terminal import add_to_json, say
from resim.core.errors import FunctionError, InputError

if TYPE_CHECKING:
    from resim.jobs.sweep import SweepListener
    from resim.sweeps.file import SweepBoundary


@command(sweep_app, "run")
def sweep(
    file: Annotated[
        Path,
        typer.Argument(
            callback=A_SWEEP, help="Sweep (TOML): recordings, builds, parameters and their ranges, plan."
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    vehicle: Vehicle = "kinematic",
    resume: Annotated[
        bool, typer.Option("--resume", help="Resume the sweep in --out; begins it where there is none.")
    ] = False,
    shard: Annotated[
        str,
        typer.Option(metavar="I/N", help="Run only every N-th run, starting with the I-th: for job arrays."),
    ] = "1/1",
    workers: Workers = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Dask scheduler of a cluster, such as tcp://head:8786."),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Only estimate the number of runs, the time and the size.")
    ] = False,
) -> None:
    """Re-simulate recordings over and over, with the parameters of a plan, and judge every run.

    What was finished is committed, run by run: after an interruption, --resume does what is missing. Ends with 3 where
    a run failed.
    """
    for name, given in (("--resume", resume), ("--scheduler", scheduler)):
        if dry_run and given:
            raise InputError(name, "has no effect on --dry-run", "Leave out one of the two.")
    part = _shard(shard)
    if dry_run:
        _estimate(file, out, vehicle, part, workers)
        return
    with _progress() as listener:
        from resim.jobs.sweep import SweepOptions
        from resim.jobs.sweep import sweep as run_sweep

        options = SweepOptions(vehicle, resume, part, workers, scheduler)
        done = run_sweep(file, out, options, listener=listener)
    failed, first = done.failures()
    add_to_json(out=out, runs=done.runs, failed=failed, missing=done.missing)
    if done.manifest is None:
        say(f"{out}: this shard is done; {done.missing} runs of others are missing")
    else:
        say(f"{out / 'runs'}: {done.runs} runs, {failed} failed")
        add_to_json(manifest=out / "manifest.json")
        for found in done.manifest.found():
            _tell_boundary(found, len(done.manifest.inputs.sweep.build) > 1)
        register(out)
    if failed:
        many = "every run" if failed == done.runs else f"{failed} run{'s' * (failed != 1)}"
        raise FunctionError(f"{out}: {many} failed, the first is {first}")


def _say_findings(recording: str, findings: tuple[str, ...]) -> None:
    for line in findings:
        say(f"{recording}: finding: {line}")


def _tell_boundary(found: SweepBoundary, builds: bool) -> None:
    """Say what an adaptive plan found."""
    of = f"{found.recording}, {found.build}" if builds else found.recording
    cells = len(found.cells)
    told = (
        f"the outcome changes in {cells} cell{'s' * (cells != 1)} of the requested width"
        if cells
        else "the outcome is the same at all points tried"
    )
    if not found.known:
        told = "the boundary is not known to the requested width: give more points"
    say(f"{of}: {told} ({found.points} points)")


def _estimate(file: Path, out: Path, vehicle: str, shard: tuple[int, int], workers: int | None) -> None:
    """Do a few runs, and say how long all of them take."""
    begin = time.monotonic()
    from resim.jobs.sweep import SweepOptions, estimate

    loading = time.monotonic() - begin
    options = SweepOptions(vehicle, shard=shard, workers=workers)
    found = estimate(file, out, options)
    seconds = found.seconds + loading
    add_to_json(runs=found.runs, seconds=seconds, seconds_a_run=found.each, bytes_a_run=found.size,
         processes=options.processes, tried=found.tried, failures=found.failures)  # fmt: skip
    if found.runs == 0:
        say("0 runs")
        return
    if found.failures:
        say(f"{len(found.failures)} of {found.tried} runs that were tried fail: {found.failures[0]}")
    if found.each is None:
        return
    told = f"{seconds:.0f} s" if seconds < 600.0 else f"{seconds / 3600.0:.1f} h"
    count = f"{'at least ' * found.adaptive}{found.runs} runs of {found.each:.2f} s each"
    size = found.size * found.runs / 1e6
    say(f"{count}, about {told} with {options.processes} processes, {size:.1f} MB")


def _shard(text: str) -> tuple[int, int]:
    first, _, count = text.partition("/")
    both = first, count
    if not (all(re.fullmatch(r"[0-9]{1,9}", number) for number in both) and 1 <= int(first) <= int(count)):
        raise InputError("--shard", f"{text!r} is not a shard", "Give I/N with I from 1 to N, such as 3/8.")
    return int(first), int(count)


def _say_dashboard(address: str) -> None:
    say(f"dashboard: {address}", err=True)


@contextmanager
def _progress() -> Iterator[SweepListener]:
    """Counts runs, and those that failed."""
    failures = 0
    with ProgressReporter("runs") as progress:
        from resim.jobs.sweep import SweepListener

        def done(failed: bool) -> None:
            nonlocal failures
            failures += failed
            progress.step(f"{failures} failed")

        yield SweepListener(progress.skip, progress.expect, done, _say_findings, _say_dashboard)
