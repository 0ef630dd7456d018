"""`resim assess`: how dangerous was a drive, when, and because of whom."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import BadVerdictError, app

if TYPE_CHECKING:
    from collections.abc import Mapping

    from resim.assess.assessment import Assessment, Worst


class ModeChoice(StrEnum):
    """How the accident risk is computed."""

    continuous = "continuous"
    published = "published"


@app.command("assess")
def assess(
    drive: Annotated[Path, typer.Argument(help="Recording folder, or the folder that `resim run` wrote.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder for assessment.json; an earlier one there is replaced.")
    ] = None,
    criteria: Annotated[
        Path | None,
        typer.Option(help="Criteria (TOML) to judge by, such as scenarios/criteria/highway.toml."),
    ] = None,
    mode: Annotated[
        ModeChoice, typer.Option(help="Accident risk: without missed contact, or as published.")
    ] = ModeChoice.continuous,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the samples.")] = 0,
) -> None:
    """Compute criticality measures and the accident risk of a drive, ten times a second, and judge it by criteria.

    Ends with 1 where a criterion fails, or cannot be judged.
    """
    from resim.assess.assessment import KNOWN
    from resim.assess.criteria import overall, read_criteria
    from resim.assess.risk import Parameters
    from resim.pipeline import assess_folder
    from resim.store import ASSESSMENT, check_output, whole_folder, write_assessment

    if out is not None:
        check_output(out, ASSESSMENT)
    wanted = None if criteria is None else read_criteria(criteria, KNOWN)
    found = assess_folder(drive, Parameters(mode=mode.value, seed=seed), wanted)
    if out is not None:
        with whole_folder(out, ASSESSMENT) as folder:
            write_assessment(found, folder)
    _print(drive, found)
    if out is not None:
        typer.echo(f"\nassessment: {out / ASSESSMENT.mark}")
    if wanted is not None:
        _print_verdicts(found)
        if bad := [name for name, assessment in found.items() if overall(assessment.verdicts) != "PASS"]:
            raise BadVerdictError(f"{drive}: does not pass {wanted.name!r}: {', '.join(bad)}")


def _print(drive: Path, found: Mapping[str, Assessment]) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(title=f"{drive.name}: the worst of each measure, when, and because of whom")
    table.add_column("measure")
    rows: dict[str, list[str]] = {}
    for number, (name, assessment) in enumerate(found.items()):
        table.add_column(name, justify="right")
        for worst in assessment.worst():
            whom = f", {worst.object}" if worst.object else ""
            rows.setdefault(worst.name, ["–"] * len(found))[number] = (
                f"{_amount(worst)} at {worst.t:.1f} s{whom}"
            )
    for name, cells in rows.items():
        table.add_row(name, *cells)
    Console(width=None if sys.stdout.isatty() else 120).print(table)


def _amount(worst: Worst) -> str:
    from resim.assess.criteria import amount

    return f"{100.0 * worst.value:.3g} %" if worst.name == "risk" else amount(worst.value, worst.unit)


def _print_verdicts(found: Mapping[str, Assessment]) -> None:
    """Criteria against sources; below, why those that did not pass did not."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title="verdicts")
    table.add_column("criterion")
    for name in found:
        table.add_column(name)
    for criterion in next(iter(found.values())).verdicts:
        table.add_row(criterion, *(a.verdicts[criterion].outcome for a in found.values()))
    console = Console(width=None if sys.stdout.isatty() else 120)
    console.print(table)
    for name, assessment in found.items():
        for verdict in assessment.verdicts.values():
            if verdict.outcome != "PASS":
                at = (
                    ""
                    if verdict.t is None
                    else f", worst {verdict.value:.3g} {verdict.unit} at {verdict.t:.1f} s"
                )
                whom = f" ({verdict.object})" if verdict.object else ""
                line = f"{name}: {verdict.outcome} {verdict.criterion}: {verdict.reason}{at}{whom}"
                console.print(line, highlight=False)
