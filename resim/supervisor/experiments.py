"""What was made of each measured drive: a row for GT and one for SD, with what was found and what is missing."""

from __future__ import annotations

import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import Literal

from resim.core.errors import ResimError
from resim.results.catalog import Catalog
from resim.results.lake import LakeItem, LakePage, LakeQuery, facts_of, find_page, items_with
from resim.results.overview import CatalogOverview, OutcomeOf
from resim.results.queue import QueuedTask, TaskQueue
from resim.results.reading import VERDICTS, VERIFIED
from resim.results.tones import tone
from resim.verification.suite import read_suite

CellState = Literal["good", "bad", "unsure", "done", "running", "waiting", "missing"]
"""done: it is there, and nothing was judged."""
STEPS = ("recorded", "assessed", "re-simulated")
_JOBS = {"assess": "assessed", "run": "re-simulated", "verify": "verified"}
_SOURCES = {("GT", "assessed"): "GT", ("GT", "re-simulated"): "rGT", ("SD", "assessed"): "SD",
            ("SD", "re-simulated"): "rSD"}  # fmt: skip
_STATES: Mapping[str, CellState] = {"pass": "good", "fail": "bad", "failed": "bad", "invalid": "unsure"}
"""By tone of the verdict."""
FILTERS: Mapping[str, str] = {
    "good": "good", "bad": "bad", "unsure": "not decided", "running": "running", "waiting": "waiting",
    "missing": "nothing done yet",
}  # fmt: skip
"""States by which drives are filtered, in words."""
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
    """A measured drive. tables: that it has. steps: by row (GT, SD) and step. verified: of both rows."""

    item: LakeItem
    tables: tuple[str, ...]
    steps: Mapping[tuple[str, str], StepCell]
    verified: StepCell


class Experiments:
    """Measured drives, a page at a time. Every method raises InputError where the catalog cannot be read."""

    def __init__(self, catalog: Catalog, queue: TaskQueue) -> None:
        self._catalog, self._queue = catalog, queue

    def page(self, text: str, state: str, first: int, most: int) -> tuple[list[Experiment], LakePage]:
        """Give some drives by name, those alone with a step in a state; "" for any."""
        found = find_page(self._catalog, self._query(text, state), sort="name", first=first, most=most)
        return self._made(found.items), found

    def get(self, name: str) -> Experiment | None:
        """Give a drive by its id, None where there is none."""
        found = [i for i in items_with(self._catalog, [name]) if i.kind == "recording"]
        return self._made(found)[0] if found else None

    def _query(self, text: str, state: str) -> LakeQuery:
        verdicts = tuple(v for v in VERDICTS if state and _STATES.get(tone(v)) == state)
        judged = False if state == "missing" else None
        folders = None
        if state in ("running", "waiting"):
            tasks = [t for t in self._queue.unfinished() if t.state == state and t.job in _JOBS]
            folders = tuple(sorted({path for t in tasks for path in _drives_of(t)}))
        return LakeQuery(text, ("recording",), verdicts=verdicts, judged=judged, folders=folders)

    def _made(self, items: Sequence[LakeItem]) -> list[Experiment]:
        outcomes: dict[str, list[OutcomeOf]] = {}
        for outcome in CatalogOverview(self._catalog).newest_of(i.digest for i in items):
            outcomes.setdefault(outcome.hash, []).append(outcome)
        tables = facts_of(self._catalog, [i.id for i in items], "table")
        unfinished = [t for t in self._queue.unfinished() if t.state != "paused"]
        tasks = [*unfinished, *self._queue.ended(0, RECENT, bad=True)]
        return [_experiment(i, tuple(tables.get(i.id, ())), outcomes.get(i.digest, []), tasks) for i in items]


def _experiment(
    item: LakeItem, tables: tuple[str, ...], outcomes: Sequence[OutcomeOf], tasks: Sequence[QueuedTask]
) -> Experiment:
    at_work: dict[str, QueuedTask] = {}
    for (
        task
    ) in tasks:  # those that run come first, then those that wait, then those that failed, the latest first
        step = _JOBS.get(task.job)
        if step is not None and item.folder in _drives_of(task):
            at_work.setdefault(step, task)
    steps: dict[tuple[str, str], StepCell] = {}
    for row in ("GT", "SD"):
        there = row.lower() in tables
        steps[row, "recorded"] = _recorded(item, row, there)
        for step in STEPS[1:]:
            found = [o for o in outcomes if o.source == _SOURCES[row, step]]
            steps[row, step] = _cell(found, at_work.get(step) if there else None, there)
    verified = [o for o in outcomes if o.kind == "verification" and o.verdict in VERIFIED]
    return Experiment(item, tables, steps, _cell(verified, at_work.get("verified"), True))


def _drives_of(task: QueuedTask) -> frozenset[str]:
    """The paths that a task is given; of a suite those of its drives, too."""
    paths = frozenset(word for word in task.words if word.startswith("/"))
    if task.job != "verify":
        return paths
    return paths.union(*(_drives_in(path, _stamp(path)) for path in paths if path.endswith(".toml")))


def _stamp(path: str) -> int:
    try:
        return Path(path).stat().st_mtime_ns
    except OSError:
        return 0


@lru_cache(maxsize=100)
def _drives_in(suite: str, stamp: int) -> frozenset[str]:
    """The drives of a suite as it was at a time; none of one that cannot be read."""
    try:
        return frozenset(os.path.realpath(folder) for folder in read_suite(Path(suite)).folders.values())
    except (ResimError, OSError):
        return frozenset()


def _recorded(item: LakeItem, row: str, there: bool) -> StepCell:
    if item.fault:
        return StepCell("bad", "cannot be read", f"/experiments/{item.id}")
    if not there:
        return StepCell("bad" if row == "GT" else "missing", "no file")
    names = (
        [f"{row.lower()}.{suffix}" for suffix in ("csv", "parquet")] if item.host == platform.node() else []
    )
    name = next((name for name in names if (Path(item.folder) / name).is_file()), None)
    return StepCell("done", "there", "" if name is None else f"/open/lake/{item.id}/{name}")


def _cell(outcomes: Sequence[OutcomeOf], task: QueuedTask | None, there: bool) -> StepCell:
    """A step by what the newest result says, unless a task is at it, or failed later.

    outcomes: the newest first. What was not judged takes no verdict away that was there before.
    """
    newest = outcomes[0] if outcomes else None
    found = next((o for o in outcomes if o.verdict), newest)
    if task is not None and task.state in ("running", "waiting"):
        return StepCell("running" if task.state == "running" else "waiting", task.state, f"/tasks/{task.id}")
    if task is not None and task.state in ("failed", "lost") and (newest is None or _is_later(task, newest)):
        return StepCell("bad", "error", f"/tasks/{task.id}")
    if found is None:
        return StepCell("missing", "not yet" if there else "–")
    later = "" if found is newest else ", then not judged"
    words = f"{found.verdict or 'done'}{later}"
    return StepCell(_STATES.get(tone(found.verdict), "done"), words, f"/results/{found.result}")


def _is_later(task: QueuedTask, found: OutcomeOf) -> bool:
    return (task.ended or 0.0) > datetime.fromisoformat(found.written).timestamp()
