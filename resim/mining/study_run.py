"""A study run: recordings are mined one after the other, then the scenarios of all are fitted in many processes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from resim.execution.child import Failure
from resim.execution.workers import run_all
from resim.mining.report import MinedFailure
from resim.mining.scenario_files import FitTask, fit_scenario
from resim.mining.study import MinedPart, finish_part, pending_fits


def finished(
    mined: Iterable[MinedPart | MinedFailure], out: Path, workers: int
) -> Iterator[MinedPart | MinedFailure]:
    """Give each recording when its scenarios are fitted, or why it is not mined.

    What is in memory does not grow with how many there are, but for a name and two paths of each scenario.
    """
    waiting: list[MinedPart] = []
    for told in mined:
        if isinstance(told, MinedFailure):
            yield told
        elif pending_fits(out, told.recording):
            waiting.append(told)
        else:
            yield finish_part(out, told, {})
    yield from _fitted(out, waiting, workers)


def _fitted(out: Path, parts: Sequence[MinedPart], workers: int) -> Iterator[MinedPart | MinedFailure]:
    """Fit what is still to be fitted, and finish each part when all of it is."""
    tasks: list[FitTask] = []
    owner: list[MinedPart] = []
    left: dict[str, int] = {}
    for part in parts:
        own = pending_fits(out, part.recording)
        tasks.extend(own)
        owner.extend([part] * len(own))
        left[part.recording] = len(own)
    why: dict[str, dict[str, str]] = {part.recording: {} for part in parts}
    broken: dict[str, str] = {}
    for k, told in _results(tasks, min(workers, len(tasks))):
        part = owner[k]
        if isinstance(told, Failure):
            broken[part.recording] = told.reason
        elif told:
            why[part.recording][tasks[k].file.name] = told
        left[part.recording] -= 1
        if left[part.recording]:
            continue
        if part.recording in broken:
            yield MinedFailure(part.recording, part.folder, f"a fit broke off: {broken[part.recording]}")
        else:
            yield finish_part(out, part, why[part.recording])


def _results(tasks: Sequence[FitTask], workers: int) -> Iterator[tuple[int, str | Failure]]:
    """What comes of each fit, with its place: in this process, or in several."""
    if workers > 1:
        yield from run_all(fit_scenario, tasks, workers=workers, time_limit=float("inf"))
    else:
        yield from ((k, fit_scenario(task)) for k, task in enumerate(tasks))
