"""The recipes that ship: one for each kind of the catalogs or a reason, made without findings and without overlaps."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scenario.generation.appendix_1 import ROWS

from resim.core.overlaps import first_overlaps
from resim.jobs.generate import generate_recording, recipes_in
from resim.recordings import read_recording
from resim.road.opendrive import load
from resim.scenario.generation.generate import generate
from resim.scenario.generation.recipe import read_recipe
from resim.scenario.scenario import describe

ROOT = Path(__file__).parents[3]
CATALOG = ROOT / "scenarios" / "catalog"
RECIPES = recipes_in([CATALOG / "generate"])


def test_each_kind_of_the_catalogs_has_a_recipe_or_a_reason() -> None:
    made = [kind for path in RECIPES for kind in read_recipe(path).kinds]
    left = [one["kind"] for one in tomllib.loads((CATALOG / "not_generated.toml").read_text("utf-8"))["kind"]]
    assert len(ROWS) == len(set(ROWS)) == 143
    assert sorted([*made, *left]) == sorted(ROWS)


def test_the_recipes_are_what_the_tool_writes() -> None:
    words = "import make_recipes as m; [print(n, hash_(r.text())) for n, r in m.recipes().items()]"
    words = f"from zlib import crc32; hash_ = lambda text: crc32(text.encode()); {words}"
    said = subprocess.run(
        [sys.executable, "-c", words], cwd=ROOT / "tools", capture_output=True, text=True, check=True
    )
    from zlib import crc32

    assert sorted(said.stdout.splitlines()) == sorted(f"{p.stem} {crc32(p.read_bytes())}" for p in RECIPES)


@pytest.mark.parametrize("path", RECIPES, ids=lambda path: path.stem)
def test_a_recipe_is_made_without_findings(path: Path, tmp_path: Path) -> None:
    made = generate_recording(path, tmp_path / path.stem)  # refuses findings and overlaps
    recipe = read_recipe(path)
    assert made.objects == len(recipe.object)
    drive = generate(recipe, load(recipe.map_file(path)))
    pairs = {
        frozenset((str(drive.tracks.ids[n]), str(drive.tracks.ids[m])))
        for n, m, _ in first_overlaps(drive.tracks)
    }
    assert pairs == {frozenset(pair) for pair in recipe.overlaps}


@pytest.mark.parametrize("path", RECIPES[::8], ids=lambda path: path.stem)
def test_a_recipe_is_described_as_exactly_as_a_scenario_can(path: Path, tmp_path: Path) -> None:
    generate_recording(path, tmp_path / path.stem)
    recording = read_recording(tmp_path / path.stem)
    network = load(recording.map)
    gt = recording.gt
    told = describe(gt, network, ego=recording.ego, map_name=recording.map.name).tracks(network, gt.t)
    told = told.select(gt.ids)
    assert np.nanmax(np.hypot(told.x - gt.x, told.y - gt.y)) < 0.25
