"""Precision and recall of mined labels, as Kaefer 2022, Tables 5.1 to 5.6.

    python tools/validate_mining.py traffic [FOLDER | --hours H --seed N ...] SUMO's motorway against its truth
    python tools/validate_mining.py damaged [FOLDER | --hours H --seed N ...] the same, damaged and repaired
    python tools/validate_mining.py town [FOLDER | --hours H --seed N ...]    SUMO's town: turns, lane changes, standing
    python tools/validate_mining.py augmented [--count N]                          planted maneuvers, varied by chance

A mined label is right where the truth has one of the same name and object that shares a time with it, each counted
once. Truth is what `resim traffic` and `resim generate` say (`truth.csv`), and what tools/mining_oracle.py makes of it.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
from mining_damage import damaged, whose
from mining_oracle import events
from mining_rules import Event

from resim.core.errors import ResimError
from resim.jobs.augment import augment
from resim.jobs.generate import generate_recording
from resim.jobs.mine import MineOptions, mine
from resim.jobs.traffic import make_traffic
from resim.recordings import read_recording
from resim.recordings.checked import repair_recording
from resim.recordings.checks.codes import CODES

ROOT = Path(__file__).parents[1]
MOTORWAY, TOWN = ROOT / "networks" / "motorway.xodr", ROOT / "networks" / "urban.xodr"
SHARED, SHARED_IN_NOISE = 0.05, 0.2
"""s by which events may miss one another: a sample at 25 Hz is 0.04 s; a border is crossed 5 cm of noise later."""
KINDS = (
    "lane_change_left", "lane_change_right", "lane_change_not_judged", "cut_in_left", "cut_in_right", "cut_out_left",
    "cut_out_right", "enter_highway", "exit_highway", "tailgating_minor", "tailgating_moderate", "tailgating_severe",
    "speeding", "standing", "strong_braking", "strong_acceleration",
)  # fmt: skip
EXACT = (
    *KINDS,
    "pass",
    "overtaking_right",
    "follow_lane",
    "wrong_way",
    "swerving",
    "critical_ttc",
    "critical_thw",
)
"""... and those that noise and new ids split, which are compared on exact tracks alone."""
TURNS = ("turn_left", "turn_right", "straight", "u_turn", "lane_change_left", "lane_change_right")


@dataclass
class Counts:
    """Of one label. misses, wrong: whose, and when."""

    truth: int = 0
    found: int = 0
    right: int = 0
    misses: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)


Table = dict[str, Counts]


def compare(
    table: Table, name: str, truth: Iterable[Event], found: Iterable[Event], kinds: Iterable[str],
    shared: float = SHARED,
) -> None:  # fmt: skip
    """Count which events were found, each of a kind and object once, in the order of time."""
    wanted = set(kinds)
    sides: tuple[dict[tuple[str, str], list[tuple[float, float]]], ...] = defaultdict(list), defaultdict(list)
    for side, told in zip(sides, (truth, found), strict=True):
        for who, label, start, end in told:
            if label in wanted:
                side[who, label].append((start, end))
    for who, label in sorted({*sides[0], *sides[1]}):
        count, left = table.setdefault(label, Counts()), sorted(sides[1][who, label])
        count.truth += len(sides[0][who, label])
        count.found += len(left)
        for start, end in sorted(sides[0][who, label]):
            near = (one for one in left if one[0] <= end + shared and start <= one[1] + shared)
            hit = min(near, key=lambda one: one[1], default=None)  # a longer one may be of a later event
            if hit is None:
                count.misses.append(f"{name}: {who} {start:.2f} to {end:.2f} s")
            else:
                left.remove(hit)
                count.right += 1
        count.wrong += [f"{name}: {who} {start:.2f} to {end:.2f} s" for start, end in left]


def print_table(table: Table, kinds: Iterable[str], listed: int) -> None:
    print("| maneuver | truth | found | precision | recall |\n|---|---|---|---|---|")
    for label in kinds:
        one = table.get(label, Counts())
        precision = f"{100.0 * one.right / one.found:.1f} %" if one.found else "–"
        recall = f"{100.0 * one.right / one.truth:.1f} %" if one.truth else "–"
        print(f"| {label} | {one.truth} | {one.found} | {precision} | {recall} |")
    for label in kinds:
        one = table.get(label, Counts())
        for what, lines in (("missed", one.misses), ("wrong", one.wrong)):
            for line in lines[:listed]:
                print(f"  {label} {what} in {line}", file=sys.stderr)
    print()


def mined(folder: Path, scratch: Path, accept: tuple[str, ...] = ()) -> pd.DataFrame:
    found = mine([folder], scratch / f"mined_{folder.parent.name}_{folder.name}",
                 MineOptions(write=False, fit=False, accept=accept))  # fmt: skip
    return found.maneuvers


def rows_of(frame: pd.DataFrame, rename: Callable[[str], str] = str) -> list[Event]:
    return [
        (rename(str(one.object)), str(one.label), float(one.start), float(one.end))
        for one in frame.itertuples()
    ]


def truth_of(folder: Path) -> pd.DataFrame:
    return pd.read_csv(folder / "truth.csv", keep_default_na=False)


def traffic(folders: list[Path], scratch: Path, listed: int) -> None:
    table: Table = {}
    for folder in folders:
        truth = events(MOTORWAY, read_recording(folder).gt, truth_of(folder))
        compare(table, f"{folder.parent.name}/{folder.name}", truth, rows_of(mined(folder, scratch)), EXACT)
    print_table(table, EXACT, listed)


def damage(folders: list[Path], scratch: Path, listed: int, seed: int) -> None:
    before, after = Table(), Table()
    for number, folder in enumerate(folders):
        recording = read_recording(folder)
        truth = events(MOTORWAY, recording.gt, truth_of(folder))
        broken = scratch / "damaged" / f"{number}"
        damaged(recording, broken, np.random.default_rng([seed, number]))
        every = tuple(CODES)
        compare(before, broken.name, truth, rows_of(mined(broken, scratch, every), whose), KINDS,
                SHARED_IN_NOISE)  # fmt: skip
        repaired = scratch / "repaired" / f"{number}"
        repair_recording(broken, repaired)
        compare(after, broken.name, truth, rows_of(mined(repaired, scratch, every), whose), KINDS,
                SHARED_IN_NOISE)  # fmt: skip
    print("Before:\n")
    print_table(before, KINDS, 0)
    print("After `resim check --fix`:\n")
    print_table(after, KINDS, listed)


def town(folders: list[Path], scratch: Path, listed: int) -> None:
    """Whole ways through junctions, and lane changes that the track shows from lane centre to lane centre."""
    table: Table = {}
    for folder in folders:
        recording, truth = read_recording(folder), truth_of(folder)
        seen = dict(zip(recording.gt.ids.tolist(), zip(*recording.gt.span(), strict=True), strict=True))
        inside = [
            seen[str(one.object)][0] < one.start and one.end < seen[str(one.object)][1]
            for one in truth.itertuples()
        ]
        found = rows_of(mined(folder, scratch))
        whole = rows_of(truth[inside])
        cut = [event for event in rows_of(truth[~np.array(inside)]) if event[1] in TURNS]
        kept = [f for f in found if not any(f[:2] == c[:2] and f[2] <= c[3] and c[2] <= f[3] for c in cut)]
        compare(table, folder.name, whole, kept, TURNS)
    print_table(table, TURNS, listed)


def augmented(count: int, most: int, scratch: Path, listed: int) -> None:
    """Every recipe that ships, and variations of each; truth is that of routes, moved with the variation."""
    plain, varied = Table(), Table()
    refused = 0
    recipes = sorted((ROOT / "scenarios" / "catalog" / "generate").glob("*.toml"))
    for recipe in recipes[:: max(len(recipes) // most, 1)]:
        made = generate_recording(recipe, scratch / "kinds" / recipe.stem)
        _planted(plain, made.folder, scratch, TURNS)
        try:
            variations = augment(made.folder, scratch / "varied" / made.folder.name, count=count)
        except ResimError as e:
            refused += 1
            print(f"  {made.folder.name}: {e}", file=sys.stderr)
            continue
        for one in variations:
            _planted(varied, one.folder, scratch, TURNS)
    print("Without augmentation:\n")
    print_table(plain, TURNS, listed)
    print(f"With augmentation, {count} variations each, {refused} recipes without room for one:\n")
    print_table(varied, TURNS, listed)


def _planted(table: Table, folder: Path, scratch: Path, kinds: Iterable[str]) -> None:
    recording, truth = read_recording(folder), truth_of(folder)
    seen = dict(zip(recording.gt.ids.tolist(), zip(*recording.gt.span(), strict=True), strict=True))
    vehicles = set(recording.gt.ids[~np.isin(recording.gt.kind, ["pedestrian", "bicycle"])].tolist())
    own = truth[truth["object"].astype(str).isin(vehicles)]
    whole = [
        seen[str(one.object)][0] < one.start and one.end < seen[str(one.object)][1]
        for one in own.itertuples()
    ]
    found = rows_of(mined(folder, scratch, tuple(CODES)))
    cut = [event for event in rows_of(own[~np.array(whole, dtype=bool)]) if event[1] in kinds]
    kept = [f for f in found if not any(f[:2] == c[:2] and f[2] <= c[3] and c[2] <= f[3] for c in cut)]
    compare(table, folder.name, rows_of(own[np.array(whole, dtype=bool)]), kept, kinds)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("traffic", "damaged", "town", "augmented"))
    parser.add_argument("folder", type=Path, nargs="?", help="recordings that `resim traffic` made")
    parser.add_argument("--hours", type=float, default=0.2)
    parser.add_argument("--seed", type=int, nargs="+", default=[1], help="of the traffic, made with each")
    parser.add_argument("--settings", type=Path, help="of the traffic")
    parser.add_argument("--count", type=int, default=10)
    parser.add_argument("--most", type=int, default=1000, help="recordings, or recipes, at most")
    parser.add_argument(
        "--listed", type=int, default=20, help="misses of each label that are listed (stderr)"
    )
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        if asked.what == "augmented":
            augmented(asked.count, asked.most, scratch, asked.listed)
            return
        folder = asked.folder or scratch / "traffic"
        if asked.folder is None:
            road = TOWN if asked.what == "town" else MOTORWAY
            own = ROOT / "scenarios" / "traffic" / "urban.toml" if asked.what == "town" else None
            settings = asked.settings or own
            for seed in asked.seed:
                for _ in make_traffic(
                    road, folder / f"{seed}", hours=asked.hours, seed=seed, settings=settings
                ):
                    pass
        folders = sorted(one.parent for one in folder.rglob("truth.csv"))[: asked.most]
        print(f"{len(folders)} recordings\n")
        if asked.what == "damaged":
            damage(folders, scratch, asked.listed, asked.seed[0])
        else:
            {"traffic": traffic, "town": town}[asked.what](folders, scratch, asked.listed)


if __name__ == "__main__":
    main()
