"""How long 500 variations take, from the recording's file to the table, with two workers.

    python tools/bench/vary.py [--count 500] [--workers 2] [--kernels scenarios/kernels/motorway.json] [--rows]

The corner case, the lane change of the object that cuts in, 0.5 % of the range of each component. Each variation is
joined, fitted again, held against limits, roads and others, and examined as `resim check` does, and written as JSCEN.
Target: under 60 s on two cores. The last line is JSON; load is the machine's, as others may work on it.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import tempfile
import time
from pathlib import Path

from resim.jobs.vary import VaryOptions, vary
from resim.variations.settings import WhatVaries

ROOT = Path(__file__).parents[2]
TARGET = 60.0
"""s."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--kernels", type=Path, default=ROOT / "scenarios" / "kernels" / "motorway.json")
    parser.add_argument("--rows", action="store_true", help="write the table alone")
    arguments = parser.parse_args()
    drive = ROOT / "scenarios" / "cut_in_brake"
    what = WhatVaries(objects=("1",), labels=("lane_change_right",))
    options = VaryOptions(what, write=not arguments.rows, workers=arguments.workers)
    with tempfile.TemporaryDirectory() as folder:
        vary(drive, arguments.kernels, Path(folder) / "warm", count=20, options=options)  # compiles
        begin = time.perf_counter()
        made = vary(drive, arguments.kernels, Path(folder) / "out", count=arguments.count, options=options)
        seconds, count = time.perf_counter() - begin, len(made.table)
    load = f"{platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}"
    print(f"{count} variations of {made.report.looked} points in {seconds:.1f} s; {load}")
    print(json.dumps({
        "variations": count, "looked": made.report.looked, "seconds": round(seconds, 2),
        "load": round(os.getloadavg()[0], 1), "workers": arguments.workers, "target_s": TARGET, "met": seconds < TARGET,
    }))  # fmt: skip


if __name__ == "__main__":
    main()
