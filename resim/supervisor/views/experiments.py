"""Measured drives."""

from __future__ import annotations

from starlette.requests import Request

from resim.jobs.lake import links_of
from resim.results.lake import (
    LakePage,
    LakeQuery,
    find_page,
)
from resim.results.scanning import roots_of
from resim.supervisor.experiments import FILTERS, STEPS
from resim.supervisor.parts import Supervisor
from resim.supervisor.views.common import (
    EACH,
    RESULTS,
    MissingError,
    Told,
    choice_of,
    files_of,
    first_of,
    links_in,
    maker_of,
    paging_of,
    refuse_unknown,
    starts_with,
    text_of,
)


def experiments(supervisor: Supervisor, request: Request) -> Told:
    """All measured drives, by name and state."""
    refuse_unknown(request, "text", "state", "first")
    text, state, first = text_of(request, "text"), choice_of(request, "state", FILTERS), first_of(request)
    shown, page = supervisor.experiments.page(text, state, first, EACH)
    return "experiments.html", {
        "experiments": shown, "paging": paging_of(request, first, page), "text": text, "state": state,
        "steps": STEPS, "states": FILTERS, "scanned": supervisor.changes.scanned,
        "folders": [str(f) for f in roots_of(supervisor.catalog)],
    }  # fmt: skip


def experiment(supervisor: Supervisor, request: Request) -> Told:
    """One measured drive: its files, steps and results, and the jobs that can be started with it."""
    found = supervisor.experiments.get(request.path_params["name"][:40])
    if found is None:
        raise MissingError("There is no such recording.")
    one = found.item
    (entry,) = supervisor.catalog.entries([one.id])
    linked = links_of(supervisor.catalog, entry)
    told = LakeQuery(kinds=RESULTS, hashes=(one.digest,))
    results = find_page(supervisor.catalog, told, most=EACH) if one.digest else LakePage((), 0, False)
    return "experiment.html", {
        "one": one, "tables": found.tables, "rows": found.steps, "verified": found.verified, "steps": STEPS,
        "above": [("drives", one.id), *(("drives", r.id) for r in results.items if r.kind == "run")][:6],
        "results": results.items, "count": results.count, "starts": starts_with(supervisor, one),
        "entry": entry, "links": links_in(supervisor, linked), "files": files_of(entry),
        "maker": maker_of(supervisor, entry.folder),
    }  # fmt: skip
