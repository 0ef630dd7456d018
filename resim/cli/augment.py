"""`resim augment`: variations of a recording by chance."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from resim.cli.app import app, command
from resim.cli.terminal import add_to_json, say


@command(app, "augment")
def augment(
    recording: Annotated[Path, typer.Argument(metavar="RECORDING", help="Recording folder.")],
    out: Annotated[Path, typer.Option(help="New folder; each variation is a folder in it.")],
    count: Annotated[int, typer.Option(min=1, help="How many variations.")] = 10,
    settings: Annotated[
        Path | None,
        typer.Option(
            help="What varies, and by how much (TOML); default: that of Kaefer 2022.", show_default=False
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of all draws.")] = 1,
) -> None:
    """Vary a recording by chance: paths, speeds, vehicles, colours, time of day and weather."""
    from resim.jobs.augment import augment as job

    made = job(recording, out, count=count, settings=settings, seed=seed)
    add_to_json(recordings=[one.folder for one in made], draws=[one.draws for one in made])
    more = sum(one.draws - 1 for one in made)
    say(f"{len(made)} variations of {recording}, {more} draws left out: {out}")
