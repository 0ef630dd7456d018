"""Waits for a Supervisor, and lets a client in."""

from __future__ import annotations

import re
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


def at_home(client: Any, address: str) -> Any:
    """Let a client write and read addresses without what all of its session begin with."""

    def asking(request: Any) -> None:
        home, path = str(client.base_url.path), request.url.raw_path.decode()
        if path.startswith((f"{home}pages/", f"{home}static/")):
            request.url = request.url.copy_with(raw_path=path.removeprefix(home[:-1]).encode())

    def read(answer: Any) -> None:
        home = str(client.base_url.path)[:-1]
        if "html" in answer.headers.get("content-type", ""):
            if found := re.search(r"url=(/[0-9a-f]{32})/", answer.read().decode()):
                client.base_url = address + found[1]
            elif home:
                answer._content = answer.content.replace(home.encode(), b"")
        if "location" in answer.headers:
            answer.headers["location"] = answer.headers["location"].removeprefix(home)

    client.event_hooks = {"request": [asking], "response": [read]}
    return client


@contextmanager
def entered(address: str, token: str) -> Iterator[Any]:
    """A client of a server that was let in."""
    import httpx2

    with httpx2.Client(base_url=address, timeout=20.0) as client:
        assert at_home(client, address).get("/", params={"token": token}).status_code == 200
        yield client
