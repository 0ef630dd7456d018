"""Server-sent events: that something changed, and what is appended to a log."""

from __future__ import annotations

import asyncio
import json
import threading
import time
from collections.abc import AsyncIterator, Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import psutil
from starlette.concurrency import run_in_threadpool

from resim.core.errors import ResimError
from resim.execution.workers import in_fresh_child
from resim.results.scanning import is_up_to_date, scan_user_catalog
from resim.supervisor.growth import stamp_of
from resim.supervisor.live import read_state
from resim.supervisor.processes import opened

if TYPE_CHECKING:
    from resim.supervisor.parts import Supervisor

EVERY = 1.0
"""s between two looks whether anything changed."""
SCAN = 20.0
"""s between two looks into the registered folders, and at least so many times as long as a look takes: REST."""
REST = 20.0
WHOLE = 15
"""Every so many looks, builds are read again as well: the code that they name may have changed."""
LOOK, LIVE_LOOK = 0.3, 0.04
"""s between two looks of a stream; of one that follows a simulation."""
GROWTH = 2.0
"""s at least between two looks of a page at what a task has come to."""
LIFE = 900.0
"""s after which a stream ends; the browser opens another one."""
SILENCE = 15.0
"""s after which a stream says that it is there."""
MOST_LOG = 200_000
"""Bytes of a log that are sent at once; of a longer one the end is shown."""


class Changes:
    """A thread that looks for changes, for all streams together, and into the registered folders now and then.

    Attributes:
        count: Another number after every change.
        scanned: Whether the registered folders were looked at once.
        busy: Share of the cores that was at work over the last second [%], None in the first one.
    """

    def __init__(self, supervisor: Supervisor) -> None:
        self._supervisor = supervisor
        self.count = 0
        self.scanned = False
        self.busy: float | None = None
        self._seen: object = None
        self._ending = threading.Event()
        self._threads = [threading.Thread(target=t, daemon=True) for t in (self._watch, self._scan)]

    def start(self) -> None:
        """Begin."""
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        """End, also all streams."""
        self._ending.set()

    @property
    def ended(self) -> bool:
        """Whether the server ends."""
        return self._ending.is_set()

    def _watch(self) -> None:
        psutil.cpu_percent()  # from here on: it tells each thread what was since the thread's own last look
        while not self._ending.wait(EVERY):
            self.busy = psutil.cpu_percent()
            try:
                seen: object = self._supervisor.version()
            except ResimError as e:
                seen = str(e)
            if seen != self._seen:
                self._seen = seen
                self.count += 1

    def _scan(self) -> None:
        looks = 0
        while not self._ending.is_set():
            begin = time.monotonic()
            with suppress(OSError, ResimError):  # of folders that change while they are looked at
                if looks % WHOLE == 0 or not is_up_to_date(self._supervisor.catalog):
                    in_fresh_child(scan_user_catalog, None)
                self.scanned = True
            looks += 1
            self._ending.wait(max(SCAN, REST * (time.monotonic() - begin)))


async def stream(
    supervisor: Supervisor,
    log: Path | None,
    start: int,
    live: Path | None = None,
    is_in: Callable[[], bool] = lambda: True,
) -> AsyncIterator[bytes]:
    """Give events: `changed` after every change, `log` with what was appended to a file from `start` on, and `state`
    with each state of the simulation of a task, whose folder is `live`. It ends when who asked for it is in no more.
    """
    changes, count, seen = supervisor.changes, supervisor.changes.count, 0
    begin = told = looked = grown = time.monotonic()
    stamp = 0.0 if log is None else stamp_of(log.parent)
    yield b"retry: 2000\n\n"
    while not changes.ended and time.monotonic() < begin + LIFE:
        if time.monotonic() > looked + EVERY:
            looked = time.monotonic()
            if not is_in():
                return
        if log is not None:
            text, start = await run_in_threadpool(read_log, log, start)
            if text:
                told = time.monotonic()
                yield f"event: log\nid: {start}\ndata: {json.dumps(text)}\n\n".encode()
        if live is not None:
            state, seen = read_state(live, seen)
            with suppress(ValueError, RecursionError):  # of what no browser reads
                event = (
                    "" if state is None else f"event: state\ndata: {json.dumps(state, allow_nan=False)}\n\n"
                )
                if event:
                    told = time.monotonic()
                    yield event.encode()
        if log is not None and time.monotonic() > grown + GROWTH and (now := stamp_of(log.parent)) != stamp:
            stamp, grown = now, time.monotonic()
            yield b"event: changed\ndata: {}\n\n"
        if changes.count != count:
            count, told = changes.count, time.monotonic()
            yield b"event: changed\ndata: {}\n\n"
        if time.monotonic() > told + SILENCE:
            told = time.monotonic()
            yield b"event: tick\ndata: {}\n\n"
        await asyncio.sleep(LOOK if live is None else LIVE_LOOK)


def read_log(path: Path, start: int) -> tuple[str, int]:
    """Give what stands in a log from a byte on, and where that ends; of a long rest the end."""
    try:
        with opened(path) as file:
            size = file.seek(0, 2)
            start = start if 0 <= start <= size else 0
            file.seek(max(start, size - MOST_LOG))
            found = file.read(MOST_LOG)
            end = file.tell()
    except OSError:
        return "", start
    return found.decode(errors="replace"), end
