"""Every recipe in scenarios/catalog/generate/, generated and mined: does the query of each kind that it shows find it?

    python tools/validate_kinds.py [RECIPE ...]     all, or those of these names

Writes the table of docs/validation.md; ends with 1 where a kind with a query is not found.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from resim.core.errors import ResimError
from resim.jobs.generate import generate_recording
from resim.jobs.mine import MineOptions, mine
from resim.mining.catalog import ScenarioKind, matching, read_kinds
from resim.recordings.checks.codes import CODES
from resim.scenario.generation.recipe import read_recipe

CATALOG = Path(__file__).parents[1] / "scenarios" / "catalog"


@dataclass(frozen=True)
class ShownKind:
    """A kind that a recipe shows, how many maneuvers its query finds (None: it has no query), and what went wrong."""

    recipe: str
    row: str
    kind: ScenarioKind
    found: int | None
    problem: str = ""


def row_of(kind: ScenarioKind) -> str:
    """The row of a kind as recipes write it, in small letters."""
    catalog, name = kind.catalog.removesuffix(" and rural"), kind.name.removeprefix("Lane change: ")
    return f"{catalog} / {kind.group} / {name}".lower()


def kinds_by_row() -> dict[str, ScenarioKind]:
    return {row_of(kind): kind for kind in read_kinds(CATALOG / "kinds.toml")}


def recipe_files() -> list[Path]:
    return sorted((CATALOG / "generate").glob("*.toml"))


def shown(path: Path, kinds: dict[str, ScenarioKind], scratch: Path) -> Iterator[ShownKind]:
    """Make a recipe, mine it, and ask for its kinds."""
    rows, problem = read_recipe(path).kinds, ""
    try:
        made = generate_recording(path, scratch / "made" / path.stem)
        options = MineOptions(write=False, fit=False, accept=tuple(CODES))
        maneuvers = mine([made.folder], scratch / "mined" / path.stem, options).maneuvers
    except ResimError as e:
        maneuvers, problem = None, str(e)
    for row in rows:
        kind = kinds[row.lower()]
        found = None
        if kind.find is not None:
            found = 0 if maneuvers is None else len(matching(kind.find, maneuvers))
        yield ShownKind(path.stem, row, kind, found, problem)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", help="recipes")
    asked = parser.parse_args()
    kinds = kinds_by_row()
    paths = [path for path in recipe_files() if not asked.names or path.stem in asked.names]
    with tempfile.TemporaryDirectory() as name:
        told = [one for path in paths for one in shown(path, kinds, Path(name))]
    asking = [one for one in told if one.found is not None]
    missed = [one for one in asking if not one.found]
    print(
        f"{len(paths)} recipes show {len(told)} rows: {len(asking)} with a query, {len(asking) - len(missed)} of"
    )
    print(f"them found by it, {len(missed)} not; {len(told) - len(asking)} without a query.\n")
    print("| recipe | row | found by its query |\n|---|---|---|")
    for one in told:
        said = f"never: {one.kind.never}" if one.found is None else str(one.found or f"**no** {one.problem}")
        print(f"| {one.recipe} | {one.row} | {said} |")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
