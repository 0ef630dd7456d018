"""`resim assess`: how dangerous was a drive, when, and because of whom."""

from __future__ import annotations

import math
import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import app

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
    mode: Annotated[
        ModeChoice, typer.Option(help="Accident risk: without missed contact, or as published.")
    ] = ModeChoice.continuous,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the samples.")] = 0,
) -> None:
    """Compute criticality measures and the accident risk of a drive, ten times a second."""
    from resim.assess.risk import Parameters
    from resim.pipeline import assess_folder
    from resim.store import ASSESSMENT, check_output, whole_folder, write_assessment

    if out is not None:
        check_output(out, ASSESSMENT)
    found = assess_folder(drive, Parameters(mode=mode.value, seed=seed))
    if out is not None:
        with whole_folder(out, ASSESSMENT) as folder:
            write_assessment(found, folder)
    _print(drive, found)
    if out is not None:
        typer.echo(f"\nassessment: {out / ASSESSMENT.mark}")


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
    if not math.isfinite(worst.value):
        return "beyond any"
    return f"{100.0 * worst.value:.3g} %" if worst.name == "risk" else f"{worst.value:.3g} {worst.unit}"
