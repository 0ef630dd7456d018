"""`resim check`: is a recording one that traffic can have produced; and a repaired copy of it."""

from __future__ import annotations

import math
import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import BadVerdictError, app, command
from resim.cli.inputs import RecordingFolder
from resim.cli.terminal import add_to_json, output_settings, say

if TYPE_CHECKING:
    from collections.abc import Sequence

    from resim.core.finding import Finding
    from resim.jobs.check import CheckResult
    from resim.recordings.repairs import AppliedRepair, Repaired

MOST_LINES = 5
"""Findings of one code and source that are printed, without --verbose; the rest is counted."""


@command(app, "check")
def check(
    recording: RecordingFolder,
    fix: Annotated[
        Path | None,
        typer.Option(metavar="OUT", help="Write a repaired copy to this new folder, and judge the copy."),
    ] = None,
    max_gap: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="Longest gap to fill [s]; default: 1."),
    ] = None,
    outliers: Annotated[
        str | None,
        typer.Option(
            metavar="FILTER", help="Method that detects outliers: robust (default) or moving-average."
        ),
    ] = None,
) -> None:
    """Examine a recording: what is wrong with it, what that means for results, and what can be repaired.

    Of findings that are alike the first five are printed, with --verbose all. Ends with 1 where errors are found; with
    --fix, where errors are left. The recording itself is never touched.
    """
    from resim.core.errors import InputError
    from resim.jobs import check as job

    for name, value in (("--max-gap", max_gap), ("--outliers", outliers)):
        if fix is None and value is not None:
            raise InputError(name, "sets how to repair, but --fix is missing", "Give --fix OUT too.")
    if fix is None:
        found = job.check(recording)
        print_findings(found.findings)
        add_to_json(findings=found.findings)
    else:
        gap = job.MAX_GAP if max_gap is None else max_gap
        found = job.repair(recording, fix, max_gap=gap, outliers=outliers or "robust")
        print_findings(found.findings)
        add_to_json(out=fix, findings=found.findings)
        if found.repaired is not None:
            add_to_json(repaired=found.repaired.done, left=found.repaired.left)
            _print_repaired(found.repaired)
        say(f"{fix}: written")
    add_to_json(map=found.map, flaws=found.flaws)
    _print_map(found)
    if found.errors:
        where = recording if fix is None else fix
        raise BadVerdictError(f"{where}: {found.errors} error(s)" + ("" if fix is None else " left"))


def _print_map(found: CheckResult) -> None:
    """Print the errors of the recording's map, which stop a run as well."""
    for flaw in found.flaws[: _most()]:
        say(f"error    {flaw.code}  map {found.map.name}: {flaw.text}")
    if len(found.flaws) > _most():
        say(f"... and {len(found.flaws) - _most()} more errors in the map: see `resim map check`")


def print_findings(findings: Sequence[Finding]) -> None:
    """The findings, worst first, of one kind together where the first of it stands."""
    count = Counter(_kind(f) for f in findings)
    for kind in dict.fromkeys(map(_kind, findings)):
        some = [f for f in findings if _kind(f) == kind]
        for finding in some[: _most()]:
            _print_one(finding)
        if count[kind] > _most():
            severity, code, source = kind
            say(f"{severity:7}  {code}  {source}: ... and {count[kind] - _most()} more of this code")
    if not findings:
        say("nothing found")


def _most() -> int:
    return sys.maxsize if output_settings().verbose else MOST_LINES


def _kind(finding: Finding) -> tuple[str, str, str]:
    return finding.severity, finding.code, finding.source


def _print_one(finding: Finding) -> None:
    who = f"{finding.source} {finding.object}".rstrip()
    say(f"{finding.severity:7}  {finding.code}  {who}{_when(finding)}: {finding.text}")
    say(f"         {finding.meaning}" + (f"; --fix would {finding.repair}" if finding.repair else ""))


def _print_repaired(repaired: Repaired) -> None:
    from resim.recordings.repairs import JUDGED

    say("")
    for done in repaired.done:
        doubt = f"; {JUDGED[done.code]}" if done.code in JUDGED else ""
        say(f"repaired {done.code}  {done.source}: {_amount(done)}{doubt}")
    if not repaired.done:
        say("repaired nothing")
    say("")
    say("left:")
    print_findings(repaired.left)


def _amount(done: AppliedRepair) -> str:
    whole = "" in done.objects
    who = "the whole table" if whole else f"{len(done.objects)} object(s)"
    counts = {"changed": done.count.changed, "added": done.count.added, "left out": done.count.removed}
    return f"{who}, samples: {', '.join(f'{n} {what}' for what, n in counts.items() if n)}"


def _when(finding: Finding) -> str:
    if math.isnan(finding.start):
        return ""
    if finding.start == finding.end:
        return f" at {finding.start:.2f} s"
    return f" from {finding.start:.2f} to {finding.end:.2f} s"
