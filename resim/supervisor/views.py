"""The pages: which template, and what it is told. What they show is read elsewhere."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

from starlette.requests import Request

from resim.core.errors import InputError, ResimError
from resim.jobs.lake import links_of
from resim.results.entry import KINDS, CatalogEntry
from resim.results.lake import (
    ITEM_KINDS,
    SORTS,
    LakeItem,
    LakePage,
    LakeQuery,
    SortKey,
    find_page,
    with_content,
)
from resim.results.queue import ENDED, QueuedTask
from resim.results.reading import VERDICTS
from resim.results.scanning import is_utf8, roots_of
from resim.supervisor import documents
from resim.supervisor.builds import KnownBuild, build_id, known_builds, pairs
from resim.supervisor.coverage import newest_coverage
from resim.supervisor.events import read_log
from resim.supervisor.experiments import STEPS
from resim.supervisor.forms import FormField
from resim.supervisor.machine import machine_load
from resim.supervisor.parts import Supervisor
from resim.supervisor.runner import LOG

EACH = 50
"""Rows of a page."""
MOST_OUTCOMES = 500
MOST_OPTIONS = 1_000
LATEST, LATEST_SPACES = 8, 3
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


def _paging(request: Request, first: int, shown: int, count: int, capped: bool = False) -> Paging:
    def link(start: int) -> str:
        given = {k: v for k, v in request.query_params.items() if k != "first"}
        return f"{request.url.path}?{urlencode({**given, 'first': str(start)})}"

    before = link(max(0, first - EACH)) if first > 0 else ""
    behind = link(first + EACH) if first + shown < count or capped else ""
    return Paging(first + 1 if shown else 0, first + shown, count, before, behind, capped)


def _paging_of(request: Request, first: int, page: LakePage) -> Paging:
    return _paging(request, first, len(page.items), page.count, page.capped)


def _first(request: Request) -> int:
    told = request.query_params.get("first", "0")
    return int(told) if told.isascii() and told.isdigit() and len(told) < 10 else 0


def _text(request: Request, name: str, most: int = 200) -> str:
    return request.query_params.get(name, "")[:most].replace("\0", "")


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


def _unfinished(supervisor: Supervisor) -> dict[str, list[QueuedTask]]:
    """Give what pauses, runs and waits, each in its order."""
    found: dict[str, list[QueuedTask]] = {"paused": [], "running": [], "waiting": []}
    for one in supervisor.queue.unfinished():
        found[one.state].append(one)
    return found


# dashboard


def dashboard(supervisor: Supervisor, request: Request) -> Told:
    """What the machine does, what is queued, what failed last, what came out last."""
    newest = find_page(supervisor.catalog, LakeQuery(kinds=RESULTS), most=LATEST)
    unfinished = _unfinished(supervisor)
    return "dashboard.html", {
        "machine": machine_load(supervisor.settings.tasks),
        "running": unfinished["running"],
        "waiting": unfinished["waiting"][:LATEST],
        "counts": supervisor.queue.counts(),
        "failed": supervisor.queue.ended(0, LATEST, bad=True),
        "newest": newest.items,
        "results": newest.count,
        "recordings": find_page(supervisor.catalog, LakeQuery(kinds=("recording",)), most=1).count,
        "jobs": supervisor.settings.jobs,
        "spaces": newest_coverage(supervisor.catalog, LATEST_SPACES),
    }


# experiments


def experiments(supervisor: Supervisor, request: Request) -> Told:
    """All measured drives, by name and state."""
    text, state, first = _text(request, "text"), _text(request, "state"), _first(request)
    shown, page = supervisor.experiments.page(text, state, first, EACH)
    return "experiments.html", {
        "experiments": shown, "paging": _paging_of(request, first, page), "text": text, "state": state,
        "steps": STEPS, "scanned": supervisor.changes.scanned,
        "folders": [str(f) for f in roots_of(supervisor.catalog)],
    }  # fmt: skip


def experiment(supervisor: Supervisor, request: Request) -> Told:
    """One measured drive: its files, steps and results, and the jobs that can be started with it."""
    found = supervisor.experiments.get(request.path_params["name"][:40])
    if found is None:
        raise MissingError("There is no such recording.")
    one = found.item
    kinds = {"recording", "drive"}
    jobs = [
        (form, field.name)
        for form in supervisor.settings.forms
        for field in form.fields
        if one.host == supervisor.queue.host and kinds & {*field.of}
    ]
    told = LakeQuery(kinds=RESULTS, hashes=(one.digest,))
    results = find_page(supervisor.catalog, told, most=EACH) if one.digest else LakePage((), 0, False)
    return "experiment.html", {
        "one": one, "tables": found.tables, "rows": found.steps, "verified": found.verified, "steps": STEPS,
        "results": results.items, "count": results.count, "jobs": jobs,
    }  # fmt: skip


# builds


def builds(supervisor: Supervisor, request: Request) -> Told:
    """All builds that results know."""
    text = _text(request, "text").lower()
    found = [
        b for b in known_builds(supervisor.overview) if text in b.label.lower() or b.hash.startswith(text)
    ]
    first = _first(request)
    shown = found[first : first + EACH]
    return "builds.html", {
        "builds": shown, "text": text, "paging": _paging(request, first, len(shown), len(found))
    }  # fmt: skip


def build(supervisor: Supervisor, request: Request) -> Told:
    """The verdicts of one build, over all that was done with it, the newest first."""
    every = known_builds(supervisor.overview)
    one = _build(every, request.path_params["name"])
    of = {"hashes": (one.hash,)} if one.hash else {"build": one.label}
    query = LakeQuery(kinds=RESULTS, **of)
    results = find_page(supervisor.catalog, query, most=MOST_OUTCOMES).items
    return "build.html", {"one": one, "results": results, "others": [b for b in every if b.id != one.id]}


def compared(supervisor: Supervisor, request: Request) -> Told:
    """Two builds side by side, what got worse first."""
    every = known_builds(supervisor.overview)
    one, other = (_build(every, _text(request, name)) for name in ("one", "other"))
    found = pairs(supervisor.overview, one, other)
    counts = {
        c: sum(p.change == c for p in found) for c in ("worse", "changed", "not known", "same", "better")
    }
    return "compared.html", {
        "one": one, "other": other, "pairs": found[:MOST_OUTCOMES], "counts": counts, "count": len(found)
    }  # fmt: skip


def _build(every: Sequence[KnownBuild], name: str) -> KnownBuild:
    found = next((b for b in every if b.id == name), None)
    if found is None:
        raise MissingError("There is no such build.")
    return found


# results


def results(supervisor: Supervisor, request: Request) -> Told:
    """All results, the newest first."""
    kind, verdict, first = _text(request, "kind"), _text(request, "verdict"), _first(request)
    text = _text(request, "text")
    kinds = tuple(k for k in RESULTS if k == kind) or RESULTS
    page = find_page(supervisor.catalog, LakeQuery(text, kinds, verdict=verdict), first=first, most=EACH)
    return "results.html", {
        "results": page.items, "paging": _paging_of(request, first, page), "text": text, "kind": kind,
        "verdict": verdict, "kinds": [*KINDS], "verdicts": VERDICTS,
    }  # fmt: skip


def result(supervisor: Supervisor, request: Request) -> Told:
    """One result: what went in, what came out, its pages."""
    entry = entry_of(supervisor, request.path_params["name"])
    state = entry.state()
    there = state in ("there", "changed")
    pages = documents.pages(entry.folder) if there else []
    return "result.html", {
        "one": entry, "state": state, "pages": [p for p in pages if "/" not in p],
        "below": [p for p in pages if "/" in p], "data": _data(entry.folder) if there else [],
        "links": _links(supervisor, entry), "outcomes": entry.outcomes[:MOST_OUTCOMES],
        "maker": _maker(supervisor, entry), "command": links_of(supervisor.catalog, entry).command,
    }  # fmt: skip


def _links(supervisor: Supervisor, entry: CatalogEntry) -> dict[int, str]:
    """Addresses of the pages of what something follows from, by its place among these."""
    known = with_content(supervisor.catalog, [i.hash for i in entry.inputs])
    found = {k: link_to(known[i.hash][0]) for k, i in enumerate(entry.inputs) if i.hash in known}
    builds = {
        k: f"/builds/{build_id(i.name, i.hash)}" for k, i in enumerate(entry.inputs) if i.role == "build"
    }
    return found | (builds if entry.kind in KINDS else {})


def link_to(item: LakeItem) -> str:
    """Give the address of the page of something."""
    if item.kind in KINDS:
        return f"/results/{item.id}"
    return f"/experiments/{item.id}" if item.kind == "recording" else f"/lake/{item.id}"


def _maker(supervisor: Supervisor, entry: CatalogEntry) -> QueuedTask | None:
    """The task that wrote a result, if one did."""
    try:
        found = supervisor.queue.get(entry.folder.parent.name)
    except InputError:
        return None
    return found if Path(found.folder) == entry.folder.parent else None


def _data(folder: Path) -> list[str]:
    names = sorted(p.name for p in folder.iterdir() if p.suffix in (".json", ".xml", ".parquet", ".toml"))
    return [name for name in names if not name.startswith(".") and is_utf8(Path(name))]


# tasks and jobs


def tasks(supervisor: Supervisor, request: Request) -> Told:
    """What runs, what waits, and what ended."""
    first, counts = _first(request), supervisor.queue.counts()
    ended = supervisor.queue.ended(first, EACH)
    count = sum(n for state, n in counts.items() if state in ENDED)
    return "tasks.html", {
        **_unfinished(supervisor), "ended": ended, "paging": _paging(request, first, len(ended), count),
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
    }  # fmt: skip


def live(supervisor: Supervisor, request: Request) -> Told:
    """A task that simulates, as it does; what else runs, and what waits."""
    unfinished, asked = _unfinished(supervisor), _text(request, "task")
    one = task_of(supervisor, asked) if asked else next(iter(unfinished["running"]), None)
    return "live.html", {"one": one, **unfinished}


def jobs(supervisor: Supervisor, request: Request) -> Told:
    """All jobs that can be started."""
    return "jobs.html", {"forms": supervisor.settings.forms}


def job(supervisor: Supervisor, request: Request) -> Told:
    """The form of a job; what stands in the address is filled in."""
    form = supervisor.forms.get(request.path_params["name"])
    if form is None:
        raise MissingError("There is no such job.")
    given = request.query_params
    told = {field.name: given.getlist(field.name) for field in form.fields}
    fields = [
        (field, _options(supervisor, field, told[field.name]), told[field.name]) for field in form.fields
    ]
    lacking = [field.of[0] for field, options, _ in fields if field.required and field.of and not options]
    return "job.html", {"form": form, "fields": fields, "lacking": lacking, "most": MOST_OPTIONS}


def _options(supervisor: Supervisor, field: FormField, given: Sequence[str]) -> list[tuple[str, str]]:
    """The files that may be chosen: their ids, and how they are called. Of very many the first, and those given."""
    kinds = tuple(
        kind for kind in ITEM_KINDS if kind in field.of or (kind == "recording" and "drive" in field.of)
    )
    every = supervisor.files(*kinds, most=MOST_OPTIONS) if kinds else []
    shown = {i.id for i in every}
    every += [
        i for name in given if (i := _chosen(supervisor, name, kinds)) is not None and i.id not in shown
    ]
    roots = roots_of(supervisor.catalog)
    found = [(i.id, f"{i.name} – {_place(Path(i.folder).parent, roots)}") for i in every]
    if "result" in field.of:
        newest = find_page(supervisor.catalog, LakeQuery(kinds=("run",)), most=EACH).items
        found += [(f"result-{e.id}", f"run of {e.name}, {e.written[:16].replace('T', ' ')}") for e in newest]
    return found


def _place(folder: Path, roots: Sequence[Path]) -> str:
    """A folder as seen from the registered one that it is in."""
    root = next((root for root in roots if folder.is_relative_to(root)), None)
    return str(folder) if root is None else str(Path(root.name) / folder.relative_to(root))


def _chosen(supervisor: Supervisor, name: str, kinds: Sequence[str]) -> LakeItem | None:
    try:
        return supervisor.file(name, kinds)
    except InputError:
        return None


# who did what


def trail(supervisor: Supervisor, request: Request) -> Told:
    """What was done by whom. Raises MissingError for who may not see it."""
    if request.state.visitor.role != "administer":
        raise MissingError("There is no such page for you.")
    return "trail.html", {"lines": supervisor.audit.last(MOST_OUTCOMES)}


# the lake


FILTERS = ("text", "tag", "maneuver", "place", "weather", "finding", "verdict", "build")


def lake(supervisor: Supervisor, request: Request) -> Told:
    """Everything that there is, by the filters of `resim lake find`."""
    given = {name: _text(request, name) for name in (*FILTERS, "kind", "risk_above", "risk_below", "sort")}
    kinds = tuple(k for k in ITEM_KINDS if k == given["kind"])
    sort: SortKey = next((s for s in SORTS if s == given["sort"]), "written")
    risks = {name: _number(given[name]) for name in ("risk_above", "risk_below")}
    query = LakeQuery(kinds=kinds, **risks, **{name: given[name] for name in FILTERS})  # type: ignore[arg-type]
    first = _first(request)
    page = find_page(supervisor.catalog, query, sort=sort, first=first, most=EACH)
    return "lake.html", {
        "items": [(item, link_to(item)) for item in page.items], "paging": _paging_of(request, first, page),
        "given": given, "query": given["text"], "kinds": ITEM_KINDS, "verdicts": VERDICTS, "sorts": [*SORTS],
        "filtered": any(given.values()),
    }  # fmt: skip


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def thing(supervisor: Supervisor, request: Request) -> Told:
    """One thing of the lake: what it came from, and what came of it."""
    found = supervisor.catalog.entries([request.path_params["name"][:40]])
    if not found:
        raise MissingError("There is no such thing.")
    linked = links_of(supervisor.catalog, found[0])
    return "thing.html", {
        "one": found[0], "state": found[0].state(), "links": _links(supervisor, found[0]), "count": linked.count,
        "followers": [(item, link_to(item)) for item in linked.followers], "command": linked.command,
    }  # fmt: skip


PAGES: Mapping[str, Callable[[Supervisor, Request], Told]] = {
    "/": dashboard,
    "/experiments": experiments,
    "/experiments/{name}": experiment,
    "/builds": builds,
    "/builds/compare": compared,
    "/builds/{name}": build,
    "/results": results,
    "/results/{name}": result,
    "/tasks": tasks,
    "/tasks/{name}": task,
    "/live": live,
    "/jobs": jobs,
    "/jobs/{name}": job,
    "/trail": trail,
    "/lake": lake,
    "/lake/{name}": thing,
}
