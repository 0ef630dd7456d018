"""Who did what."""

from __future__ import annotations

from starlette.requests import Request

from resim.supervisor.parts import Supervisor
from resim.supervisor.views.common import (
    EACH,
    MissingError,
    Told,
    first_of,
    paging,
)


def trail(supervisor: Supervisor, request: Request) -> Told:
    """What was done by whom. Raises MissingError for who may not see it."""
    if request.state.visitor.role != "administer":
        raise MissingError("There is no such page for you.")
    first = first_of(request)
    lines = supervisor.audit.last(EACH + 1, first)
    more = len(lines) > EACH
    shown = lines[:EACH]
    pages = paging(request, first, len(shown), first + len(shown), more)
    return "trail.html", {"lines": shown, "paging": pages}
