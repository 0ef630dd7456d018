"""`resim export`: drives in the formats of other tools."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import Accept, Labels, app, command
from resim.cli.terminal import add_to_json, say

if TYPE_CHECKING:
    from resim.jobs.export import ExportReport

exports = typer.Typer(help="Write drives in the formats of other tools.", no_args_is_help=True)
app.add_typer(exports, name="export")


@exports.callback()
def _exports() -> None:
    pass


Drive = Annotated[
    Path,
    typer.Argument(metavar="DRIVE", help="Recording folder, folder that `resim run` wrote, or JSCEN file."),
]
Out = Annotated[Path, typer.Option(help="Folder for the files; an earlier export there is replaced.")]


@command(exports, "openscenario")
def openscenario(
    drive: Drive,
    out: Out,
    version: Annotated[str, typer.Option(help="Of OpenSCENARIO: 1.1, 1.2 or 1.3.")] = "1.2",
    style: Annotated[
        str,
        typer.Option(
            help="trajectory: everybody's trace over time. route: waypoints and speeds, for players that steer."
        ),
    ] = "trajectory",
    accept: Accept = None,
) -> None:
    """Write every source of a drive as OpenSCENARIO: everybody follows its trace, or drives its route."""
    from resim.jobs.export import export_openscenario

    _tell(out, export_openscenario(drive, out, version=version, style=style, accept=accept or []))


@command(exports, "osi")
def osi(drive: Drive, out: Out, accept: Accept = None) -> None:
    """Write every source of a drive as a trace of OSI (.osi): GroundTruth, and SensorData of what sensors saw."""
    _export("osi", drive, out, accept)


@command(exports, "mcap")
def mcap(drive: Drive, out: Out, accept: Accept = None) -> None:
    """Write all of a drive as one MCAP file: OSI with the map, scenes of Foxglove, plans, risk and verdicts."""
    _export("mcap", drive, out, accept)


@command(exports, "foxglove")
def foxglove(drive: Drive, out: Out, accept: Accept = None) -> None:
    """Write scenes, curves and what happened as one MCAP file, and a layout for Foxglove and Lichtblick."""
    _export("foxglove", drive, out, accept)


@command(exports, "rosbag")
def rosbag(drive: Drive, out: Out, accept: Accept = None) -> None:
    """Write a drive as rosbag2: odometry, objects in Autoware's messages, plans, boxes for RViz, verdicts."""
    _export("rosbag", drive, out, accept)


@command(exports, "openlabel")
def openlabel(drive: Drive, out: Out, labels: Labels = None, accept: Accept = None) -> None:
    """Write every source of a drive as OpenLABEL: objects, decisions, what happened, and tags with the verdict."""
    _export("openlabel", drive, out, accept, labels)


@command(exports, "rocrate")
def rocrate(
    results: Annotated[
        Path,
        typer.Argument(
            help="Folder that run, assess, map convert, verify, sweep, vary, mine or space wrote."
        ),
    ],
    out: Out,
) -> None:
    """Write a folder of results as an RO-Crate: its files, what made them, and from what."""
    from resim.jobs.export import export_rocrate

    found = export_rocrate(results, out)
    add_to_json(out=out, files=len(found.files))
    say(f"{found.drive}: {found.format}: {len(found.files)} files: {out}")


def _export(form: str, drive: Path, out: Path, accept: list[str] | None, labels: Path | None = None) -> None:
    from resim.jobs.export import export_drive

    _tell(out, export_drive(drive, out, form, accept=accept or [], labels=labels))


def _tell(out: Path, found: ExportReport) -> None:
    add_to_json(out=out, sources=found.sources, map=found.map, notes=found.notes)
    files = dict.fromkeys(found.sources.values())
    for note in found.notes:
        say(f"note: {note}")
    say(f"{found.drive}: {found.format}: {', '.join(files)}; map {found.map}: {out}")
