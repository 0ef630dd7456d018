"""Processes that code under test started: which there are, and which of them it let go.

Linux tells them (/proc); elsewhere none is found, and only the process group of the code is ended.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from resim.core.errors import FunctionError

keeper = 0
"""Number of the process that takes on what loses its parent here (`resim.execution.keeper`); 0 for none."""
_PATIENCE = 5.0
"""s that processes have to be gone that were killed."""
_LOOK = 0.005
"""s between two looks whether they are."""
_STARTS = {"os.fork", "os.forkpty", "os.posix_spawn", "os.spawn", "os.system", "subprocess.Popen"}
"""Audit events of a process that starts another."""
_started = set[str]()
"""By which of them this process did, since the last look."""


@dataclass(frozen=True)
class Descendant:
    """A living process: its number, its parent's, its session's, and what its program is called."""

    number: int
    parent: int
    session: int
    name: str


def descendants(root: int) -> list[Descendant]:
    """Give the living processes that a process started, and those that these did; parents first."""
    every: dict[int, list[Descendant]] = {}
    for one in _processes():
        every.setdefault(one.parent, []).append(one)
    found, todo = [], [root]
    for number in todo:
        found += (inner := every.get(number, []))
        todo += [one.number for one in inner]
    return found


def end_strays() -> None:
    """End what user's code started and let go: what lost its parent, or made itself a session of its own.

    Raises FunctionError that names them. Pools, whose processes are children of this one or of each other, go on.
    """
    if not keeper or not _started:
        return
    _started.clear()
    mine, strays, parents = os.getsid(0), [], {keeper}
    for one in descendants(keeper):
        if one.number != os.getpid() and (one.parent in parents or one.session != mine):
            strays.append(one)
            parents.add(one.number)
    for one in strays:
        with suppress(OSError):
            os.kill(one.number, signal.SIGKILL)
    numbers, latest = {one.number for one in strays}, time.monotonic() + _PATIENCE
    while any(one.number in numbers for one in _processes()) and time.monotonic() < latest:
        time.sleep(_LOOK)
    if strays:
        told = ", ".join(sorted({one.name for one in strays}))
        raise FunctionError(f"left processes behind that outlive it ({told})")


def _processes() -> Iterator[Descendant]:
    """All living processes, as far as the system tells them."""
    for name in os.listdir("/proc") if sys.platform == "linux" else ():  # noqa: PTH208
        if name.isdigit():
            with suppress(OSError):
                head, _, rest = Path("/proc", name, "stat").read_text(errors="replace").rpartition(")")
                state, parent, _, session = rest.split()[:4]
                if state not in "ZX":
                    yield Descendant(int(name), int(parent), int(session), head.partition("(")[2])


def _hear(event: str, arguments: tuple[Any, ...]) -> None:
    if event in _STARTS:
        _started.add(event)


sys.addaudithook(_hear)  # for good: there is no way to take one away
