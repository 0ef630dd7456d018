"""Tasks, and one of them, as it runs, too."""

from __future__ import annotations

import shlex
from pathlib import Path

from starlette.requests import Request

from resim.results.queue import ENDED
from resim.supervisor import documents
from resim.supervisor.events import read_log
from resim.supervisor.growth import task_progress
from resim.supervisor.parts import Supervisor
from resim.supervisor.runner import LOG
from resim.supervisor.views.common import (
    EACH,
    Told,
    first_of,
    paging,
    task_of,
    text_of,
    unfinished_by_state,
)


def tasks(supervisor: Supervisor, request: Request) -> Told:
    """What runs, what waits, and what ended."""
    first, counts = first_of(request), supervisor.queue.counts()
    ended = supervisor.queue.ended(first, EACH)
    count = sum(n for state, n in counts.items() if state in ENDED)
    return "tasks.html", {
        **unfinished_by_state(supervisor), "ended": ended, "paging": paging(request, first, len(ended), count),
        "kept": [form.name for form in supervisor.settings.forms if form.kept],
    }  # fmt: skip


def task(supervisor: Supervisor, request: Request) -> Told:
    """One task: how it is, its command, its log, what it wrote."""
    one = task_of(supervisor, request.path_params["name"])
    folder = Path(one.folder)
    log, end = read_log(folder / LOG, 0)
    form = supervisor.forms.get(one.job)
    made = folder / form.result if form is not None and form.result else None
    entry = None
    if made is not None and made.is_dir():
        entry = next(iter(supervisor.catalog.of_folder(made)), None)
    return "task.html", {
        "one": one, "log": log, "end": end, "command": f"resim {shlex.join(one.call)}", "entry": entry,
        "pages": documents.pages(folder) if one.state in ENDED and entry is None else [],
        "progress": task_progress(folder) if one.state not in ("done", "bad") else None,
        "so_far": supervisor.sweeps.look(made) if made is not None and entry is None else None,
    }  # fmt: skip


def live(supervisor: Supervisor, request: Request) -> Told:
    """A task that simulates, as it does; what else runs, and what waits."""
    unfinished, asked = unfinished_by_state(supervisor), text_of(request, "task")
    one = task_of(supervisor, asked) if asked else next(iter(unfinished["running"]), None)
    return "live.html", {"one": one, **unfinished}
