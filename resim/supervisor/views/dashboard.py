"""The first page: what the machine does, what is queued, what failed last, what came out last."""

from __future__ import annotations

from starlette.requests import Request

from resim.results.lake import (
    LakeQuery,
    find_page,
)
from resim.supervisor.coverage import newest_coverage
from resim.supervisor.machine import machine_load
from resim.supervisor.parts import Supervisor
from resim.supervisor.views.common import (
    RESULTS,
    Told,
    progress_of,
    unfinished_by_state,
)

LATEST, LATEST_SPACES = 8, 3


def dashboard(supervisor: Supervisor, request: Request) -> Told:
    """What the machine does, what is queued, what failed last, what came out last."""
    newest = find_page(supervisor.catalog, LakeQuery(kinds=RESULTS), most=LATEST)
    unfinished = unfinished_by_state(supervisor)
    return "dashboard.html", {
        "machine": machine_load(supervisor.settings.tasks),
        "running": unfinished["running"],
        "progress": progress_of(unfinished["running"]),
        "waiting": unfinished["waiting"][:LATEST],
        "counts": supervisor.queue.counts(),
        "failed": supervisor.queue.ended(0, LATEST, bad=True),
        "newest": newest.items,
        "results": newest.count,
        "recordings": find_page(supervisor.catalog, LakeQuery(kinds=("recording",)), most=1).count,
        "jobs": supervisor.settings.jobs,
        "note": supervisor.settings.note if unfinished["running"] or unfinished["waiting"] else "",
        "spaces": newest_coverage(supervisor.catalog, LATEST_SPACES),
    }
