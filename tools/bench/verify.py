"""A suite of 25, 50 and 100 recordings of 10 s with 5 traffic objects and sensor data, verified on both bases.

    python tools/bench/verify.py [--counts 25 50 100] [--workers 2] [--no-reports]

Each is a drive of its own, driven by highway_pilot-1.0 with the virtual sensors; making them does not count, starting
the workers does, and so do the results on disk: above all the re-simulation report of each recording that is not
verified (without a perception model most are not), which --no-reports leaves out. Target: 100 recordings in 2 minutes
on 2 cores, and a cost that grows linearly. Time is of the clock: what else the machine does shows.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from resim.verification.execution import verify
from resim.verification.request import VerifyOptions, make_request, refuse_others
from resim.verification.suite import new_suite, read_suite

sys.path.insert(0, str(Path(__file__).parents[1]))
from drives import Drive
from make_scenarios import ROOT, record
from neighbours import around, keeping
from virtual_sensor import SensorErrors

BUILD = ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml"
CRITERIA = ROOT / "scenarios" / "criteria" / "highway.toml"
TARGET = 120.0
"""s for 100 recordings."""


def drive(number: int) -> Drive:
    """Ten seconds among five: one ahead that brakes, one behind, three on the left."""
    rng = np.random.default_rng([77, number])
    v = rng.uniform(22.0, 28.0)
    brakes = (rng.uniform(2.0, 5.0), rng.uniform(6.0, 8.0), -rng.uniform(0.5, 3.0))
    traffic = around(
        keeping(rng.uniform(30.0, 60.0), v, changes=(brakes,)), keeping(-rng.uniform(60.0, 80.0), v - 1.0),
        *(keeping(gap + rng.uniform(-8.0, 8.0), v + rng.uniform(0.0, 4.0), lane=1) for gap in (-50.0, -5.0, 40.0)),
    )  # fmt: skip
    return Drive(
        f"Bench {number}", "highway_pilot-1.0", 10.0, -2, v, traffic, SensorErrors(), seed=5000 + number
    )


def took(folders: list[Path], home: Path, workers: int, reports: bool) -> tuple[float, dict[str, int]]:
    """Seconds of a verification, and how many recordings got which verdict."""
    suite, out = home / f"suite_{len(folders)}.toml", home / f"out_{len(folders)}"
    suite.write_text(new_suite(folders, CRITERIA, suite, f"bench {len(folders)}"), encoding="utf-8")
    out.mkdir()
    begin = time.perf_counter()
    wanted = make_request(read_suite(suite), BUILD, None, VerifyOptions(), out)
    refuse_others(wanted, out)
    found, _ = verify(wanted, out, out if reports else None, workers=workers)
    seconds = time.perf_counter() - begin
    return seconds, found.summary.counts()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--counts", type=int, nargs="+", default=[25, 50, 100])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--no-reports", dest="reports", action="store_false")
    given = parser.parse_args()
    times = {}
    with tempfile.TemporaryDirectory() as temporary:
        home = Path(temporary)
        folders = [home / f"drive_{n:03d}" for n in range(max(given.counts))]
        for n, folder in enumerate(folders):
            record(folder.name, drive(n), folder)
        print(f"{given.workers} workers on {os.cpu_count()} cores, load before {os.getloadavg()[0]:.2f}")
        print("| recordings | s | s a recording | verdicts |\n|---|---|---|---|")
        for count in given.counts:
            times[count], verdicts = took(folders[:count], home, given.workers, given.reports)
            told = ", ".join(f"{n} {name}" for name, n in verdicts.items() if n)
            print(f"| {count} | {times[count]:.1f} | {times[count] / count:.2f} | {told} |", flush=True)
    most = max(given.counts)
    half = most // 2
    print(json.dumps({
        f"seconds_{most}": round(times[most], 1),
        "per_recording_s": round(times[most] / most, 3),
        "growth": round(times[most] / times[half], 3) if half in times else None,
        "within_target": times[most] / most * 100.0 < TARGET,
        "load_after": round(os.getloadavg()[0], 2),
    }))  # fmt: skip


if __name__ == "__main__":
    main()
