"""Runs of a sweep as they come, and the proof that those of the engine direct are what SUMO gives."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from itertools import chain
from typing import TypeGuard

from resim.core.errors import ResimError
from resim.execution.child import Failure
from resim.execution.journal import Journal
from resim.execution.workers import run_all
from resim.sweeps.engines import EnginesDifferError, refuse_difference, what_differs
from resim.sweeps.tasks import RunBatch, RunResult, RunTask, has_parts, in_batches, run, to_prove_first

NumberedResult = tuple[int, RunResult | Failure]
"""The number of a run, and what it came to."""

ATTEMPTS = 3
"""How often a run is tried whose process crashes."""


def kept_if_proved(file: Journal, results: Iterator[NumberedResult]) -> Iterator[NumberedResult]:
    """Give the results; where the engine's proof fails, set aside what the journal has: none of it can be believed."""
    try:
        yield from results
    except EnginesDifferError as e:
        aside = file.set_aside()
        raise EnginesDifferError(f"{e} The results so far are set aside, in {aside.name}.") from e


def proved(
    todo: list[RunTask], time_limit: float, workers: int, pool: Executor | None
) -> Iterator[NumberedResult]:
    """Give the result of each run by its number: first of those that prove a build's batches, then of all others.

    A batch with runs that are repeated in SUMO comes when they were, and are the same. Raises EnginesDifferError where
    one is not.
    """
    batches = in_batches(todo, workers)
    first = to_prove_first(batches)
    chosen = {batch[0].run for batch in first}
    for part in (first, [batch for batch in batches if batch[0].run not in chosen]):
        waiting = list[list[NumberedResult]]()
        for done in _tried(part, time_limit, workers, pool):
            if any(_is_to_be_repeated(result) for _, result in done):
                waiting.append(done)
            else:
                yield from done
        direct = {number: result for done in waiting for number, result in done if _is_to_be_repeated(result)}
        again = [(replace(task, engine="sumo"),) for batch in part for task in batch if task.run in direct]
        for number, result in chain.from_iterable(_tried(again, time_limit, workers, pool)):
            if isinstance(result, Failure):
                raise ResimError(
                    f"run {number} could not be repeated in SUMO: {result.reason}. Results so far are kept: resume "
                    'with --resume, or take engine = "sumo".'
                )
            refuse_difference(number, _difference(direct[number], result))
        yield from chain.from_iterable(waiting)


def _is_to_be_repeated(result: RunResult | Failure) -> TypeGuard[RunResult]:
    return not isinstance(result, Failure) and result.fingerprint is not None


def _difference(one: RunResult, other: RunResult) -> str:
    """Where a run and its repetition in SUMO are not the same."""
    if one.fingerprint is None or other.fingerprint is None:
        return "how it ended (another case)"
    return what_differs((one.fingerprint, one.row), (other.fingerprint, other.row))


def _tried(
    batches: Sequence[RunBatch], time_limit: float, workers: int, pool: Executor | None
) -> Iterator[list[NumberedResult]]:
    """Give the results of each batch; what crashes is tried again after all others.

    A batch without results is done again in halves, down to the run that is to blame.
    """
    tries = dict.fromkeys((task.run for batch in batches for task in batch), 0)
    while batches:
        again = list[RunBatch]()
        done = run_all(run, batches, workers=workers, time_limit=time_limit, pool=pool, has_parts=has_parts)
        for k, results in done:
            batch, half = batches[k], len(batches[k]) // 2
            if not isinstance(results, Failure):
                yield [(task.run, result) for task, result in zip(batch, results, strict=True)]
            elif half:
                again += [batch[:half], batch[half:]]
            else:
                number = batch[0].run
                tries[number] += 1
                if results.crashed and tries[number] < ATTEMPTS:
                    again.append(batch)
                else:
                    yield [(number, results)]
        batches = sorted(again, key=lambda batch: batch[0].run)
