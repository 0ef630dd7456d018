"""Write the recipes in scenarios/catalog/generate/: one for each kind of Kaefer's catalogs that objects can express.

    python tools/make_recipes.py

Kaefer 2022, Appendix 1. What cannot be expressed is in scenarios/catalog/not_generated.toml, with the reason.
"""

from __future__ import annotations

import sys
from pathlib import Path

from recipe_parts import RecipeText
from recipes_around import around_recipes
from recipes_junction import junction_recipes
from recipes_road import road_recipes

HERE = Path(__file__).resolve().parents[1]
FOLDER = HERE / "scenarios" / "catalog" / "generate"


def recipes() -> dict[str, RecipeText]:
    """Every recipe by its file name."""
    made = [*road_recipes(), *around_recipes(), *junction_recipes()]
    by_name = {one.name: one for one in made}
    assert len(by_name) == len(made)
    return by_name


def main() -> int:
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name, one in recipes().items():
        (FOLDER / f"{name}.toml").write_text(one.text(), encoding="utf-8")
    print(f"{FOLDER.relative_to(HERE)}: {len(recipes())} recipes")
    return 0


if __name__ == "__main__":
    sys.exit(main())
