"""What several views need: paging, what stands in an address, and what it names."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from starlette.exceptions import HTTPException
from starlette.requests import Request

from resim.core.errors import InputError, ResimError
from resim.jobs.lake import LakeLinks
from resim.results.builds import build_id
from resim.results.entry import KINDS, CatalogEntry
from resim.results.lake import LakeItem, LakePage, LakeQuery, find_page
from resim.results.queue import QueuedTask
from resim.supervisor.documents import Document, files_in, find_document
from resim.supervisor.growth import TaskProgress, task_progress
from resim.supervisor.parts import Supervisor

EACH = 50
"""Rows of a page."""
MOST_OUTCOMES = 500
RESULTS = tuple(KINDS)
ID = re.compile("[0-9a-f]{16}")
"""Of a task."""
Told = tuple[str, dict[str, Any]]


class MissingError(ResimError):
    """There is no such page."""


@dataclass(frozen=True)
class Paging:
    """Which rows of how many are shown, or of more than that; links to the pages before and behind, "" for none."""

    first: int
    last: int
    count: int
    before: str
    behind: str
    capped: bool = False


def paging(request: Request, first: int, shown: int, count: int, capped: bool = False) -> Paging:
    """Give which of `count` rows are shown, from number `first` on; capped: whether there may be more."""

    def link(start: int) -> str:
        given = {k: v for k, v in request.query_params.items() if k != "first"}
        return f"{request.url.path}?{urlencode({**given, 'first': str(start)})}"

    before = link(max(0, first - EACH)) if first > 0 else ""
    behind = link(first + EACH) if first + shown < count or capped else ""
    return Paging(first + 1 if shown else 0, first + shown, count, before, behind, capped)


def paging_of(request: Request, first: int, page: LakePage) -> Paging:
    """Give which rows a page of the lake shows."""
    return paging(request, first, len(page.items), page.count, page.capped)


def refuse_unknown(request: Request, *names: str) -> None:
    """Refuse an address with a filter that there is not: it would show more than was asked for."""
    if strange := [name for name in request.query_params if name not in names]:
        raise HTTPException(400, f"There is no filter {strange[0]:.60}. There are: {', '.join(names)}.")


def first_of(request: Request) -> int:
    """Give the number of the first row that an address asks for."""
    told = request.query_params.get("first", "0")
    if not (told.isascii() and told.isdigit() and len(told) < 10):
        raise HTTPException(400, f"first: is {told:.60}, expected the number of a row.")
    return int(told)


def choice_of(request: Request, name: str, choices: Iterable[str]) -> str:
    """Give one of several texts that stands in an address, "" where none does; any other one is refused."""
    told = text_of(request, name)
    if told and told not in (known := [*choices]):
        raise HTTPException(400, f"{name}: there is no {told:.60}. There are: {', '.join(known)}.")
    return told


def text_of(request: Request, name: str, most: int = 200) -> str:
    """Give a text that stands in an address, "" where none does."""
    return request.query_params.get(name, "")[:most]


def task_of(supervisor: Supervisor, name: str) -> QueuedTask:
    """Give a task by its id. Raises MissingError where there is none."""
    try:
        return supervisor.queue.get(name[:40])
    except InputError as e:
        if e.source != name[:40]:
            raise
        raise MissingError("There is no such task.") from e


def entry_of(supervisor: Supervisor, name: str) -> CatalogEntry:
    """Give a result by its id. Raises MissingError where there is none."""
    found = [e for e in supervisor.catalog.entries([name[:40]]) if e.kind in KINDS]
    if not found:
        raise MissingError("There is no such result.")
    return found[0]


def result_folder(supervisor: Supervisor, name: str) -> Path:
    """Give the folder of a result in the catalog, which holds one and is no link. Raises MissingError for any other."""
    entry = entry_of(supervisor, name)
    if entry.folder.is_symlink() or not (entry.folder / KINDS[entry.kind][0]).is_file():
        raise MissingError("The folder of this result is not here.")
    return entry.folder


def document_of(supervisor: Supervisor, kind: str, name: str, path: str) -> Document:
    """Give a file of a result, of a task or of something else in the lake. Raises MissingError or InputError."""
    if kind == "results":
        return find_document(result_folder(supervisor, name), path)
    if kind == "tasks":
        return find_document(Path(task_of(supervisor, name).folder), path)
    found = supervisor.catalog.entries([name[:40]]) if kind == "lake" else []
    if not found or (home := home_of(found[0])) is None:
        raise MissingError("There is no such page.")
    if found[0].kind != "recording" and path != found[0].folder.name:
        raise MissingError("There is no such file.")
    return find_document(home, path)


def home_of(entry: CatalogEntry) -> Path | None:
    """Give the folder of a recording, or in which a file of the lake lies; None where it is not here, or a link."""
    is_input = entry.kind not in KINDS and entry.kind != "cluster"
    is_here = entry.host == platform.node() and os.path.realpath(entry.folder) == str(entry.folder)
    return entry.home if is_input and is_here and entry.folder.exists() else None


def files_of(entry: CatalogEntry) -> list[tuple[str, int]]:
    """Give the files of a recording, or the one that something else in the lake is, with their sizes [bytes]."""
    if (home := home_of(entry)) is None:
        return []
    if entry.kind == "recording":
        return files_in(home)
    with suppress(InputError, OSError):
        return [(entry.folder.name, find_document(home, entry.folder.name).path.stat().st_size)]
    return []


def unfinished_by_state(supervisor: Supervisor) -> dict[str, list[QueuedTask]]:
    """Give what pauses, runs and waits, each in its order."""
    found: dict[str, list[QueuedTask]] = {"paused": [], "running": [], "waiting": []}
    for one in supervisor.queue.unfinished():
        found[one.state].append(one)
    return found


def progress_of(running: Iterable[QueuedTask]) -> dict[str, TaskProgress]:
    """Give how far running tasks are, by id; those that say so."""
    found = {task.id: task_progress(Path(task.folder)) for task in running}
    return {name: progress for name, progress in found.items() if progress is not None}


def starts_with(supervisor: Supervisor, item: LakeItem | CatalogEntry) -> dict[str, list[tuple[str, str]]]:
    """Give the jobs that can be started with something, by groups: each with the parameter that takes it.

    None where it is on another machine, or cannot be used.
    """
    found: dict[str, list[tuple[str, str]]] = {}
    here = item.host == supervisor.queue.host and not item.fault
    ours = Path(item.folder).is_relative_to(supervisor.settings.tasks)
    for form in supervisor.settings.forms if here else ():
        taking = [f.name for f in form.fields if item.kind in f.of and (ours or not f.own)]
        if taking:
            found.setdefault(form.group, []).append((form.name, taking[0]))
    return found


def link_to(item: LakeItem) -> str:
    """Give the address of the page of something."""
    if item.kind in KINDS:
        return f"/results/{item.id}"
    return f"/experiments/{item.id}" if item.kind == "recording" else f"/lake/{item.id}"


def links_in(supervisor: Supervisor, linked: LakeLinks) -> dict[int, str]:
    """Give the addresses of the pages of what something follows from, by its place among these.

    What is named without a hash is what lies at its path.
    """
    entry = linked.entry
    found = {k: link_to(items[0]) for k, (_, items) in enumerate(linked.origins) if items}
    unsure = {k: i.path for k, i in enumerate(entry.inputs) if i.path and not i.hash}
    known = at_paths(supervisor, unsure.values())
    found |= {k: link_to(known[path]) for k, path in unsure.items() if path in known}
    builds = {
        k: f"/builds/{build_id(i.name, i.hash)}"
        for k, i in enumerate(entry.inputs) if i.role in ("build", "against")
    }  # fmt: skip
    return found | (builds if entry.kind in KINDS else {})


def at_paths(supervisor: Supervisor, paths: Iterable[str]) -> dict[str, LakeItem]:
    """Give what the lake has at some paths of this machine, by path: the newest of each."""
    wanted = tuple(sorted(set(paths)))[:MOST_OUTCOMES]
    if not wanted:
        return {}
    query = LakeQuery(folders=wanted, host=supervisor.queue.host)
    every = find_page(supervisor.catalog, query, most=2 * MOST_OUTCOMES).items
    return {item.folder: item for item in reversed(every) if item.kind != "cluster"}


def maker_of(supervisor: Supervisor, folder: Path) -> QueuedTask | None:
    """Give the task that wrote something, None where none did."""
    for above in [*folder.parents][:3]:
        if not ID.fullmatch(above.name):
            continue
        with suppress(InputError):
            found = supervisor.queue.get(above.name)
            if Path(found.folder) == above:
                return found
    return None
