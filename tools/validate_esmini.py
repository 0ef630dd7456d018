"""Holds OpenSCENARIO files against esmini: `python tools/validate_esmini.py ESMINI DATA [EXAMPLES]`.

ESMINI: the program. DATA: folder with real recordings; those that ship are played without. What `resim export` writes
is played, and what EXAMPLES (esmini's `resources/xosc`, which name their maps) hold is imported and compared with how
esmini plays it, reference points with reference points. The lanes in which esmini has everybody are held against ours.
esmini passes over vertices within 0.1 m of each other unless told otherwise (`--traj_filter 0`).
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
from validate_openscenario import ROOT, drives

from resim.core.errors import InputError
from resim.jobs.export import export_openscenario
from resim.jobs.generate import generate_recording
from resim.recordings.formats.openscenario import EGOS, read_openscenario
from resim.road.opendrive import load

STEP = 0.01
"""s of esmini's clock."""
COLUMNS = {
    "World_Position_X": "x", "World_Position_Y": "y", "World_Heading_Angle": "heading", "bb_x": "ahead", "bb_y": "left",
    "lane_id": "lane", "lane_offset": "offset",
}  # fmt: skip
"""Of esmini's log, without units, and what they are called here."""


def play(esmini: Path, file: Path, until: float, home: Path) -> dict[str, pd.DataFrame]:
    """Where esmini has the reference point of each entity, and the box's centre from there."""
    log = home / "log.csv"
    log.unlink(missing_ok=True)
    order = [esmini, "--osc", file, "--headless", "--fixed_timestep", STEP, "--csv_logger", log]
    order += ["--traj_filter", "0", "--disable_stdout", "--disable_log"]
    subprocess.run([*map(str, order)], check=False, timeout=300, capture_output=True, cwd=home)
    if not log.is_file():
        raise InputError(file, "is not played by esmini")
    lines = log.read_text().splitlines()
    head = next(k for k, line in enumerate(lines) if line.startswith("Index [-]"))
    keys = [key.strip() for key in lines[head].split(",")]
    rows = [[one.strip() for one in line.split(",")] for line in lines[head + 1 :]]
    return by_entity(keys, rows, until)


def by_entity(keys: list[str], rows: list[list[str]], until: float) -> dict[str, pd.DataFrame]:
    """The log has a group of columns for each entity, as many as there are in that row."""
    groups = [k for k, key in enumerate(keys) if key.endswith("Entity_Name [-]")]
    found: dict[str, list[tuple[float, ...]]] = {}
    for row in rows:
        t = float(row[1])
        if t > until:
            break
        for k in groups:
            if k >= len(row) or not row[k]:
                continue
            stem = keys[k].split(" ")[0]
            values = [float(row[column(keys, f"{stem} {one}", k)]) for one in COLUMNS]
            found.setdefault(row[k], []).append((t, *values))
    return {name: pd.DataFrame(own, columns=["t", *COLUMNS.values()]) for name, own in found.items()}


def column(keys: list[str], name: str, first: int) -> int:
    """Which column has a name, units aside, from a group's first on; spaces differ from group to group."""
    told = name.replace(" ", "")
    return next(k for k in range(first, len(keys)) if keys[k].replace(" ", "").startswith(told))


def told_lanes(esmini: Path, named: dict[str, Path], home: Path) -> None:
    """In which lane, and how far from its centre, esmini and resim have the reference points of everybody."""
    head = "samples | on lanes | same lane | offsets differ by, median [mm] | 99.9 % [mm]"
    print(f"\n| drive | {head} |\n|---|---|---|---|---|---|")
    for name, drive in named.items():
        report = export_openscenario(drive, home / "out")
        try:
            log = pd.concat(play(esmini, home / "out" / report.sources["GT"], np.inf, home).values())
        except InputError as e:
            print(f"| {name} | {e.problem} | | | | |")
            continue
        found = load(home / "out" / report.map).to_road(log.x, log.y, heading=log.heading)
        on = found.on_road
        same = on & (found.lane == log.lane)
        differ = 1e3 * np.abs(found.t - log.offset)[same]
        told = f"{100 * on.mean():.1f} % | {100 * same.sum() / on.sum():.2f} %"
        most = np.quantile(differ, 0.999)
        print(f"| {name} | {len(log)} | {told} | {np.median(differ):.2f} | {most:.1f} |", flush=True)


def recipes(home: Path) -> dict[str, Path]:
    """Every eighth of the recipes that ship, generated."""
    found = {}
    for recipe in sorted((ROOT / "scenarios" / "catalog" / "generate").glob("*.toml"))[::8]:
        generate_recording(recipe, home / recipe.stem)
        found[recipe.stem] = home / recipe.stem
    return found


def off(gt: pd.DataFrame, played: pd.DataFrame) -> float:
    """m between where resim and esmini have a reference point, the largest, at times that both have."""
    there = (played.t >= gt.t.iloc[0] - 1e-9) & (played.t <= gt.t.iloc[-1] + 1e-9)
    log = played[there]
    x, y, heading = (np.interp(log.t, gt.t, one) for one in (gt.x, gt.y, np.unwrap(gt.heading)))
    c, s = np.cos(heading), np.sin(heading)
    dx, dy = x - log.ahead * c + log.left * s - log.x, y - log.ahead * s - log.left * c - log.y
    return float(np.hypot(dx, dy).max()) if len(log) else float("nan")


def compare(file: Path, esmini: Path, home: Path, **options: object) -> tuple[int, float]:
    """How many entities, and the largest difference [m], of an exported file that is imported and played."""
    recording = read_openscenario(file, **options)  # type: ignore[arg-type]
    frame = recording.gt.to_frame()
    played = play(esmini, file, float(frame.t.max()), home)
    far = [
        off(own, played[str(name)]) for name, own in frame.groupby("id", observed=True) if str(name) in played
    ]
    return len(far), float(np.nanmax(far))


def main(esmini: Path, data: Path, examples: Path | None) -> None:
    """Print the tables."""
    print("| drive | files | entities | esmini's difference, largest [mm] |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        known = drives(data, home)
        for name, drive in known.items():
            report = export_openscenario(drive, home / "out")
            try:
                found = [compare(home / "out" / one, esmini, home) for one in report.sources.values()]
            except InputError as e:
                print(f"| {name} | {len(report.sources)} | – | {e.problem} |")
                continue
            count, far = max(one for one, _ in found), max(one for _, one in found)
            print(f"| {name} | {len(found)} | {count} | {1e3 * far:.4f} |", flush=True)
        told_lanes(esmini, {**known, **recipes(home / "recipes")}, home)
        if examples is not None:
            told_examples(esmini, examples, home)


def told_examples(esmini: Path, examples: Path, home: Path) -> None:
    """What comes in of files of others, whole or till 2 s, and how far it is from esmini's own play."""
    print("\n| file | till [s] | entities | from esmini, largest [mm] |\n|---|---|---|---|")
    refused: Counter[str] = Counter()
    for file in sorted(examples.glob("*.xosc")):
        names = [one.get("name") for one in ElementTree.parse(file).getroot().iter("ScenarioObject")]
        ego = next((one for one in names if one and one.lower() in EGOS), names[0] if names else None)
        why = ""
        for end in (None, 2.0):
            try:
                count, far = compare(file, esmini, home, ego=ego, end=end)
            except InputError as e:
                why = e.problem
                continue
            print(f"| {file.name} | {end or 'its end'} | {count} | {1e3 * far:.3f} |", flush=True)
            break
        else:
            refused[why[:200]] += 1
    print(f"\nRefused: {refused.total()}\n")
    for why, times in refused.most_common():
        print(f"- {times} x {why}")


if __name__ == "__main__":
    program = shutil.which(sys.argv[1]) or sys.exit(f"there is no program {sys.argv[1]}")
    rest = [Path(one).absolute() for one in sys.argv[2:]]
    main(Path(program).absolute(), rest[0], rest[1] if len(rest) > 1 else None)
