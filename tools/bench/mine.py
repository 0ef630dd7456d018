"""Mining: an hour of three-lane traffic with 2,000 vehicles, labelled and extracted, without fits, on one core.

Traffic is drawn: recordings of 15 minutes of 1 km of a straight three-lane road, 25 Hz, of vehicles with speeds and
lane changes of their own. The time is that of `resim mine --scenarios recordings`: reading and checking, features,
labels, scenarios written as recordings, tables and the page. The last line is JSON: realtime_factor (recorded time by
computing time), vehicles_per_s, and how the factor changes with hours and density.

    python tools/bench/mine.py [--quick] [--keep FOLDER]
    python tools/bench/mine.py --recordings FOLDER      those of `resim traffic`, and the peak of memory after each
    python tools/bench/mine.py --many N                 N recordings of a minute, likewise: does memory grow with them?
"""

from __future__ import annotations

import argparse
import json
import resource
import tempfile
import time
from pathlib import Path

import numpy as np

from resim.core.tracks import Tracks
from resim.jobs.mine import MineOptions, mine
from resim.mining.extraction import extract
from resim.mining.features import features
from resim.mining.find import find_maneuvers
from resim.mining.settings import DEFAULT_SETTINGS
from resim.recordings import Recording, read_recording, write_recording
from resim.road.opendrive import load

RATE, LENGTH, LANES, WIDTH = 25.0, 1000.0, 3, 3.5
CHANGES = 0.25
"""Share of vehicles that change lane on the way: 0.25 a kilometre."""


def write_road(file: Path) -> Path:
    """Three lanes of 3.5 m along x."""
    lanes = "".join(
        f'<lane id="-{k}" type="driving"><width sOffset="0" a="{WIDTH}" b="0" c="0" d="0"/></lane>'
        for k in range(1, LANES + 1)
    )
    file.write_text(
        '<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="6" name="bench"/>'
        f'<road id="1" length="{LENGTH + 40.0}" junction="-1"><planView><geometry s="0" x="0" y="0" hdg="0" '
        f'length="{LENGTH + 40.0}"><line/></geometry></planView><lanes><laneSection s="0"><center>'
        f'<lane id="0" type="none"/></center><right>{lanes}</right></laneSection></lanes></road></OpenDRIVE>',
        encoding="utf-8",
    )
    return file


def traffic(vehicles: int, seconds: float, rng: np.random.Generator) -> Tracks:
    """Vehicles that come evenly into each lane, keep their speed, and change lane or not, whoever is there."""
    t = np.arange(round(seconds * RATE)) / RATE
    shape = vehicles, len(t)
    x, y, heading, v = (np.full(shape, np.nan) for _ in range(4))
    for n in range(vehicles):
        lane = n % LANES
        speed = (33.0, 29.0, 25.0)[lane] + rng.normal(0.0, 0.8)
        first = round((seconds - 50.0) * (n // LANES) / max(vehicles // LANES, 1) * RATE)
        count = min(round(LENGTH / speed * RATE), len(t) - first)
        own, to, lasts = np.arange(count) / RATE, lane, rng.uniform(4.0, 7.0)
        if rng.random() < CHANGES:
            to = int(rng.choice([k for k in (lane - 1, lane + 1) if 0 <= k < LANES]))
        u = np.clip((own - rng.uniform(4.0, 18.0)) / lasts, 0.0, 1.0)
        aside = WIDTH * (lane - to)
        across = aside / lasts * 30.0 * u**2 * (1.0 - u) ** 2
        there = slice(first, first + count)
        x[n, there] = 10.0 + speed * own
        y[n, there] = -WIDTH * (lane + 0.5) + aside * (10.0 * u**3 - 15.0 * u**4 + 6.0 * u**5)
        heading[n, there], v[n, there] = np.arctan2(across, speed), np.hypot(across, speed)
    ids = np.array([str(n + 1) for n in range(vehicles)])
    return Tracks(
        t=t, ids=ids, kind=np.array(["car"] * vehicles), x=x, y=y, heading=heading, v=v,
        length=np.full(vehicles, 4.6), width=np.full(vehicles, 1.9), valid=np.isfinite(x),
    )  # fmt: skip


def labelled(tracks: Tracks, road: Path) -> tuple[float, int]:
    """Seconds of computing for features, labels and windows alone, and how many windows there are."""
    network = load(road)
    begin = time.perf_counter()
    found = features(tracks, network)
    made = extract(found, find_maneuvers(found), DEFAULT_SETTINGS.extraction)
    return time.perf_counter() - begin, len(made)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a quarter of an hour")
    parser.add_argument("--keep", type=Path, help="keep recordings and results in this folder")
    parser.add_argument("--recordings", type=Path, help="folder of recordings, in place of drawn traffic")
    parser.add_argument("--many", type=int, help="so many recordings of a minute, one after the other")
    asked = parser.parse_args()
    if asked.recordings:
        made_before(asked.recordings)
        return
    with tempfile.TemporaryDirectory() as scratch:
        if asked.many:
            road, rng = write_road(Path(scratch) / "road.xodr"), np.random.default_rng(0)
            for k in range(asked.many):
                name = f"minute_{k:04d}"
                write_recording(
                    Recording(name, road, "1", traffic(60, 60.0, rng), RATE), Path(scratch) / name
                )
            made_before(Path(scratch))
            return
        bench(asked.keep or Path(scratch), 1 if asked.quick else 4)


def made_before(folder: Path) -> None:
    """Mine recordings that are there, one after the other, and say how time and peak memory grow with them."""
    folders = sorted(one.parent for one in folder.glob("*/recording.toml"))
    begin, cpu, peaks = time.perf_counter(), time.process_time(), []

    def heard(told: object) -> None:
        peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024)
        spent = time.process_time() - cpu
        name = getattr(told, "recording", told)
        print(f"{name}: {spent:.1f} s of a core so far, peak {peaks[-1]} MB", flush=True)

    with tempfile.TemporaryDirectory() as scratch:
        found = mine(
            folders, Path(scratch) / "mined", MineOptions(fit=False, accept=("OVERLAP",)), heard=heard
        )
        heard("tables and page")
    whole, spent = time.perf_counter() - begin, time.process_time() - cpu
    recorded = sum(float(np.ptp(read_recording(one).gt.t)) for one in folders)
    parts = found.report.parts
    told = {
        "realtime_factor": round(recorded / spent, 1),
        "vehicles_per_s": round(sum(p.objects for p in parts) / spent, 1),
        "seconds": round(spent, 1), "wall_s": round(whole, 1), "recorded_s": round(recorded, 1),
        "recordings": len(parts), "vehicle_hours": round(sum(p.hours for p in parts), 2),
        "scenarios": sum(p.scenarios for p in parts), "memory_mb_first": peaks[0], "memory_mb": peaks[-1],
    }  # fmt: skip
    print(json.dumps(told))


def bench(folder: Path, quarters: int) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    road, rng = write_road(folder / "road.xodr"), np.random.default_rng(0)
    labelled(traffic(30, 60.0, rng), road)  # compiles
    for k in range(quarters):
        tracks = traffic(500, 900.0, rng)
        write_recording(Recording(f"quarter_{k}", road, "1", tracks, RATE), folder / f"quarter_{k}")
    options = MineOptions(fit=False, accept=("OVERLAP",))  # who changes lane here minds nobody
    begin, cpu = time.perf_counter(), time.process_time()
    found = mine([folder / f"quarter_{k}" for k in range(quarters)], folder / "mined", options)
    whole, spent_cpu = time.perf_counter() - begin, time.process_time() - cpu
    print(
        f"{quarters} x 15 minutes, {500 * quarters} vehicles: {whole:.1f} s, {len(found.scenarios)} scenarios written"
    )
    growth = {}
    for name, vehicles, seconds in (
        ("half", 250, 900.0),
        ("same", 500, 900.0),
        ("double", 1000, 900.0),
        ("long", 1000, 1800.0),
    ):
        if quarters == 1 and vehicles > 500:
            continue
        spent, windows = labelled(traffic(vehicles, seconds, rng), road)
        growth[name] = round(seconds / spent, 1)
        print(f"{vehicles} vehicles in {seconds:.0f} s, in memory: {spent:.1f} s, {windows} windows")
    told = {
        "realtime_factor": round(900.0 * quarters / whole, 1), "vehicles_per_s": round(500 * quarters / whole, 1),
        "seconds": round(whole, 1), "core_s": round(spent_cpu, 1), "labelled_realtime_factor": growth,
        "memory_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
    }  # fmt: skip
    print(json.dumps(told))


if __name__ == "__main__":
    main()
