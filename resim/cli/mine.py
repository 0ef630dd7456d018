"""`resim mine` and `resim mined`: find the scenarios in recordings, and see what was found."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import Accept, app, command
from resim.cli.terminal import add_to_json, say
from resim.core.spelling import counted

if TYPE_CHECKING:
    from resim.jobs.mine import MiningResult
    from resim.mining.report import MinedFailure
    from resim.mining.study import MinedPart


class WrittenScenarios(StrEnum):
    """What is written of scenarios: recordings and JSCEN files, recordings alone, or rows of a table alone."""

    fitted = "fitted"
    recordings = "recordings"
    rows = "rows"


@command(app, "mine")
def mine(
    recordings: Annotated[list[Path], typer.Argument(help="Recording folders.")],
    out: Annotated[Path, typer.Option(help="Folder to write.")],
    labels: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Thresholds and own labels (TOML); default: scenarios/mining/labels.toml."
        ),
    ] = None,
    around: Annotated[
        str | None,
        typer.Option(
            metavar="WHAT",
            help="Cut out the moments of each recording's own EGO: what others do around it (surroundings), peaks of a "
            "measure (risk, TTC, ...), its decisions (decision), or its maneuvers of a label.",
        ),
    ] = None,
    scenarios: Annotated[
        WrittenScenarios,
        typer.Option(help="What is written of each scenario, beside its row in scenarios.parquet."),
    ] = WrittenScenarios.fitted,
    accept: Accept = None,
) -> None:
    """Find maneuvers in recordings, and cut the scenarios out, as recordings and JSCEN files.

    Writes maneuvers.parquet, scenarios.parquet, recordings/, maps/ with the JSCEN files, and mined.html. A recording
    that cannot be mined is told of, and the others are mined all the same. What the folder holds of recordings
    that were mined alike before is kept.
    """
    from resim.jobs import mine as job

    write, fit = scenarios != WrittenScenarios.rows, scenarios == WrittenScenarios.fitted
    options = job.MineOptions(labels, around, tuple(accept or ()), write, fit, resume=True)
    found = job.mine(recordings, out, options, heard=_tell)
    _print(found)
    say(f"{out}: mined.html, maneuvers.parquet, scenarios.parquet")


@command(app, "mined")
def mined(
    folder: Annotated[Path, typer.Argument(help="Folder that `resim mine` wrote.")],
    label: Annotated[
        list[str] | None,
        typer.Option(metavar="LABEL", help="List the maneuvers of this label; may be given several times."),
    ] = None,
    recording: Annotated[str | None, typer.Option(metavar="NAME", help="Of this recording alone.")] = None,
    scenario: Annotated[
        str | None, typer.Option(metavar="NAME", help="Show this scenario: `resim play` plays its folder.")
    ] = None,
) -> None:
    """Show what `resim mine` found: how many of each label, the maneuvers of a label, a scenario."""
    from resim.jobs import mine as job

    found = job.read_mined(folder)
    if scenario is not None:
        _print_scenario(found, scenario)
    elif label or recording:
        _print_maneuvers(found, label or [], recording)
    else:
        _print(found)


def _tell(told: MinedPart | MinedFailure) -> None:
    from resim.mining.study import MinedPart

    if isinstance(told, MinedPart):
        count = sum(told.labels.values())
        found = f"{counted(count, 'maneuver')}, {counted(told.scenarios, 'scenario')}"
        say(f"{told.recording}: {found}", err=True)
        for note in told.notes:
            say(f"  {note}", err=True)
    else:
        say(f"{told.recording}: not mined: {told.why}", err=True)


def _print(found: MiningResult) -> None:
    for name, count in sorted(found.labels.items()):
        say(f"{count:6}  {name}")
    parts, failures = found.report.parts, found.report.failures
    scenarios = sum(part.scenarios for part in parts)
    mined = f"{counted(len(parts), 'recording')} mined, {len(failures)} not"
    say(f"{mined}; {counted(scenarios, 'scenario')}")
    for failure in failures:
        say(f"not mined: {failure.recording}: {failure.why}")
    add_to_json(labels=found.labels, scenarios=scenarios, recordings=parts, failures=failures)


def _print_maneuvers(found: MiningResult, labels: list[str], recording: str | None) -> None:
    from resim.core.errors import InputError
    from resim.core.spelling import unknown

    for name in labels:
        if name not in found.report.labels:
            raise InputError("--label", unknown("label", name, found.report.labels))
    rows = found.maneuvers
    if labels:
        rows = rows[rows["label"].isin(labels)]
    if recording is not None:
        rows = rows[rows["recording"] == recording]
    for row in rows.to_dict("records"):
        whom = f" with {row['partner']}" if row["partner"] else ""
        one, two = row["lane_from"], row["lane_to"]
        when = f"{row['start']:.2f} to {row['end']:.2f} s, at {row['t']:.2f} s"
        lanes = f"{one}" if one == two else f"{one} to {two}"
        say(f"{row['recording']}  {row['object']}  {row['label']}  {when}, {lanes}{whom}")
    add_to_json(maneuvers=rows.astype(object).where(rows.notna(), None).to_dict("records"))


def _print_scenario(found: MiningResult, name: str) -> None:
    from resim.core.errors import InputError
    from resim.core.spelling import unknown

    rows = found.scenarios
    own = rows[rows["scenario"] == name]
    if not len(own):
        raise InputError("--scenario", unknown("scenario", name, rows["scenario"].tolist()))
    told = own.iloc[0].to_dict()
    for key, value in told.items():
        say(f"{key}: {value}")
    add_to_json(scenario={key: None if value != value else value for key, value in told.items()})
