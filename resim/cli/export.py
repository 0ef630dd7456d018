"""`resim export`: drives in the formats of other tools."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from resim.cli.app import Accept, app, command
from resim.cli.terminal import add_to_json, say

exports = typer.Typer(help="Write drives in the formats of other tools.", no_args_is_help=True)
app.add_typer(exports, name="export")


@exports.callback()
def _exports() -> None:
    pass


@command(exports, "openscenario")
def openscenario(
    drive: Annotated[
        Path,
        typer.Argument(
            metavar="DRIVE", help="Recording folder, folder that `resim run` wrote, or JSCEN file."
        ),
    ],
    out: Annotated[Path, typer.Option(help="Folder for the files; an earlier export there is replaced.")],
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

    found = export_openscenario(drive, out, version=version, style=style, accept=accept or [])
    add_to_json(out=out, sources=found.sources, map=found.map)
    say(f"{found.drive}: {found.format}: {', '.join(found.sources.values())}; map {found.map}: {out}")
