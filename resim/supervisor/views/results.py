"""Results, and one of them."""

from __future__ import annotations

from pathlib import Path

from starlette.requests import Request

from resim.jobs.lake import links_of
from resim.results.entry import KINDS
from resim.results.kpis import kpi_moments
from resim.results.lake import (
    LakeQuery,
    find_page,
)
from resim.results.queue import QueuedTask
from resim.results.reading import VERDICTS
from resim.results.scanning import is_utf8
from resim.supervisor import documents
from resim.supervisor.coverage import coverage_of
from resim.supervisor.parts import Supervisor
from resim.supervisor.views.common import (
    EACH,
    MOST_OUTCOMES,
    RESULTS,
    Told,
    choice_of,
    entry_of,
    first_of,
    link_to,
    links_in,
    maker_of,
    paging_of,
    refuse_unknown,
    starts_with,
    text_of,
)

MOST_PAGES = 20
"""Tasks whose pages the page of a result leads to."""


def results(supervisor: Supervisor, request: Request) -> Told:
    """All results, the newest first."""
    refuse_unknown(request, "text", "kind", "verdict", "first")
    kind, verdict = choice_of(request, "kind", RESULTS), choice_of(request, "verdict", VERDICTS)
    text, first = text_of(request, "text"), first_of(request)
    kinds = tuple(k for k in RESULTS if k == kind) or RESULTS
    page = find_page(supervisor.catalog, LakeQuery(text, kinds, verdict=verdict), first=first, most=EACH)
    return "results.html", {
        "results": page.items, "paging": paging_of(request, first, page), "text": text, "kind": kind,
        "verdict": verdict, "kinds": [*KINDS], "verdicts": VERDICTS,
    }  # fmt: skip


def result(supervisor: Supervisor, request: Request) -> Told:
    """One result: what went in, what came out, its pages."""
    entry = entry_of(supervisor, request.path_params["name"])
    state = entry.state()
    there = state in ("there", "changed")
    pages = documents.pages(entry.folder) if there else []
    linked = links_of(supervisor.catalog, entry)
    entry, links = linked.entry, links_in(supervisor, linked)
    held = supervisor.catalog.of_folder(entry.folder) if state == "changed" else []
    return "result.html", {
        "one": entry, "state": state, "pages": [p for p in pages if "/" not in p],
        "written": _pages_of_tasks(supervisor, entry.folder),
        "below": [p for p in pages if "/" in p], "data": _data(entry.folder) if there else [],
        "links": links, "outcomes": entry.outcomes[:MOST_OUTCOMES],
        "maker": maker_of(supervisor, entry.folder), "command": linked.command, "origin": linked.origin,
        "followers": [(item, link_to(item)) for item in linked.followers], "count": linked.count,
        "holds": next((e for e in held if e.id != entry.id and e.state() == "there"), None),
        "moments": kpi_moments(entry.folder) if there and entry.kind in ("run", "assessment") else [],
        "player": next((page for page in ("report.html", "assessment.html") if page in pages), ""),
        "starts": starts_with(supervisor, entry) if there else {},
        "drives": {i.name: links[k] for k, i in enumerate(entry.inputs) if i.role == "recording" and k in links},
        "coverage": coverage_of(entry) if entry.kind == "space" and there else None,
    }  # fmt: skip


def _pages_of_tasks(supervisor: Supervisor, folder: Path) -> list[tuple[QueuedTask, str]]:
    """The newest pages that tasks wrote of a result, such as that of a sweep, right in their folders."""
    every = supervisor.queue.done_with(str(folder), MOST_PAGES)
    return [(one, p) for one in every for p in documents.pages(Path(one.folder)) if "/" not in p]


def _data(folder: Path) -> list[str]:
    names = sorted(p.name for p in folder.iterdir() if p.suffix in (".json", ".xml", ".parquet", ".toml"))
    return [name for name in names if not name.startswith(".") and is_utf8(Path(name))]
