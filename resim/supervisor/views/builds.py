"""Builds, one or two of them."""

from __future__ import annotations

from collections.abc import Sequence

from starlette.requests import Request

from resim.results.builds import CHANGES, KnownBuild, known_builds, pairs
from resim.results.lake import LakeQuery, find_page
from resim.supervisor.parts import Supervisor
from resim.supervisor.views.common import (
    EACH,
    MOST_OUTCOMES,
    RESULTS,
    MissingError,
    Told,
    first_of,
    paging,
    refuse_unknown,
    text_of,
)


def builds(supervisor: Supervisor, request: Request) -> Told:
    """All builds that results know."""
    refuse_unknown(request, "text", "first")
    text = text_of(request, "text").lower()
    found = [
        b for b in known_builds(supervisor.overview) if text in b.label.lower() or b.hash.startswith(text)
    ]
    first = first_of(request)
    shown = found[first : first + EACH]
    return "builds.html", {
        "builds": shown, "text": text, "paging": paging(request, first, len(shown), len(found))
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
    one, other = (_build(every, text_of(request, name)) for name in ("one", "other"))
    found = pairs(supervisor.catalog, one, other)
    counts = {c: sum(p.change == c for p in found) for c in CHANGES}
    return "compared.html", {
        "one": one, "other": other, "pairs": found[:MOST_OUTCOMES], "counts": counts, "count": len(found)
    }  # fmt: skip


def _build(every: Sequence[KnownBuild], name: str) -> KnownBuild:
    found = next((b for b in every if b.id == name), None)
    if found is None:
        raise MissingError("There is no such build.")
    return found
