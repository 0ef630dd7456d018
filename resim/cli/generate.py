"""`resim generate`: recordings of recipes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from resim.cli.app import app, command
from resim.cli.terminal import add_to_json, say


@command(app, "generate")
def generate(
    recipes: Annotated[
        list[Path], typer.Argument(metavar="RECIPE...", help="Recipes (TOML), or folders of recipes.")
    ],
    out: Annotated[
        Path, typer.Option(help="New folder for the recording; of several recipes, for a recording each.")
    ],
) -> None:
    """Make recordings of recipes: objects with routes, lane changes and speeds, and the truth of what they do."""
    from resim.jobs.generate import generate_recording, recipes_in

    found = recipes_in(recipes)
    several = len(found) > 1 or any(path.is_dir() for path in recipes)
    made = [generate_recording(path, out / path.stem if several else out) for path in found]
    add_to_json(recordings=[one.folder for one in made], truth=[one.truth.to_dict("records") for one in made])
    for one in made:
        labels = ", ".join(f"{row.object} {row.label}" for row in one.truth.itertuples()) or "no maneuvers"
        say(f"{one.recipe.name}: {one.objects} objects, {one.samples} samples; {labels}: {one.folder}")
