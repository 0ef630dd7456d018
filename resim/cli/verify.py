"""`resim verify`: may simulation stand in for the test drives, for this build? What does a new build do otherwise?"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from resim.cli.app import BadVerdictError, Vehicle, app
from resim.cli.runs import register
from resim.cli.terminal import say, visible
from resim.core.errors import InputError, ResimError

if TYPE_CHECKING:
    from resim.verification.execution import Told
    from resim.verification.request import VerificationRequest, VerifyOptions


@app.command()
def verify(
    suite: Annotated[
        Path | None, typer.Argument(help="Suite (TOML): recordings, criteria, tolerances.")
    ] = None,
    build: Annotated[Path | None, typer.Option(help="Build file (TOML) of the AD function.")] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for the results; what an interrupted verification left there is gone on with."
        ),
    ] = None,
    against: Annotated[
        Path | None,
        typer.Option(metavar="BUILD", help="An older build: compare both instead of measured and simulated."),
    ] = None,
    perception: Annotated[
        Path | None, typer.Option(metavar="MODEL", help="Perception model (JSON) in place of the suite's.")
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="NAME=VALUE", help="A parameter of the model, such as latency.speed=0.4."
        ),
    ] = None,
    seeds: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=5000,
            help="Most runs with the perception model of a recording; with --against, runs of each build.",
        ),
    ] = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Search how far speed, gap, braking or lane_change of the most critical "
            "object can be varied until a KPI flips; may be given several times.",
        ),
    ] = None,
    driven_by: Annotated[
        list[str] | None,
        typer.Option(
            metavar="LABEL", help="Take recordings, too, that this other build drove (or: unknown)."
        ),
    ] = None,
    vehicle: Vehicle = "kinematic",
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; all cores, if not given.")] = None,
    replay: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Repeat the verification.json and say whether it gives the same bytes."
        ),
    ] = None,
) -> None:
    """Cross-verify a build on a suite: does simulation give the measured drives' verdicts?

    With --against: what does the build do otherwise than an older one, in the same scenarios with the same seeds? Ends
    with 1 where a recording is not verified or a limit of the suite is broken, with 2 where a recording is broken or a
    function crashed.
    """
    from resim.execution.workers import in_child
    from resim.results import VERIFICATION, check_output
    from resim.verification.request import VerifyOptions

    count = workers or os.cpu_count() or 1
    if replay is not None:
        if any(given for given in (suite, build, out, against, perception, settings, seeds, vary, driven_by)):
            raise InputError("--replay", "says itself what to repeat", "Give nothing else but --workers.")
        _replay(replay, count)
        return
    if suite is None or build is None or out is None:
        lost = "SUITE" if suite is None else "--build" if build is None else "--out"
        raise InputError(lost, "is missing", "resim verify SUITE --build BUILD --out FOLDER")
    check_output(out, VERIFICATION)
    call = VerifyOptions(
        build,
        against,
        perception,
        tuple(settings or ()),
        seeds,
        tuple(vary or ()),
        tuple(driven_by or ()),
        vehicle,
    )
    _verify(in_child(_asked, (suite, call, out)), out, count)


def _asked(task: tuple[Path, VerifyOptions, Path]) -> VerificationRequest:
    """Read what is asked for in a child process, as builds and criteria bring code."""
    from resim.verification.request import make_request, refuse_others
    from resim.verification.suite import read_suite

    suite, call, out = task
    wanted = make_request(read_suite(suite), call, out)
    refuse_others(wanted, out)
    return wanted


def _asked_again(task: tuple[dict[str, Any], Path]) -> VerificationRequest:
    """Read what was asked for before in a child process."""
    from resim.verification.request import asked_again

    return asked_again(*task)


def _verify(wanted: VerificationRequest, out: Path, workers: int) -> None:
    from resim.cli.verification import print_verification
    from resim.results import locked
    from resim.verification.execution import outcome_code, verify
    from resim.verification.folder import begin, write

    with locked(out, "another `resim verify`"):
        begin(out, wanted)
        with _progress(len(wanted.recordings)) as tell:
            found, traces = verify(
                wanted,
                out,
                out,
                workers=workers,
                tell=tell,
                damaged=_tell_damaged,
                unreported=_tell_unreported,
            )
        write(out, found, traces)
    print_verification(found)
    say("")
    say(f"verification: {out / 'verification.html'}")
    register(out)
    _end(found, outcome_code(found))


def _tell_damaged(path: Path) -> None:
    say(f"{path} is not as `resim verify` wrote it: its recording is run again", err=True)


def _tell_unreported(name: str, reason: str) -> None:
    say(f"{name}: there is no report of its re-simulation: {reason}", err=True)


def _replay(path: Path, workers: int) -> None:
    from resim.execution.workers import in_child
    from resim.results import json_text
    from resim.verification.execution import outcome_code, verify
    from resim.verification.folder import read, text

    before = read(path)
    wanted = in_child(_asked_again, (before["inputs"], path))
    with _progress(len(wanted.recordings)) as tell:
        found, _ = verify(wanted, path.parent, None, workers=workers, tell=tell)
    if text(found) == path.read_text(encoding="utf-8"):
        say(f"{path}: the same bytes again, {len(found['recordings'])} recordings")
        _end(found, outcome_code(found))
        return
    if found["versions"] != before["versions"]:
        other = [f"{n} {v}, now {found['versions'].get(n)}" for n, v in before["versions"].items()
                 if found["versions"].get(n) != v]  # fmt: skip
        say(f"made with other versions: {'; '.join(other)}")
    was = {r["name"]: r for r in before["recordings"]}
    differ = [r["name"] for r in found["recordings"] if json_text(r) != json_text(was.get(r["name"]))]
    raise BadVerdictError(
        f"{path}: not the same bytes; recordings that differ: {', '.join(differ) or 'none'}"
    )


def _end(found: dict[str, Any], code: int) -> None:
    """Leave with the verification's exit code."""
    told = found["summary"]
    if code == 2:
        broken = [r for r in found["recordings"] if r["verdict"] == "error"]
        more = f" (and {len(broken) - 1} more)" if len(broken) > 1 else ""
        raise ResimError(f"{broken[0]['name']}: {broken[0]['error']}{more}")
    if code == 1 and "limits" in told:
        broken_limits = [
            f"{name} {limit['value']:.3g}, at most {limit['limit']:g}"
            for name, limit in told["limits"].items()
            if not limit["kept"]
        ]
        raise BadVerdictError(f"the build regresses: {'; '.join(broken_limits)}")
    if code == 1:
        bad = ("not verified", "undecided", "invalid")
        raise BadVerdictError(", ".join(f"{told[verdict]} {verdict}" for verdict in bad))


@contextmanager
def _progress(total: int) -> Iterator[Told]:
    """A bar on a terminal that counts recordings."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    bar = Progress(
        TextColumn("{task.description:24}", markup=False), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(),
        console=console, transient=True, disable=not console.is_terminal,
    )  # fmt: skip
    with bar:
        task = bar.add_task("start", total=total)

        def tell(name: str, verdict: str, kept: bool) -> None:
            bar.update(task, description=visible(name)[:24], advance=1)

        yield tell
