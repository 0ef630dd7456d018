"""What was made of each measured drive: a row for GT and one for SD, with what was found and what is missing."""

from __future__ import annotations

import hashlib
import threading
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Literal

from resim.results.overview import CatalogOverview, OutcomeOf
from resim.results.queue import QueuedTask, TaskQueue
from resim.results.reading import VERIFIED
from resim.supervisor.places import RegisteredFile, RegisteredFolders
from resim.supervisor.words import tone

CellState = Literal["good", "bad", "unsure", "done", "running", "waiting", "missing", "unknown"]
"""done: it is there, and nothing was judged. unknown: it cannot be told (yet)."""
STEPS = ("recorded", "assessed", "re-simulated")
_JOBS = {"assess": "assessed", "run": "re-simulated", "verify": "verified"}
_SOURCES = {("GT", "assessed"): "GT", ("GT", "re-simulated"): "rGT", ("SD", "assessed"): "SD",
            ("SD", "re-simulated"): "rSD"}  # fmt: skip
RECENT = 300
"""Tasks that ended whose failures are shown."""


@dataclass(frozen=True)
class StepCell:
    """How far a step is. words: what came out. link: address of what stands behind it, "" for nothing."""

    state: CellState
    words: str
    link: str = ""


@dataclass(frozen=True)
class Experiment:
    """A measured drive.

    id: 16 hex digits. file: where it is registered, None for one that the catalog alone knows. steps: by row (GT, SD)
    and step. verified: of both rows.
    """

    id: str
    name: str
    place: str
    hash: str
    file: RegisteredFile | None
    steps: Mapping[tuple[str, str], StepCell]
    verified: StepCell

    @property
    def states(self) -> set[CellState]:
        """All states that a step of it has."""
        return {self.verified.state, *(cell.state for cell in self.steps.values())}


class Experiments:
    """All measured drives, put together anew when anything changed."""

    def __init__(self, overview: CatalogOverview, queue: TaskQueue, folders: RegisteredFolders) -> None:
        self._overview, self._queue, self._folders = overview, queue, folders
        self._lock = threading.Lock()
        self._known: tuple[object, list[Experiment]] = (None, [])

    def all(self) -> list[Experiment]:
        """Give all, by name. Raises InputError where the catalog cannot be read."""
        version = (self._overview.version(), self._queue.version(), self._folders.version)
        with self._lock:
            if self._known[0] != version:
                self._known = (version, self._made())
            return self._known[1]

    def _made(self) -> list[Experiment]:
        files = self._folders.all("recording")
        registered = {f.hash for f in files}
        others = [r for r in self._overview.inputs("recording") if r.hash and r.hash not in registered]
        outcomes: dict[str, list[OutcomeOf]] = defaultdict(list)
        for outcome in self._overview.of_recordings([*registered, *(r.hash for r in others)]):
            outcomes[outcome.hash].append(outcome)
        tasks = [*self._queue.unfinished(), *self._queue.ended(0, RECENT, bad=True)]
        found = [_registered(f, outcomes[f.hash] if f.hash else [], tasks) for f in files]
        for other in others:
            name = hashlib.sha256(f"{other.name}\n{other.hash}".encode()).hexdigest()[:16]
            steps = _steps(None, outcomes[other.hash], {})
            place = other.path or "its folder is not registered"
            found.append(
                Experiment(
                    name, other.name, place, other.hash, None, steps, _verified(outcomes[other.hash], {})
                )
            )
        return sorted(found, key=lambda e: (e.name, e.place))


def _registered(
    file: RegisteredFile, outcomes: Sequence[OutcomeOf], tasks: Iterable[QueuedTask]
) -> Experiment:
    at_work: dict[str, QueuedTask] = {}
    for (
        task
    ) in tasks:  # those that run come first, then those that wait, then those that failed, the latest first
        step = _JOBS.get(task.job)
        if step is not None and str(file.path) in task.words:
            at_work.setdefault(step, task)
    steps = _steps(file, outcomes, at_work)
    return Experiment(file.id, file.name, file.place, file.hash, file, steps, _verified(outcomes, at_work))


def _steps(
    file: RegisteredFile | None, outcomes: Sequence[OutcomeOf], tasks: Mapping[str, QueuedTask]
) -> dict[tuple[str, str], StepCell]:
    steps: dict[tuple[str, str], StepCell] = {}
    for row in ("GT", "SD"):
        steps[row, "recorded"] = _recorded(file, row)
        for step in STEPS[1:]:
            source = _SOURCES[row, step]
            found = next((o for o in outcomes if o.source == source), None)
            there = file is None or row.lower() in file.tables
            steps[row, step] = _cell(found, tasks.get(step) if there else None, there)
    return steps


def _recorded(file: RegisteredFile | None, row: str) -> StepCell:
    if file is None:
        return StepCell("unknown", "not registered")
    if row.lower() not in file.tables:
        return StepCell("bad" if row == "GT" else "missing", "no file")
    if file.fault:
        return StepCell("bad", "cannot be read")
    return StepCell("done", "there") if file.hash else StepCell("unknown", "being read")


def _verified(outcomes: Sequence[OutcomeOf], tasks: Mapping[str, QueuedTask]) -> StepCell:
    """The newest verification; that two builds are the same in a comparison verifies neither."""
    found = next((o for o in outcomes if o.kind == "verification" and o.verdict in VERIFIED), None)
    return _cell(found, tasks.get("verified"), True)


def _cell(found: OutcomeOf | None, task: QueuedTask | None, there: bool) -> StepCell:
    """A step by what the newest result says, unless a task is at it, or failed later."""
    if task is not None and task.state in ("running", "waiting"):
        return StepCell("running" if task.state == "running" else "waiting", task.state, f"/tasks/{task.id}")
    if task is not None and task.state in ("failed", "lost") and (found is None or _is_later(task, found)):
        return StepCell("bad", "error", f"/tasks/{task.id}")
    if found is None:
        return StepCell("missing", "not yet" if there else "–")
    link = f"/results/{found.result}"
    states: dict[str, CellState] = {"pass": "good", "fail": "bad", "failed": "bad", "invalid": "unsure"}
    return StepCell(states.get(tone(found.verdict), "done"), found.verdict or "done", link)


def _is_later(task: QueuedTask, found: OutcomeOf) -> bool:
    return (task.ended or 0.0) > datetime.fromisoformat(found.written).timestamp()
