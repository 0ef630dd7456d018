"""`resim verify`: can simulation replace the test drives of this build, and how does a new build differ?"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import VEHICLE_HELP, BadVerdictError, Settings, Workers, app, command, vehicle_option
from resim.cli.inputs import A_BUILD, A_MODEL, A_SUITE
from resim.cli.progress import ProgressReporter
from resim.cli.runs import register
from resim.cli.terminal import add_to_json, say
from resim.core.errors import FunctionError, InputError, ResimError
from resim.core.spelling import counted

if TYPE_CHECKING:
    from resim.jobs.verify import Verification, VerificationListener

Seeds = Annotated[
    int | None,
    typer.Option(
        min=1,
        max=5000,
        help="Maximum number of runs with the perception model per recording; with --against: runs of each build.",
    ),
]
Suite = Annotated[
    Path | None, typer.Argument(callback=A_SUITE, help="Suite (TOML): recordings, criteria, tolerances.")
]
BuildOption = Annotated[
    Path | None, typer.Option(callback=A_BUILD, help="Build file (TOML) of the AD function.")
]
Out = Annotated[
    Path | None, typer.Option(help="Folder for the results; an interrupted verification there is resumed.")
]
Against = Annotated[
    Path | None,
    typer.Option(
        metavar="BUILD",
        callback=A_BUILD,
        help="An older build: compare both instead of measured and simulated.",
    ),
]
Perception = Annotated[
    Path | None,
    typer.Option(metavar="MODEL", callback=A_MODEL, help="Perception model (JSON) in place of the suite's."),
]
Replay = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="Repeat the verification of this verification.json, and compare the bytes."
    ),
]
Vary = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME",
        help="Search how far speed, gap, braking or lane_change of the most critical "
        "object can be varied until a KPI flips; may be given several times.",
    ),
]
DrivenBy = Annotated[
    list[str] | None,
    typer.Option(metavar="LABEL", help="Also accept recordings that this other build drove (or: unknown)."),
]


@command(app)
def verify(
    suite: Suite = None,
    build: BuildOption = None,
    out: Out = None,
    against: Against = None,
    perception: Perception = None,
    settings: Settings = None,
    seeds: Seeds = None,
    vary: Vary = None,
    driven_by: DrivenBy = None,
    vehicle: Annotated[str | None, vehicle_option(VEHICLE_HELP, "kinematic")] = None,
    workers: Workers = None,
    replay: Replay = None,
) -> None:
    """Cross-verify a build on a suite: does simulation give the measured drives' verdicts?

    With --against: how does the build differ from an older one, in the same scenarios with the same seeds? Ends
    with 1 where a recording is not verified or a suite limit is exceeded, with 2 where a recording is broken, with
    3 where a function failed.
    """
    if replay is not None:
        _refuse_others(suite, build, out, against, perception, settings, seeds, vary, driven_by, vehicle)
        _replay(replay, workers)
        return
    if suite is None or build is None or out is None:
        lost = "SUITE" if suite is None else "--build" if build is None else "--out"
        raise InputError(lost, "is missing", "resim verify SUITE --build BUILD --out FOLDER")
    _check(suite, perception, settings or (), seeds, vary or ())
    with _progress() as listener:
        from resim.jobs.verify import compare
        from resim.jobs.verify import verify as verify_build
        from resim.verification.request import VerifyOptions

        options = VerifyOptions(
            perception, tuple(settings or ()), seeds, tuple(vary or ()), tuple(driven_by or ()),
            vehicle or "kinematic",
        )  # fmt: skip
        if against is None:
            found = verify_build(suite, build, out, options, workers=workers, listener=listener)
        else:
            found = compare(suite, build, against, out, options, workers=workers, listener=listener)
    from resim.cli.verification import print_verification
    from resim.verification.folder import text

    print_verification(found.report)
    say("")
    say(f"verification: {out / 'verification.html'}")
    add_to_json(out=out, verification=json.loads(text(found.report)))
    register(out)
    _end(found)


def _check(
    suite: Path, perception: Path | None, settings: Sequence[str], seeds: int | None, vary: Sequence[str]
) -> None:
    """Look at the options before anything is imported that takes time. Raises InputError."""
    from resim.verification.suite import check_call, read_suite

    perceives = perception is not None or read_suite(suite).file.perception is not None
    check_call(perceives, settings=settings, seeds=seeds, vary=vary)


def _tell_damaged(path: Path) -> None:
    say(f"{path} is not as `resim verify` wrote it: its recording is simulated again", err=True)


def _tell_unreported(name: str, reason: str) -> None:
    say(f"{name}: there is no report of its re-simulation: {reason}", err=True)


def _refuse_others(*given: object) -> None:
    if any(given):
        raise InputError("--replay", "takes everything from the file", "Give no other option than --workers.")


def _replay(path: Path, workers: int | None) -> None:
    with _progress() as listener:
        from resim.jobs.verify import replay

        again = replay(path, workers=workers, listener=listener)
    if again.same:
        add_to_json(same=True)
        say(f"{path}: identical bytes, {counted(len(again.verification.report.recordings), 'recording')}")
        _end(again.verification)
        return
    add_to_json(same=False, differ=again.differ, versions=again.versions)
    if again.versions:
        say(f"made with other versions: {'; '.join(again.versions)}")
    raise BadVerdictError(
        f"{path}: different bytes; recordings that differ: {', '.join(again.differ) or 'none'}"
    )


def _end(verification: Verification) -> None:
    """Leave with the verification's exit code."""
    from resim.verification.report import ComparisonSummary

    told, code = verification.summary, verification.code
    if code > 1:
        broken = [r for r in verification.report.recordings if r.verdict == "error"]
        more = f" (and {len(broken) - 1} more)" if len(broken) > 1 else ""
        raise (FunctionError if code == 3 else ResimError)(f"{broken[0].name}: {broken[0].error}{more}")
    if code == 1 and isinstance(told, ComparisonSummary):
        broken_limits = [
            f"{name} {limit.value:.3g}, at most {limit.limit:g}"
            for name, limit in told.limits.items()
            if not limit.kept
        ]
        raise BadVerdictError(f"the build regresses: {'; '.join(broken_limits)}")
    if code == 1:
        counts, bad = told.counts(), ("not verified", "undecided", "invalid")
        raise BadVerdictError(", ".join(f"{counts[verdict]} {verdict}" for verdict in bad))


@contextmanager
def _progress() -> Iterator[VerificationListener]:
    """Counts recordings."""
    with ProgressReporter("recordings") as progress:
        from resim.jobs.verify import VerificationListener

        def done(name: str, verdict: str, kept: bool) -> None:
            if kept:
                progress.skip()
            else:
                progress.step(name)

        yield VerificationListener(progress.expect, done, _tell_damaged, _tell_unreported)
