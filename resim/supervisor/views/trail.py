"""Who did what."""

from __future__ import annotations

from starlette.requests import Request

from resim.supervisor.parts import Supervisor
from resim.supervisor.views.common import (
    MOST_OUTCOMES,
    MissingError,
    Told,
)


def trail(supervisor: Supervisor, request: Request) -> Told:
    """What was done by whom. Raises MissingError for who may not see it."""
    if request.state.visitor.role != "administer":
        raise MissingError("There is no such page for you.")
    return "trail.html", {"lines": supervisor.audit.last(MOST_OUTCOMES)}
