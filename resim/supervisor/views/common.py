"""What several views need: paging, what stands in an address, and what it names."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from starlette.requests import Request

from resim.core.errors import InputError, ResimError
from resim.jobs.lake import LakeLinks
from resim.results.entry import KINDS, CatalogEntry
from resim.results.lake import LakeItem, LakePage
from resim.results.queue import QueuedTask
from resim.supervisor.builds import build_id
from resim.supervisor.parts import Supervisor

EACH = 50
"""Rows of a page."""
MOST_OUTCOMES = 500
RESULTS = tuple(KINDS)
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


def first_of(request: Request) -> int:
    """Give the number of the first row that an address asks for."""
    told = request.query_params.get("first", "0")
    return int(told) if told.isascii() and told.isdigit() and len(told) < 10 else 0


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
    """Give the folder of a result that the catalog knows, and that holds one. Raises MissingError for any other."""
    entry = entry_of(supervisor, name)
    if not (entry.folder / KINDS[entry.kind][0]).is_file():
        raise MissingError("The folder of this result is not here.")
    return entry.folder


def folder_of(supervisor: Supervisor, kind: str, name: str) -> Path:
    """Give the folder in which documents of a result or a task lie. Raises MissingError for any other."""
    if kind == "results":
        return result_folder(supervisor, name)
    if kind == "tasks":
        return Path(task_of(supervisor, name).folder)
    raise MissingError("There is no such page.")


def unfinished_by_state(supervisor: Supervisor) -> dict[str, list[QueuedTask]]:
    """Give what pauses, runs and waits, each in its order."""
    found: dict[str, list[QueuedTask]] = {"paused": [], "running": [], "waiting": []}
    for one in supervisor.queue.unfinished():
        found[one.state].append(one)
    return found


def link_to(item: LakeItem) -> str:
    """Give the address of the page of something."""
    if item.kind in KINDS:
        return f"/results/{item.id}"
    return f"/experiments/{item.id}" if item.kind == "recording" else f"/lake/{item.id}"


def links_in(linked: LakeLinks) -> dict[int, str]:
    """Give the addresses of the pages of what something follows from, by its place among these."""
    entry = linked.entry
    found = {k: link_to(items[0]) for k, (_, items) in enumerate(linked.origins) if items}
    builds = {
        k: f"/builds/{build_id(i.name, i.hash)}" for k, i in enumerate(entry.inputs) if i.role == "build"
    }
    return found | (builds if entry.kind in KINDS else {})
