"""A study run: one recording after the other is mined in this process, then the scenarios of all fitted in many."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from resim.core.errors import ResimError
from resim.execution.child import Failure
from resim.execution.workers import run_all
from resim.mining.report import MinedFailure
from resim.mining.scenario_files import FitTask, fit_scenario
from resim.mining.study import MinedPart, StudyOptions, finish_part, mine_into, pending_fits


def mine_all(
    named: Mapping[str, Path], out: Path, options: StudyOptions, workers: int
) -> Iterator[MinedPart | MinedFailure]:
    """Mine recordings by their names, and give each when it is finished, or why it is not.

    What is in memory does not grow with how many there are, but for a name and two paths of each scenario.
    """
    waiting: list[MinedPart] = []
    for name, folder in named.items():
        try:
            with contextlib.chdir("."):
                part = mine_into(folder, name, out, options)
        except ResimError as e:
            yield MinedFailure(name, str(folder), str(e))
            continue
        if pending_fits(out, name):
            waiting.append(part)
        else:
            yield finish_part(out, part, {})
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
