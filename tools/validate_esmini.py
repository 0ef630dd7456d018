"""Holds OpenSCENARIO files against esmini: `python tools/validate_esmini.py ESMINI DATA [EXAMPLES]`.

ESMINI: the program. DATA: folder with real recordings; those that ship are played without. What `resim export` writes
is played, and what EXAMPLES (esmini's `resources/xosc`, which name their maps) hold is imported and compared with how
esmini plays it, reference points with reference points. esmini passes over vertices within 0.1 m of each other unless
told otherwise (`--traj_filter 0`).
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
from validate_openscenario import drives

from resim.core.errors import InputError
from resim.jobs.export import export_openscenario
from resim.recordings.formats.openscenario import EGOS, read_openscenario

STEP = 0.01
"""s of esmini's clock."""


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
    wanted = (
        "World_Position_X [m]",
        "World_Position_Y [m]",
        "World_Heading_Angle [rad]",
        "bb_x [m]",
        "bb_y [m]",
    )
    found: dict[str, list[tuple[float, ...]]] = {}
    for row in rows:
        t = float(row[1])
        if t > until:
            break
        for k in groups:
            if k >= len(row) or not row[k]:
                continue
            stem = keys[k].split(" ")[0]
            values = [float(row[keys.index(f"{stem} {one}", k)]) for one in wanted]
            found.setdefault(row[k], []).append((t, *values))
    return {
        name: pd.DataFrame(own, columns=["t", "x", "y", "heading", "ahead", "left"])
        for name, own in found.items()
    }


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
        for name, drive in drives(data, home).items():
            report = export_openscenario(drive, home / "out")
            try:
                found = [compare(home / "out" / one, esmini, home) for one in report.sources.values()]
            except InputError as e:
                print(f"| {name} | {len(report.sources)} | – | {e.problem} |")
                continue
            count, far = max(one for one, _ in found), max(one for _, one in found)
            print(f"| {name} | {len(found)} | {count} | {1e3 * far:.4f} |", flush=True)
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
