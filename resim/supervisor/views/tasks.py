"""Tasks, and one of them, as it runs, too."""

from __future__ import annotations

import shlex
from pathlib import Path

from starlette.requests import Request

from resim.core.watched import LOG
from resim.results.entry import KINDS
from resim.results.lake import LakeItem, items_below
from resim.results.queue import ENDED, QueuedTask
from resim.supervisor import documents
from resim.supervisor.events import read_log
from resim.supervisor.growth import task_progress
from resim.supervisor.parts import Supervisor
from resim.supervisor.runner import OWN_FILES
from resim.supervisor.views.common import (
    EACH,
    Told,
    at_paths,
    first_of,
    link_to,
    paging,
    progress_of,
    refuse_unknown,
    task_of,
    text_of,
    unfinished_by_state,
)


def tasks(supervisor: Supervisor, request: Request) -> Told:
    """What runs, what waits, and what ended."""
    refuse_unknown(request, "first")
    first, counts = first_of(request), supervisor.queue.counts()
    unfinished = unfinished_by_state(supervisor)
    ended = supervisor.queue.ended(first, EACH)
    count = sum(n for state, n in counts.items() if state in ENDED)
    return "tasks.html", {
        **unfinished, "ended": ended, "paging": paging(request, first, len(ended), count),
        "progress": progress_of(unfinished["running"]),
        "kept": [form.name for form in supervisor.settings.forms if form.kept],
    }  # fmt: skip


def task(supervisor: Supervisor, request: Request) -> Told:
    """One task: how it is, its command, its log, what it wrote."""
    one = task_of(supervisor, request.path_params["name"])
    folder = Path(one.folder)
    log, end = read_log(folder / LOG, 0)
    made, entry = supervisor.made_by(one), None
    if made is not None and made.is_dir():
        entry = next((e for e in supervisor.catalog.of_folder(made) if e.kind in KINDS), None)
    return "task.html", {
        "one": one, "log": log, "end": end, "command": f"resim {shlex.join(one.call)}", "entry": entry,
        "files": documents.files_in(folder, OWN_FILES) if one.state in ENDED and entry is None else [],
        "given": [(item, link_to(item)) for item in at_paths(supervisor, _paths(one)).values()],
        "made": [(item, link_to(item)) for item in _made(supervisor, made)],
        "progress": task_progress(folder) if one.state not in ("done", "bad") else None,
        "so_far": supervisor.sweeps.look(made) if made is not None and entry is None else None,
    }  # fmt: skip


def _paths(task: QueuedTask) -> list[str]:
    """The paths that a command is given, and the folders of those that are files in results."""
    words = (word.partition("=")[2] if word.startswith("--") else word for word in task.words)
    paths = [word for word in words if word.startswith("/") and not word.startswith(f"{task.folder}/")]
    return [*paths, *(str(Path(path).parent) for path in paths if path.endswith("verification.json"))]


def _made(supervisor: Supervisor, made: Path | None) -> list[LakeItem]:
    """What the lake knows of what a task made; results aside, which have a link of their own."""
    every = [] if made is None else items_below(supervisor.catalog, str(made), most=EACH)
    return [item for item in every if item.kind not in (*KINDS, "cluster")]


def live(supervisor: Supervisor, request: Request) -> Told:
    """A task that simulates, as it does; what else runs, and what waits."""
    unfinished, asked = unfinished_by_state(supervisor), text_of(request, "task")
    one = task_of(supervisor, asked) if asked else next(iter(unfinished["running"]), None)
    return "live.html", {"one": one, **unfinished}
