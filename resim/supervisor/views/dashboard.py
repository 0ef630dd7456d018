"""The first page: what the machine does, what is queued, what failed last, what came out last."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

from starlette.requests import Request

from resim.results.lake import (
    LakeQuery,
    find_page,
)
from resim.results.queue import QueuedTask
from resim.supervisor.coverage import newest_coverage
from resim.supervisor.machine import machine_load
from resim.supervisor.parts import Supervisor
from resim.supervisor.processes import number_of
from resim.supervisor.views.common import (
    RESULTS,
    Told,
    progress_of,
    unfinished_by_state,
)

LATEST, LATEST_SPACES = 8, 3
JUDGED = tuple(kind for kind in RESULTS if kind not in ("mining", "space"))
"""Kinds of results that come to a verdict."""


@dataclass(frozen=True)
class WorkerState:
    """A server that does tasks. places: for how many at once, None where another server does not say. heard: when it
    said last that it is there [s since 1970].
    """

    host: str
    process: int
    is_own: bool
    tasks: tuple[QueuedTask, ...]
    places: int | None
    heard: float


def workers(supervisor: Supervisor, running: Sequence[QueuedTask]) -> list[WorkerState]:
    """Give this server, and all others on the catalog that do something now."""
    own, host = supervisor.worker.server, supervisor.queue.host
    by_server: dict[tuple[str, str], list[QueuedTask]] = {(host, own): []}
    for task in running:
        by_server.setdefault((task.host, task.server), []).append(task)
    return [
        WorkerState(
            where, number_of(server), server == own, tuple(tasks),
            supervisor.settings.jobs if server == own else None,
            time.time() if server == own else max(task.beat for task in tasks),
        )
        for (where, server), tasks in by_server.items()
    ]  # fmt: skip


def dashboard(supervisor: Supervisor, request: Request) -> Told:
    """What the machine does, what is queued, what failed last, what came out last."""
    newest = find_page(supervisor.catalog, LakeQuery(kinds=JUDGED), most=LATEST)
    unfinished = unfinished_by_state(supervisor)
    return "dashboard.html", {
        "machine": machine_load(supervisor.settings.tasks, supervisor.changes.busy),
        "running": unfinished["running"],
        "progress": progress_of(unfinished["running"]),
        "waiting": unfinished["waiting"][:LATEST],
        "counts": supervisor.queue.counts(),
        "failed": supervisor.queue.ended(0, LATEST, bad=True),
        "newest": newest.items,
        "results": find_page(supervisor.catalog, LakeQuery(kinds=RESULTS), most=0).count,
        "recordings": find_page(supervisor.catalog, LakeQuery(kinds=("recording",)), most=0).count,
        "workers": workers(supervisor, unfinished["running"]),
        "note": supervisor.settings.note if unfinished["running"] or unfinished["waiting"] else "",
        "spaces": newest_coverage(supervisor.catalog, LATEST_SPACES),
    }
