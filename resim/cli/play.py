"""`resim play`: see a drive."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from resim.cli.app import app, command
from resim.cli.terminal import add_to_json, say
from resim.core import remedies
from resim.core.errors import InputError


@command(app)
def play(
    drives: Annotated[
        list[Path],
        typer.Argument(
            metavar="DRIVE...",
            help="Recording folders, folders that `resim run` or `resim vary` wrote, or JSCEN files.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="HTML file to write; default: play.html in the current folder."),
    ] = None,
    assess: Annotated[
        bool, typer.Option("--assess", help="Assess recordings, for curves of risk and TTC; takes longer.")
    ] = False,
    together: Annotated[
        bool,
        typer.Option("--together", help="Show all above each other, with their curves; they are on one map."),
    ] = False,
    video: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Film the first drive, too: .mp4 or .gif; needs chromium and playwright."
        ),
    ] = None,
) -> None:
    """Write a page that plays drives: from above, with curves and marks.

    A recording is shown with all its findings, also those that `resim run` refuses.
    """
    for path in drives:
        if not path.exists():
            raise InputError(path, "there is no such file or folder", remedies.PLAYED)
    if assess and not any((path / "recording.toml").is_file() for path in drives):
        problem = "assesses recordings, and none is given; the folder of a run has its curves already"
        raise InputError("--assess", problem, "Leave it out.")
    from resim.jobs.play import play as job

    target = out or Path("play.html")
    played = job(drives, target, assess=assess, above=together, video=video)
    for drive in played:
        objects = {name for layer in drive.layers for name in layer.tracks.ids.tolist()} - {drive.ego}
        layers = ", ".join(layer.name for layer in drive.layers)
        say(f"{drive.name}: {layers}; {len(objects)} traffic objects, {len(drive.marks)} marks")
    add_to_json(player=target, video=video)
    say(f"player: {target} ({target.stat().st_size / 1e6:.2f} MB)")
    if video is not None:
        say(f"video: {video} ({video.stat().st_size / 1e6:.2f} MB)")
