"""Waits for a Supervisor, and lets a client in."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

PAGES = (
    "/",
    "/experiments",
    "/builds",
    "/results",
    "/jobs",
    "/jobs/run",
    "/tasks",
    "/live",
    "/lake?text=cut",
)
"""Pages that are there whatever the catalog holds."""


def waited(condition: Callable[[], Any], seconds: float = 30.0) -> Any:
    """Wait until something is so, and give what it is."""
    latest = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < latest, "it took too long"
        time.sleep(0.05)
    return found


@contextmanager
def entered(address: str, token: str) -> Iterator[Any]:
    """A client of a server that was let in."""
    import httpx2

    with httpx2.Client(base_url=address, timeout=20.0) as client:
        assert client.get("/", params={"token": token}).status_code == 200
        yield client
