"""Recipes that ship run in closed loop; all of them in `make validate`."""

from __future__ import annotations

from pathlib import Path

import pytest

from resim.jobs.generate import generate_recording, recipes_in
from resim.jobs.resimulate import resimulate
from resim.scenario.generation.recipe import read_recipe

ROOT = Path(__file__).parents[3]
RECIPES = recipes_in([ROOT / "scenarios" / "catalog" / "generate"])
BUILDS = [ROOT / "adfunc" / "builds" / f"{name}-1.0.toml" for name in ("highway_pilot", "idm")]


def runs(path: Path, build: Path, folder: Path) -> None:
    generate_recording(path, folder)
    result = resimulate(folder, build, accept=read_recipe(path).accept)
    assert not result.resimulation.failure


@pytest.mark.parametrize("number", range(0, len(RECIPES), 16))
def test_some_recipes_run(number: int, tmp_path: Path) -> None:
    runs(RECIPES[number], BUILDS[number // 16 % 2], tmp_path / "drive")


@pytest.mark.slow
@pytest.mark.parametrize("path", RECIPES, ids=lambda path: path.stem)
@pytest.mark.parametrize("build", BUILDS, ids=lambda build: build.stem)
def test_all_recipes_run(path: Path, build: Path, tmp_path: Path) -> None:
    runs(path, build, tmp_path / "drive")
