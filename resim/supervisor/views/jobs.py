"""What can be started, and the form of one."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from pathlib import Path

from starlette.requests import Request

from resim.core.errors import InputError
from resim.results.entry import KINDS
from resim.results.lake import ITEM_KINDS, LakeItem
from resim.results.scanning import roots_of
from resim.supervisor.files import file_id
from resim.supervisor.forms import FormField, JobForm
from resim.supervisor.parts import Supervisor
from resim.supervisor.views.common import MissingError, Told

MOST_OPTIONS = 1_000


def jobs(supervisor: Supervisor, request: Request) -> Told:
    """All jobs that can be started, by groups."""
    groups: dict[str, list[JobForm]] = {}
    for form in supervisor.settings.forms:
        groups.setdefault(form.group, []).append(form)
    return "jobs.html", {"groups": groups}


def job(supervisor: Supervisor, request: Request) -> Told:
    """The form of a job; what stands in the address is filled in."""
    form = supervisor.forms.get(request.path_params["name"])
    if form is None:
        raise MissingError("There is no such job.")
    given = request.query_params
    told = {field.name: given.getlist(field.name) for field in form.fields}
    roots = roots_of(supervisor.catalog)
    fields = [
        (
            field,
            _options(supervisor, field, told[field.name], roots) if field.has_files else [],
            told[field.name],
        )
        for field in form.fields
    ]
    lacking = [
        _lacking(field) for field, options, _ in fields if field.required and field.has_files and not options
    ]
    return "job.html", {"form": form, "fields": fields, "lacking": lacking, "most": MOST_OPTIONS}


def _lacking(field: FormField) -> str:
    """What a field takes, in words."""
    if field.of:
        return " or ".join(field.of)
    names = ", ".join(pattern.removeprefix("././").removeprefix("./") for pattern in field.patterns)
    return f"{field.name.replace('_', ' ')} ({names})"


def _options(
    supervisor: Supervisor, field: FormField, given: Sequence[str], roots: Sequence[Path]
) -> list[tuple[str, str]]:
    """The files that may be chosen: their ids, and how they are called. Of very many the first, and those given."""
    kinds = tuple(kind for kind in ITEM_KINDS if kind in field.of)
    every = supervisor.files(*kinds, most=MOST_OPTIONS) if kinds else []
    shown = {i.id for i in every}
    every += [
        i for name in given if (i := _chosen(supervisor, name, kinds)) is not None and i.id not in shown
    ]
    tasks = supervisor.settings.tasks
    found = [
        (i.id, _called(i, roots, several=len(kinds) > 1))
        for i in every if not field.own or Path(i.folder).is_relative_to(tasks)
    ]  # fmt: skip
    loose = islice(supervisor.loose_files(field), MOST_OPTIONS) if field.patterns else ()
    return found + [(file_id(path), _place(path, (*roots, tasks))) for path in loose]


def _called(item: LakeItem, roots: Sequence[Path], *, several: bool) -> str:
    """How something is offered: results by when they were written and of which builds, all else by where it lies."""
    kind = f"{item.kind} " if several or item.kind in KINDS else ""
    if item.kind in KINDS:
        return ", ".join((f"{kind}{item.name}", item.written[:19].replace("T", " "), *item.builds))
    return f"{kind}{item.name} – {_place(Path(item.folder).parent, roots)}"


def _place(folder: Path, roots: Sequence[Path]) -> str:
    """A folder as seen from the registered one that it is in."""
    root = next((root for root in roots if folder.is_relative_to(root)), None)
    return str(folder) if root is None else str(Path(root.name) / folder.relative_to(root))


def _chosen(supervisor: Supervisor, name: str, kinds: Sequence[str]) -> LakeItem | None:
    try:
        return supervisor.file(name, kinds)
    except InputError:
        return None
