"""What can be started, and the form of one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from starlette.requests import Request

from resim.core.errors import InputError
from resim.results.lake import (
    ITEM_KINDS,
    LakeItem,
    LakeQuery,
    find_page,
    items_with,
)
from resim.results.scanning import roots_of
from resim.supervisor.forms import FormField
from resim.supervisor.parts import Supervisor
from resim.supervisor.views.common import (
    EACH,
    MissingError,
    Told,
)

MOST_OPTIONS = 1_000


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
    roots = roots_of(supervisor.catalog)
    fields = [
        (field, _options(supervisor, field, told[field.name], roots) if field.of else [], told[field.name])
        for field in form.fields
    ]
    lacking = [field.of[0] for field, options, _ in fields if field.required and field.of and not options]
    return "job.html", {"form": form, "fields": fields, "lacking": lacking, "most": MOST_OPTIONS}


def _options(
    supervisor: Supervisor, field: FormField, given: Sequence[str], roots: Sequence[Path]
) -> list[tuple[str, str]]:
    """The files that may be chosen: their ids, and how they are called. Of very many the first, and those given."""
    kinds = tuple(
        kind for kind in ITEM_KINDS if kind in field.of or (kind == "recording" and "drive" in field.of)
    )
    every = supervisor.files(*kinds, most=MOST_OPTIONS) if kinds else []
    shown = {i.id for i in every}
    every += [
        i for name in given if (i := _chosen(supervisor, name, kinds)) is not None and i.id not in shown
    ]
    found = [(i.id, f"{i.name} – {_place(Path(i.folder).parent, roots)}") for i in every]
    if "result" in field.of:
        newest = [*find_page(supervisor.catalog, LakeQuery(kinds=("run",)), most=EACH).items]
        told = [name.removeprefix("result-")[:40] for name in given if name.startswith("result-")]
        known = {e.id for e in newest}
        newest += [e for e in items_with(supervisor.catalog, told) if e.kind == "run" and e.id not in known]
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
