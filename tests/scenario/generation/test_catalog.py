"""The recipes that ship: one for each kind of the catalogs or a reason, made without findings and without overlaps."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

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


def _tool() -> ModuleType:
    """tools/validate_kinds.py, which compares all recipes in `make validate`."""
    spec = spec_from_file_location("validate_kinds", ROOT / "tools" / "validate_kinds.py")
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules["validate_kinds"] = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


TOOL = _tool()


def test_recipes_and_queries_are_of_the_same_rows() -> None:
    kinds = TOOL.kinds_by_row()
    assert sorted(kinds) == sorted(row.lower() for row in ROWS)
    made = {kind.lower() for path in RECIPES for kind in read_recipe(path).kinds}
    left = tomllib.loads((CATALOG / "not_generated.toml").read_text("utf-8"))["kind"]
    without = {one["kind"].lower() for one in left}
    for row, kind in kinds.items():
        if kind.find is not None:
            assert (row in made) != (row in without), row
    assert all(len(one["reason"]) > 20 for one in left)
    # what a recipe shows and no list can tell: things that lists do not name
    untold = {kind.name for row, kind in kinds.items() if kind.find is None and row in made}
    assert all("animal" in name.lower() or name == "Avoiding construction zone" for name in untold)


@pytest.mark.parametrize("path", RECIPES[3::16], ids=lambda path: path.stem)
def test_a_recipe_is_found_by_the_queries_of_its_kinds(path: Path, tmp_path: Path) -> None:
    told = list(TOOL.shown(path, TOOL.kinds_by_row(), tmp_path))
    assert told
    assert all(one.found is None or one.found > 0 for one in told)


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
