"""`resim mine` and `resim mined`: find the scenarios in recordings, and see what was found."""

from __future__ import annotations

from collections.abc import Hashable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import Accept, Labels, Workers, app, command
from resim.cli.runs import register
from resim.cli.terminal import add_to_json, output_settings, say
from resim.core.errors import InputError
from resim.core.spelling import counted, unknown

if TYPE_CHECKING:
    import pandas as pd

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
    labels: Labels = None,
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
    workers: Workers = None,
    accept: Accept = None,
) -> None:
    """Find maneuvers in recordings, and cut the scenarios out, as recordings and JSCEN files.

    Writes maneuvers.parquet, scenarios.parquet, recordings/, maps/ with the JSCEN files, and mined.html. A recording
    that cannot be mined is told of, and the others are mined all the same. What the folder holds of recordings
    that were mined alike before is kept, and what a call that was stopped left behind is resumed.
    """
    from resim.jobs import mine as job

    write, fit = scenarios != WrittenScenarios.rows, scenarios == WrittenScenarios.fitted
    options = job.MineOptions(labels, around, tuple(accept or ()), write, fit, resume=True, workers=workers)
    found = job.mine(recordings, out, options, heard=_tell)
    _print(found)
    say(f"{out}: mined.html, maneuvers.parquet, scenarios.parquet")
    register(out)


@command(app, "mined")
def mined(
    folder: Annotated[Path, typer.Argument(help="Folder that `resim mine` wrote.")],
    label: Annotated[
        list[str] | None,
        typer.Option(metavar="LABEL", help="List the maneuvers of this label; may be given several times."),
    ] = None,
    recording: Annotated[str | None, typer.Option(metavar="NAME", help="Of this recording alone.")] = None,
    scenario: Annotated[str | None, typer.Option(metavar="NAME", help="Show this scenario.")] = None,
    scenarios: Annotated[
        bool,
        typer.Option(
            "--scenarios", help="List scenarios, of these labels and this recording alone if given."
        ),
    ] = False,
    picture: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw --scenario from above into this SVG file.")
    ] = None,
    player: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write a page that plays --scenario.")
    ] = None,
) -> None:
    """Show what `resim mine` found: how many of each label, maneuvers, scenarios, one scenario as picture or player."""
    from resim.jobs import mine as job

    if scenario is None and (given := "--picture" if picture else "--player" if player else None):
        raise InputError(given, "is of one scenario, and none is named", "Name it with --scenario.")
    found = job.read_mined(folder)
    if scenario is not None:
        _print_scenario(found, scenario)
        _show(found, scenario, picture, player)
    elif scenarios:
        _print_scenarios(found, label or [], recording)
    elif label or recording:
        _print_maneuvers(found, label or [], recording)
    else:
        _print(found)


def _show(found: MiningResult, name: str, picture: Path | None, player: Path | None) -> None:
    from resim.jobs import mine as job

    if picture is not None:
        job.draw_scenario(found, name, picture)
        say(f"picture: {picture}")
    if player is not None:
        job.play_scenario(found, name, player)
        say(f"player: {player}")
    add_to_json(picture=picture, player=player)


def _tell(told: MinedPart | MinedFailure) -> None:
    from resim.mining.study import MinedPart

    if isinstance(told, MinedPart):
        if output_settings().quiet:
            return
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


def _of(
    rows: pd.DataFrame, found: MiningResult, labels: list[str], recording: str | None, column: str
) -> pd.DataFrame:
    """Keep rows with one of the labels in a column, and of a recording. Raises InputError for one there is not."""
    for name in labels:
        if name not in found.report.labels:
            raise InputError("--label", unknown("label", name, found.report.labels))
    known = [part.recording for part in found.report.parts]
    if recording is not None and recording not in known:
        raise InputError("--recording", unknown("recording", recording, known))
    if labels:
        rows = rows[[bool({*told.split()} & {*labels}) for told in rows[column].tolist()]]
    return rows if recording is None else rows[rows["recording"] == recording]


def _plain(rows: pd.DataFrame) -> list[dict[Hashable, object]]:
    """Rows for JSON: what is missing is null."""
    return rows.astype(object).where(rows.notna(), None).to_dict("records")


def _print_scenarios(found: MiningResult, labels: list[str], recording: str | None) -> None:
    rows = _of(found.scenarios, found, labels, recording, "labels")
    for row in rows.to_dict("records"):
        when = f"{row['start']:.2f} to {row['end']:.2f} s"
        where = f"road {row['road'] or '–'}, {counted(row['lanes'], 'lane')}, {counted(row['vehicles'], 'vehicle')}"
        say(f"{row['scenario']}  {row['labels']}  {when}, {where}")
    say(counted(len(rows), "scenario"))
    add_to_json(scenarios=_plain(rows))


def _print_maneuvers(found: MiningResult, labels: list[str], recording: str | None) -> None:
    rows = _of(found.maneuvers, found, labels, recording, "label")
    for row in rows.to_dict("records"):
        whom = f" with {row['partner']}" if row["partner"] else ""
        one, two = row["lane_from"], row["lane_to"]
        when = f"{row['start']:.2f} to {row['end']:.2f} s, at {row['t']:.2f} s"
        lanes = f"{one}" if one == two else f"{one} to {two}"
        say(f"{row['recording']}  {row['object']}  {row['label']}  {when}, {lanes}{whom}")
    add_to_json(maneuvers=_plain(rows))


def _print_scenario(found: MiningResult, name: str) -> None:
    rows = found.scenarios
    own = rows[rows["scenario"] == name]
    if not len(own):
        raise InputError("--scenario", unknown("scenario", name, rows["scenario"].tolist()))
    told = own.iloc[0].to_dict()
    for key, value in told.items():
        say(f"{key}: {value}")
    add_to_json(scenario={key: None if value != value else value for key, value in told.items()})
