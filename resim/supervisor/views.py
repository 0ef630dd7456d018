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
from resim.results.entry import KINDS, CatalogEntry
from resim.results.overview import ResultQuery
from resim.results.queue import QueuedTask
from resim.supervisor import documents
from resim.supervisor.builds import KnownBuild, known_builds, pairs
from resim.supervisor.events import read_log
from resim.supervisor.experiments import STEPS, Experiment
from resim.supervisor.forms import FormField
from resim.supervisor.machine import machine_load
from resim.supervisor.parts import Supervisor
from resim.supervisor.places import is_utf8
from resim.supervisor.runner import LOG

EACH = 50
"""Rows of a page."""
MOST_OUTCOMES = 500
MOST_OPTIONS = 1_000
LATEST = 8
Told = tuple[str, dict[str, Any]]


class MissingError(ResimError):
    """There is no such page."""


@dataclass(frozen=True)
class Paging:
    """Which rows of how many are shown; links to the pages before and behind, "" where there are none."""

    first: int
    last: int
    count: int
    before: str
    behind: str


def _paging(request: Request, first: int, shown: int, count: int) -> Paging:
    def link(start: int) -> str:
        given = {k: v for k, v in request.query_params.items() if k != "first"}
        return f"{request.url.path}?{urlencode({**given, 'first': str(start)})}"

    before = link(max(0, first - EACH)) if first > 0 else ""
    behind = link(first + EACH) if first + shown < count else ""
    return Paging(first + 1 if shown else 0, first + shown, count, before, behind)


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
    found = supervisor.catalog.entries([name[:40]])
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


# dashboard


def dashboard(supervisor: Supervisor, request: Request) -> Told:
    """What the machine does, what is queued, what failed last, what came out last."""
    newest, results = supervisor.overview.page(ResultQuery(), 0, LATEST)
    unfinished = supervisor.queue.unfinished()
    return "dashboard.html", {
        "machine": machine_load(supervisor.settings.tasks),
        "running": [t for t in unfinished if t.state == "running"],
        "waiting": [t for t in unfinished if t.state == "waiting"][:LATEST],
        "counts": supervisor.queue.counts(),
        "failed": supervisor.queue.ended(0, LATEST, bad=True),
        "newest": newest,
        "results": results,
        "recordings": len(supervisor.folders.all("recording")),
        "folders": [str(f) for f in supervisor.folders.folders],
        "jobs": supervisor.settings.jobs,
    }


# experiments


def experiments(supervisor: Supervisor, request: Request) -> Told:
    """All measured drives, by name and state."""
    text, state, first = _text(request, "text"), _text(request, "state"), _first(request)
    every = supervisor.experiments.all()
    found = [e for e in every if _fits(e, text, state)]
    shown = found[first : first + EACH]
    return "experiments.html", {
        "experiments": shown, "paging": _paging(request, first, len(shown), len(found)), "text": text,
        "state": state, "steps": STEPS, "all": len(every), "left_out": supervisor.folders.left_out,
        "scanned": supervisor.folders.scanned,
        "folders": [str(f) for f in supervisor.folders.folders],
    }  # fmt: skip


def _fits(experiment: Experiment, text: str, state: str) -> bool:
    words = text.lower().split()
    named = f"{experiment.name}\n{experiment.place}".lower()
    fits = all(word in named or experiment.hash.startswith(word) for word in words)
    return fits and (not state or state in experiment.states)


def experiment(supervisor: Supervisor, request: Request) -> Told:
    """One measured drive: its files, steps and results, and the jobs that can be started with it."""
    name = request.path_params["name"]
    found = next((e for e in supervisor.experiments.all() if e.id == name), None)
    if found is None:
        raise MissingError("There is no such recording.")
    results, count = supervisor.overview.page(ResultQuery(text=found.hash), 0, EACH if found.hash else 0)
    kinds = {"recording", "drive"}
    jobs = [
        (form, field.name)
        for form in supervisor.settings.forms
        for field in form.fields
        if found.file is not None and kinds & {*field.of}
    ]
    return "experiment.html", {"one": found, "results": results, "count": count, "steps": STEPS, "jobs": jobs}


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
    results = supervisor.overview.results_of_build(one.label, one.hash, MOST_OUTCOMES)
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
    query = ResultQuery(text, next((k for k in KINDS if k == kind), None), verdict)
    found, count = supervisor.overview.page(query, first, EACH)
    return "results.html", {
        "results": found, "paging": _paging(request, first, len(found), count), "text": text, "kind": kind,
        "verdict": verdict, "kinds": [*KINDS], "verdicts": supervisor.overview.verdicts(),
    }  # fmt: skip


def result(supervisor: Supervisor, request: Request) -> Told:
    """One result: what went in, what came out, its pages."""
    entry = entry_of(supervisor, request.path_params["name"])
    state = entry.state()
    there = state in ("there", "changed")
    known = {f.hash: f.id for f in supervisor.experiments.all() if f.hash}
    of_builds = {(b.label, b.hash): b.id for b in known_builds(supervisor.overview)}
    pages = documents.pages(entry.folder) if there else []
    return "result.html", {
        "one": entry, "state": state, "pages": [p for p in pages if "/" not in p],
        "below": [p for p in pages if "/" in p], "data": _data(entry.folder) if there else [],
        "recordings": known, "builds": of_builds, "outcomes": entry.outcomes[:MOST_OUTCOMES],
        "maker": _maker(supervisor, entry),
    }  # fmt: skip


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
    first, unfinished, counts = _first(request), supervisor.queue.unfinished(), supervisor.queue.counts()
    ended = supervisor.queue.ended(first, EACH)
    count = sum(n for state, n in counts.items() if state not in ("running", "waiting"))
    return "tasks.html", {
        "running": [t for t in unfinished if t.state == "running"],
        "waiting": [t for t in unfinished if t.state == "waiting"],
        "ended": ended, "paging": _paging(request, first, len(ended), count),
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
        "pages": documents.pages(folder) if one.state not in ("running", "waiting") and entry is None else [],
    }  # fmt: skip


def live(supervisor: Supervisor, request: Request) -> Told:
    """A task that simulates, as it does; what else runs, and what waits."""
    unfinished = supervisor.queue.unfinished()
    running = [t for t in unfinished if t.state == "running"]
    asked = _text(request, "task")
    one = task_of(supervisor, asked) if asked else next(iter(running), None)
    return "live.html", {
        "one": one, "running": running, "waiting": [t for t in unfinished if t.state == "waiting"],
    }  # fmt: skip


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
    kinds = tuple("recording" if kind == "drive" else kind for kind in field.of)
    every = supervisor.folders.all(*kinds)
    found = [
        (f.id, f"{f.name} – {f.place}") for k, f in enumerate(every) if k < MOST_OPTIONS or f.id in given
    ]
    if "result" in field.of:
        newest, _ = supervisor.overview.page(ResultQuery(kind="run"), 0, EACH)
        found += [(f"result-{e.id}", f"run of {e.name}, {e.written[:16].replace('T', ' ')}") for e in newest]
    return found


# who did what


def trail(supervisor: Supervisor, request: Request) -> Told:
    """What was done by whom. Raises MissingError for who may not see it."""
    if request.state.visitor.role != "administer":
        raise MissingError("There is no such page for you.")
    return "trail.html", {"lines": supervisor.audit.last(MOST_OUTCOMES)}


# search


def search(supervisor: Supervisor, request: Request) -> Told:
    """All that has a name, a path or a hash like this."""
    text = _text(request, "text")
    if not text.strip():
        return "search.html", {"query": text, "drives": [], "builds": [], "results": [], "count": 0}
    drives = [e for e in supervisor.experiments.all() if _fits(e, text, "")]
    lower = text.lower()
    of = [
        b for b in known_builds(supervisor.overview) if lower in b.label.lower() or b.hash.startswith(lower)
    ]
    found, count = supervisor.overview.page(ResultQuery(text), 0, EACH)
    return "search.html", {
        "query": text, "drives": drives[:EACH], "builds": of[:EACH], "results": found, "count": count
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
    "/search": search,
}
