"""Every recipe in scenarios/catalog/generate/, generated and mined: which queries of kinds.toml find the kinds it shows.

    python tools/validate_kinds.py [RECIPE ...]     all, or those of these names; ends 1 where one is not found

Writes the table of docs/validation.md.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import pandas as pd

from resim.jobs.generate import generate_recording
from resim.jobs.mine import MineOptions, mine
from resim.mining.catalog import matching, read_kinds
from resim.recordings.checks.codes import CODES
from resim.scenario.generation.recipe import read_recipe

CATALOG = Path(__file__).parents[1] / "scenarios" / "catalog"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--show", action="store_true")
    asked = parser.parse_args()
    by = {}
    for k in read_kinds(CATALOG / "kinds.toml"):
        by[f"{k.catalog.replace(' and rural', '')} / {k.group} / {k.name.removeprefix('Lane change: ')}".lower()] = k
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        for path in sorted((CATALOG / "generate").glob("*.toml")):
            if asked.names and path.stem not in asked.names:
                continue
            recipe = read_recipe(path)
            try:
                made = generate_recording(path, scratch / "made" / path.stem)
            except Exception as e:
                print("MISSED BROKEN", path.stem, str(e)[:300])
                continue
            table = mine([made.folder], scratch / "mined" / path.stem, MineOptions(write=False, fit=False, accept=tuple(CODES))).maneuvers
            for kind in recipe.kinds:
                row = by[kind.lower()]
                if row.find is None:
                    print("NEVER ", path.stem, "|", kind, "|", row.never)
                else:
                    n = len(matching(row.find, table))
                    print("found " if n else "MISSED", path.stem, "|", kind, n, row.find.model_dump(exclude_defaults=True))
            if asked.show:
                print(table[["object","label","start","end","t","partner"]].to_string())
    return 0


if __name__ == "__main__":
    sys.exit(main())
