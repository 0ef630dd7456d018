"""`resim check`: is a recording one that traffic can have produced."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import BadVerdictError, app

if TYPE_CHECKING:
    from collections.abc import Sequence

    from resim.core.finding import Finding


@app.command("check")
def check(
    recording: Annotated[Path, typer.Argument(help="Recording folder (recording.toml, gt, sd).")],
) -> None:
    """Examine a recording: what is wrong with it, what that means for results, and what can be repaired."""
    from resim.check import examine
    from resim.ingest import read_tables
    from resim.road.opendrive import load

    tables = read_tables(recording)
    findings = examine(tables, load(tables.map))
    _print(findings)
    errors = sum(f.severity == "error" for f in findings)
    if errors:
        raise BadVerdictError(f"{recording}: {errors} error(s)")


def _print(findings: Sequence[Finding]) -> None:
    for finding in findings:
        who = f"{finding.source} {finding.object}".rstrip()
        typer.echo(f"{finding.severity:7}  {finding.code}  {who}{_when(finding)}: {finding.text}")
        typer.echo(
            f"         {finding.meaning}" + (f"; --fix would {finding.repair}" if finding.repair else "")
        )
    if not findings:
        typer.echo("nothing found")


def _when(finding: Finding) -> str:
    if math.isnan(finding.start):
        return ""
    if finding.start == finding.end:
        return f" at {finding.start:.2f} s"
    return f" from {finding.start:.2f} to {finding.end:.2f} s"
