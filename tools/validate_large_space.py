"""Build a space with a bucket of more scenarios than all distances are computed of, and hold it against the exact one.

    python tools/validate_large_space.py [MINED [COUNT]]

Traffic is too slow for so many: the scenarios of the commonest number of vehicles in MINED (0.1 h of traffic, mined, if
nothing is said) are varied until there are COUNT (22,000), and written as a mined folder. The gap in each slot is moved
by one draw (SPREAD), as long as somebody is in it, and up to a fifth of the time is cut off the end. Then `resim space
build` makes the space twice, as it ships by samples and with all distances, with the time and peak memory of each.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd

from resim.core.files import file_hash
from resim.core.sealed import read_sealed, sealed
from resim.recordings.tables import read_parquet
from resim.results import write_json, write_parquet
from resim.space.agreement import adjusted_rand
from resim.space.clustering import cluster
from resim.space.distance import PairDistances
from resim.space.settings import LARGEST
from resim.space.traces import SlotTraces, from_frame, read_traces, to_frame

ROOT = Path(__file__).parents[1]
MAP = ROOT / "networks" / "motorway.xodr"
COUNT = 22_000
SPREAD = 3.0
"""m by which a gap is moved, standard deviation."""
CUT = 0.2
REACH = {"II": (-5.0, 5.0), "VII": (-5.0, 5.0)} | {
    slot: (-50.0, -5.0) if slot in ("I", "IV", "VI") else (5.0, 100.0) for slot in ("I", "III", "IV", "V", "VI", "VIII")
}  # fmt: skip
"""m ahead that a slot holds."""
SUBSET = 4_000
"""Scenarios that are clustered alone as well, by all distances between them."""


def resim(*told: object) -> tuple[float, float]:
    """Run a command; gives its time [s] and peak memory [GB]. Raises SystemExit where it fails."""
    begin = time.monotonic()
    child = subprocess.Popen([sys.executable, "-m", "resim", *map(str, told)], stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(child.pid, 0)
    if status:
        sys.exit(f"resim {told[0]} {told[1]} failed")
    return time.monotonic() - begin, used.ru_maxrss / 1e6


def traffic(out: Path) -> Path:
    """Mine 0.1 h of traffic."""
    resim("traffic", MAP, "--out", out / "traffic", "--hours", 0.1, "--seed", 1)
    folders = sorted(one for one in (out / "traffic").iterdir() if (one / "recording.toml").is_file())
    resim("mine", *folders, "--out", out / "mined", "--scenarios", "rows")
    return out / "mined"


def varied(mined: Path, out: Path, count: int) -> None:
    """Write a mined folder of variations, so many of one number of vehicles."""
    rng = np.random.default_rng(0)
    rows, traces = read_parquet(mined / "scenarios.parquet"), read_traces(mined / "slots.parquet")
    rows = rows[traces.rows_of(rows["scenario"].tolist()) >= 0]
    rows = rows[rows["vehicles"] == rows["vehicles"].mode()[0]].reset_index(drop=True)
    origin = np.resize(np.arange(len(rows)), count)
    number = np.arange(count) // len(rows)
    names = [f"{name}~{k}" for name, k in zip(rows["scenario"].to_numpy(str)[origin], number, strict=True)]
    out.mkdir()
    of = traces.take(traces.rows_of(rows["scenario"].tolist()))
    slots = pd.concat(
        [to_frame(_variation(of, k, rng)) for k in range(int(number[-1]) + 1)], ignore_index=True
    )
    slots = slots[slots["scenario"].isin(names)]
    write_parquet(slots, out / "slots.parquet")
    write_parquet(
        rows.iloc[origin].assign(scenario=pd.array(names, dtype="string")), out / "scenarios.parquet"
    )
    write_parquet(read_parquet(mined / "maneuvers.parquet"), out / "maneuvers.parquet")
    told = read_sealed(mined / "mined.json", "")
    told["files"] |= {
        name: file_hash(out / name) for name in ("slots.parquet", "scenarios.parquet", "maneuvers.parquet")
    }
    write_json(sealed(told), out / "mined.json")
    print(
        f"{count} variations of {len(rows)} scenarios with {rows['vehicles'].iloc[0]} vehicles\n", flush=True
    )


def _variation(of: SlotTraces, number: int, rng: np.random.Generator) -> SlotTraces:
    """Each scenario once more; as it is for number 0."""
    frame = to_frame(of)
    place = np.repeat(np.arange(len(of)), of.scenes)
    if number:
        for slot, (low, high) in REACH.items():
            moved = frame[slot].to_numpy() + rng.normal(0.0, SPREAD, len(of))[place]
            frame[slot] = np.clip(moved, low, high)
        keep = np.ceil(of.scenes * (1.0 - CUT * rng.random(len(of))))
        frame = frame[np.arange(len(frame)) - of.first[place] < keep[place]]
    return from_frame(frame.assign(scenario=frame["scenario"].astype(str) + f"~{number}"))


def build(mined: Path, out: Path, largest: int) -> np.ndarray:
    """Build a space by the command, print what it took, and give the cluster of each scenario by name."""
    settings = out.with_suffix(".toml")
    settings.write_text(f'bucket = "vehicles"\nlargest = {largest}\n', encoding="utf-8")
    took, memory = resim("space", "build", mined, "--out", out, "--settings", settings)
    told = json.loads((out / "space.json").read_text(encoding="utf-8"))
    (bucket,) = told["buckets"]
    clusters = read_parquet(out / "clusters.parquet")["cluster"].to_numpy(str)
    size = (out / "distances.parquet").stat().st_size / 1e6
    print(f"| {bucket['method']} | {told['scenarios']} | {took:.0f} | {memory:.1f} | {len(set(clusters.tolist()))} |"
          f" {size:.0f} |", flush=True)  # fmt: skip
    return clusters


def main() -> None:
    count = int(sys.argv[2]) if len(sys.argv) > 2 else COUNT
    with tempfile.TemporaryDirectory() as name:
        out = Path(name)
        varied(Path(sys.argv[1]) if len(sys.argv) > 1 else traffic(out), out / "varied", count)
        print(
            "| method | scenarios | s | peak GB | clusters | MB of distances.parquet |\n|---|---|---|---|---|---|"
        )
        samples, exact = (
            build(out / "varied", out / "samples", LARGEST),
            build(out / "varied", out / "exact", 1_000_000),
        )
        print(f"\nadjusted Rand index, samples against all distances: {adjusted_rand(samples, exact):.3f}")
        rows = np.sort(np.random.default_rng(1).permutation(count)[:SUBSET])
        traces = read_traces(out / "samples" / "slots.parquet")
        alone = cluster(PairDistances(traces.take(rows), workers=2).condensed()).label
        against = [f"{adjusted_rand(one[rows], alone):.3f}" for one in (samples, exact)]
        print(f"{SUBSET} of them, clustered alone by all distances: samples {against[0]}, all {against[1]}")


if __name__ == "__main__":
    main()
