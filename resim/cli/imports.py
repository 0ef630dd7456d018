"""`resim import`: recordings of other formats become recording folders."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from resim.cli.app import app
from resim.cli.terminal import say

if TYPE_CHECKING:
    from resim.recordings import Recording

imports = typer.Typer(
    help="Turn a recording of another format into a recording folder.", no_args_is_help=True
)
app.add_typer(imports, name="import")


Map = Annotated[Path, typer.Option("--map", help="OpenDRIVE map of the recording.")]
Ego = Annotated[str, typer.Option(help="Id of the object that becomes the EGO.")]
Start = Annotated[float | None, typer.Option(help="First time [s]; from the EGO's first, if not given.")]
End = Annotated[float | None, typer.Option(help="Last time [s]; to the EGO's last, if not given.")]
Out = Annotated[Path, typer.Option(help="Recording folder to write.")]


@imports.command("highd")
def import_highd(
    tracks: Annotated[
        Path, typer.Argument(help="XX_tracks.csv of highD, exiD, inD or rounD; its meta files beside it.")
    ],
    map_file: Map,
    ego: Ego,
    out: Out,
    start: Start = None,
    end: End = None,
    alignment: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="X Y HEADING", help="Pose of the data's frame in the map [m m rad], if it is another."
        ),
    ] = None,
) -> None:
    """Import from CSV of the highD family (highD, exiD, inD, rounD)."""
    from resim.recordings import Alignment, read_highd

    pose = Alignment(*alignment) if alignment else None
    _write(read_highd(tracks, map=map_file, ego=ego, start=start, end=end, alignment=pose), out)


@imports.command("commonroad")
def import_commonroad(
    scenario: Annotated[Path, typer.Argument(help="CommonRoad scenario, XML of 2018a or 2020a.")],
    map_file: Map,
    ego: Ego,
    out: Out,
    start: Start = None,
    end: End = None,
) -> None:
    """Import from a CommonRoad scenario."""
    from resim.recordings import read_commonroad

    _write(read_commonroad(scenario, map=map_file, ego=ego, start=start, end=end), out)


def _write(recording: Recording, out: Path) -> None:
    from resim.recordings import write_recording
    from resim.road.opendrive import load

    load(recording.map)  # a file that is no OpenDRIVE is told of now, not when the recording is run
    write_recording(recording, out)
    span = recording.gt.t[-1] - recording.gt.t[0]
    say(f"{out}: {len(recording.gt)} objects over {span:.2f} s, EGO {recording.ego}")
