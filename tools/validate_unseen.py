"""Count the verdicts that are INVALID because somebody was not seen, or of a size in doubt (docs/validation.md).

    python tools/validate_unseen.py scenarios/rear_end scenarios/neighbours/* [--only traffic]

Judges each recording by the criteria files of scenarios/criteria, GT and SD, whatever is wrong with it, and prints for
each file and source how many verdicts there are, and why those are INVALID that are.
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path

from resim.metrics.criteria import read_criteria
from resim.recordings.checks import CODES
from resim.resimulation import AssessmentOptions, assess_recording, load_checked

CRITERIA = Path(__file__).parents[1] / "scenarios" / "criteria"
REASONS = {
    "not seen": "not seen", "rows lack": "rows lack values", "size in doubt": "size in doubt",
    "place in doubt": "place in doubt", "away from its positions": "place in doubt",
}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recordings", type=Path, nargs="+")
    parser.add_argument("--only", choices=("highway", "traffic"), help="one of the criteria files")
    asked = parser.parse_args()
    counts: dict[tuple[str, str], Counter[str]] = {}
    for name in [asked.only] if asked.only else ["highway", "traffic"]:
        criteria = read_criteria(CRITERIA / f"{name}.toml")
        for folder in asked.recordings:
            found = assess_recording(
                load_checked(folder, accept=tuple(CODES)), AssessmentOptions(criteria=criteria, only=())
            )
            for source, a in found.blocks.items():
                count = counts.setdefault((name, source), Counter())
                for criterion, v in a.verdicts.items():
                    count[v.outcome] += 1
                    if v.outcome == "INVALID":
                        why = next(
                            (told for part, told in REASONS.items() if part in v.reason), "other reasons"
                        )
                        count[why] += 1
                        print(f"{folder.name} {source} {criterion}: {v.reason}")
    for (name, source), count in counts.items():
        print(
            f"{name} {source}: {sum(count[o] for o in ('PASS', 'FAIL', 'INVALID'))} verdicts: {dict(count)}"
        )


if __name__ == "__main__":
    main()
