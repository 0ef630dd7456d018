"""Make recordings of recipes: what `resim generate` does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from resim.core.errors import InputError, ResimError
from resim.core.files import file_hash
from resim.core.finding import Finding
from resim.jobs.given import path_of
from resim.recordings import Recording, RecordingTables, write_recording
from resim.recordings.checks import CODES, examine
from resim.results import whole_file
from resim.road.opendrive import RoadNetwork, load
from resim.scenario.generation.generate import GeneratedDrive, generate
from resim.scenario.generation.recipe import Recipe, read_recipe
from resim.scenario.generation.truth import truth_table

TRUTH = "truth.csv"
"""The table of truth in the folder of a recording."""
REMEDY = "Name a recipe (TOML), or a folder of recipes; docs/guides/generate.md shows one."


@dataclass(frozen=True)
class GeneratedRecording:
    """A recording that was made of a recipe.

    Attributes:
        recipe: File.
        folder: Of the recording.
        truth: Its maneuvers, a row each.
        objects: How many it has.
        samples: How many times it has.
    """

    recipe: Path
    folder: Path
    truth: pd.DataFrame
    objects: int
    samples: int


def generate_recording(recipe: str | Path, out: str | Path) -> GeneratedRecording:
    """Make the recording of a recipe, with its table of truth beside it (`truth.csv`).

    Args:
        recipe: TOML file.
        out: A new folder.

    Returns:
        What was made.

    Raises:
        InputError: The recipe is wrong, makes a drive in which objects overlap or that `resim check` finds faults in,
            or the folder is there already.
    """
    path, folder = path_of(recipe), path_of(out)
    told = read_recipe(path)
    _refuse_codes(path, told)
    road = told.map_file(path)
    network = load(road)
    try:
        drive = generate(told, network)
    except ResimError as e:
        raise InputError(path, str(e)) from e
    recording = _recording(path, told, road, drive, folder.name)
    _refuse_findings(path, told, recording, network)
    write_recording(recording, folder)
    truth = truth_table(folder.name, drive.maneuvers)
    with whole_file(folder / TRUTH, None) as beside:
        truth.to_csv(beside, index=False, lineterminator="\n")
    return GeneratedRecording(path, folder, truth, len(drive.tracks), len(drive.tracks.t))


def recipes_in(paths: Sequence[str | Path]) -> list[Path]:
    """Give the recipes that are meant: files, and all TOML files of folders, by name.

    Args:
        paths: Files and folders.

    Returns:
        The recipes' files.

    Raises:
        InputError: There is none.
    """
    out: list[Path] = []
    for path in map(path_of, paths):
        found = sorted(path.glob("*.toml")) if path.is_dir() else [path]
        if not found:
            raise InputError(path, "holds no recipe", REMEDY)
        out += found
    return out


def _refuse_codes(path: Path, recipe: Recipe) -> None:
    if unknown := [code for code in recipe.accept if code not in CODES]:
        problem = f"accept: {unknown[0]!r} is no code of `resim check`"
        raise InputError(path, problem, "docs/reference/findings.md has all.")


def _recording(path: Path, recipe: Recipe, road: Path, drive: GeneratedDrive, name: str) -> Recording:
    colors = ", ".join(f"{one.id} {one.color}" for one in recipe.object)
    provenance = {
        "description": recipe.description or name,
        "source": f"resim generate {path.name}, SHA-256 {file_hash(path)}",
        "map": f"{road.name}, SHA-256 {file_hash(road)}",
        "colors": colors,
    }
    if recipe.kinds:
        provenance["kinds"] = "; ".join(recipe.kinds)
    return Recording(
        name=name, map=road, ego=recipe.ego, gt=drive.tracks, gt_rate=recipe.rate,
        environment={str(key): told for key, told in recipe.environment.items()}, provenance=provenance,
    )  # fmt: skip


def _refuse_findings(path: Path, recipe: Recipe, recording: Recording, network: RoadNetwork) -> None:
    """Refuse a drive in which `resim check` finds what the recipe did not ask for."""
    found: list[Finding] = [
        one for one in examine(RecordingTables.of(recording), network) if one.code not in recipe.accept
    ]
    if found:
        worst = found[0]
        problem = (
            f"object {worst.object!r} {worst.text} ({worst.code}, from {worst.start:g} to {worst.end:g} s)"
        )
        remedy = f'Change its route or speed, or ask for it by accept = ["{worst.code}"].'
        raise InputError(path, problem, remedy)
