"""The scenario space: distances of 260 scenarios (33,670 pairs), and of 10,000 with their clusters.

Scenarios are drawn: 8.4 s on average, each slot held half of the time. The last line is JSON: pairs_per_s of one core,
matrix_260_s (the distances of 260 scenarios, one core), and for 10,000 scenarios with two workers matrix_10000_s and
clusters_10000_s.

    python tools/bench/space.py [--quick]
"""

from __future__ import annotations

import argparse
import json
import resource
import time

import numpy as np

from resim.space.clustering import cluster
from resim.space.distance import PairDistances
from resim.space.traces import SlotTraces

MEAN = 42
"""Scenes of a scenario: 8.36 s at 5 Hz (Wagner 2021, 6.2.2)."""


def drawn(count: int, seed: int) -> SlotTraces:
    rng = np.random.default_rng(seed)
    scenes = np.maximum(rng.poisson(MEAN, count), 2)
    first = np.concatenate([[0], np.cumsum(scenes)]).astype(np.intp)
    k = int(first[-1])
    held = rng.random((count, 8)) < 0.4
    start, speed = rng.uniform(5.0, 95.0, (count, 8)), rng.normal(0.0, 3.0, (count, 8))
    of = np.repeat(np.arange(count), scenes)
    t = (np.arange(k) - first[of]) / 5.0
    offset = np.where(held[of], start[of] + speed[of] * t[:, None], np.nan)
    names = np.array([f"s{n:05d}" for n in range(count)])
    moved = np.where(held[of], speed[of], np.nan)
    return SlotTraces(names, first, offset, moved, np.zeros(k, np.intp), np.zeros(k))


def timed(traces: SlotTraces, workers: int, times: int) -> tuple[float, np.ndarray]:
    best, found = np.inf, np.zeros(0)
    for _ in range(times):
        begin = time.perf_counter()
        found = PairDistances(traces, workers=workers).condensed()
        best = min(best, time.perf_counter() - begin)
    return best, found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="without the 10,000 scenarios")
    asked = parser.parse_args()
    timed(drawn(20, 0), 1, 1)  # compiles
    small, condensed = timed(drawn(260, 1), 1, 5)
    told = {"pairs_per_s": round(len(condensed) / small), "matrix_260_s": round(small, 4)}
    print(f"260 scenarios, {len(condensed)} pairs: {small:.3f} s")
    if not asked.quick:
        large, condensed = timed(drawn(10_000, 2), 2, 1)
        begin = time.perf_counter()
        found = cluster(condensed)
        clustered = time.perf_counter() - begin
        print(f"10,000 scenarios: distances {large:.1f} s, {found.count} clusters {clustered:.1f} s")
        told |= {"matrix_10000_s": round(large, 1), "clusters_10000_s": round(clustered, 1)}
    told["memory_mb"] = round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    print(json.dumps(told))


if __name__ == "__main__":
    main()
