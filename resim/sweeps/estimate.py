"""How long a sweep takes and how large it is, by a few of its runs, driven as the sweep drives them."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import mean

import pandas as pd

from resim.execution.child import Failure
from resim.execution.workers import run_all
from resim.sweeps.execution import tasks
from resim.sweeps.file import Sweep
from resim.sweeps.tasks import SPREAD, RunBatch, RunResult, has_parts, in_batches, run

_ROUNDS, _ROUNDS_ALONE = 2, 4
"""Batches a worker that are tried, and where each is one run."""


@dataclass(frozen=True)
class SweepSample:
    """What some runs took.

    each: s of one run in its batch, None where all that were tried failed. seconds: of the whole sweep, the loading of
    libraries and the proof in SUMO included. size: bytes of a result. tried: runs that were done. failures: why runs
    failed, or ended before their time by the function's fault.
    """

    each: float | None
    seconds: float
    size: float
    tried: int
    failures: tuple[str, ...]


def sample(sweep: Sweep, wanted: pd.DataFrame, workers: int) -> SweepSample:
    """Do a few batches of a sweep as it does them, and say what all runs `wanted` take."""
    batches = in_batches(list(tasks(sweep, wanted)), workers)
    chosen = sampled(batches, workers)
    begin = time.monotonic()
    first, found = 0.0, list[tuple[int, tuple[RunResult, ...] | Failure]]()
    limit = sweep.file.time_limit
    for k, result in run_all(
        run, chosen, workers=min(workers, len(chosen)), time_limit=limit, has_parts=has_parts
    ):
        first = first or time.monotonic() - begin
        found.append((k, result))
    tried, failures = sum(len(chosen[k]) for k, _ in found), list[str]()
    for k, result in sorted(found, key=lambda one: one[0]):
        if isinstance(result, Failure):
            failures += [result.reason] * len(chosen[k])
        else:
            failures += [str(one.row["failure"]) for one in result if one.row["failure"] is not None]
    good = [result for _, result in found if not isinstance(result, Failure)]
    if not good:
        return SweepSample(None, 0.0, 0.0, tried, tuple(failures))
    warm = good[workers:] or good  # the first of each process loads what is compiled
    each = mean(one.time for batch in warm for one in batch)
    rounds = math.ceil(len(batches) / workers) * each * mean(map(len, batches))
    loading = max(first - sum(one.time for one in warm[0]), 0.0)
    size = mean(len(json.dumps(one.row)) for batch in good for one in batch) / 4.0  # as Parquet packs it
    seconds = loading + rounds + _proof(sweep, chosen[0], len(wanted), workers, len(batches))
    return SweepSample(each, seconds, size, tried, tuple(failures))


def sampled(batches: Sequence[RunBatch], workers: int) -> list[RunBatch]:
    """Give some of the batches of a sweep, evenly over all of them, so that they are of all recordings and builds."""
    rounds = _ROUNDS if max(map(len, batches)) > 1 else _ROUNDS_ALONE
    count = min(len(batches), rounds * workers)
    return [batches[k * len(batches) // count] for k in range(count)]


def _proof(sweep: Sweep, batch: RunBatch, runs: int, workers: int, batches: int) -> float:
    """How long [s] the runs of the engine "direct" take that are repeated in SUMO."""
    share = sweep.file.repeated_in_sumo
    if sweep.file.engine != "direct" or share == 0.0:
        return 0.0
    again = [(replace(one, engine="sumo"),) for one in batch[:2]]
    begin = time.monotonic()
    done = list(run_all(run, again, workers=1, time_limit=sweep.file.time_limit))
    times = [one.time for _, result in done if not isinstance(result, Failure) for one in result]
    loading = time.monotonic() - begin - sum(times)
    return loading + (min(times) if times else 0.0) * math.ceil(
        (min(batches, SPREAD) + share * runs) / workers
    )
