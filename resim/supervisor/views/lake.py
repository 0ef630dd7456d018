"""Everything that the lake knows, and one thing of it."""

from __future__ import annotations

import math

from starlette.exceptions import HTTPException
from starlette.requests import Request

from resim.jobs.lake import links_of
from resim.results.lake import (
    ITEM_KINDS,
    SORTS,
    LakeQuery,
    SortKey,
    find_page,
)
from resim.results.reading import VERDICTS
from resim.supervisor.parts import Supervisor
from resim.supervisor.views.common import (
    EACH,
    MissingError,
    Told,
    choice_of,
    files_of,
    first_of,
    link_to,
    links_in,
    maker_of,
    paging_of,
    refuse_unknown,
    starts_with,
    text_of,
)

FILTERS = ("text", "tag", "maneuver", "place", "weather", "finding", "verdict", "build")


def lake(supervisor: Supervisor, request: Request) -> Told:
    """Everything that there is, by the filters of `resim lake find`."""
    names = (*FILTERS, "kind", "risk_above", "risk_below", "sort")
    refuse_unknown(request, *names, "first")
    given = {name: text_of(request, name) for name in names}
    choice_of(request, "verdict", VERDICTS)
    kinds = tuple(k for k in ITEM_KINDS if k == choice_of(request, "kind", ITEM_KINDS))
    sort: SortKey = next((s for s in SORTS if s == choice_of(request, "sort", SORTS)), "written")
    risks = {name: _number(name, given[name]) for name in ("risk_above", "risk_below")}
    query = LakeQuery(kinds=kinds, **risks, **{name: given[name] for name in FILTERS})  # type: ignore[arg-type]
    first = first_of(request)
    page = find_page(supervisor.catalog, query, sort=sort, first=first, most=EACH)
    return "lake.html", {
        "items": [(item, link_to(item)) for item in page.items], "paging": paging_of(request, first, page),
        "given": given, "query": given["text"], "kinds": ITEM_KINDS, "verdicts": VERDICTS, "sorts": [*SORTS],
        "filtered": any(given.values()),
    }  # fmt: skip


def _number(name: str, text: str) -> float | None:
    try:
        number = float(text) if text.strip() else None
    except ValueError:
        number = math.nan
    if number is not None and not math.isfinite(number):
        raise HTTPException(400, f"{name}: is {text:.60}, expected a number such as 0.01.")
    return number


def thing(supervisor: Supervisor, request: Request) -> Told:
    """One thing of the lake: what it came from, and what came of it."""
    found = supervisor.catalog.entries([request.path_params["name"][:40]])
    if not found:
        raise MissingError("There is no such thing.")
    linked = links_of(supervisor.catalog, found[0])
    return "thing.html", {
        "one": found[0], "state": found[0].state(), "links": links_in(supervisor, linked), "count": linked.count,
        "followers": [(item, link_to(item)) for item in linked.followers], "command": linked.command,
        "origin": linked.origin, "files": files_of(found[0]), "maker": maker_of(supervisor, found[0].folder),
        "starts": starts_with(supervisor, found[0]),
    }  # fmt: skip
