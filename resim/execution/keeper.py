"""Ends all that a child process started, also what left its session: nothing outlives a command.

The keeper is the parent of the process that answers tasks. On Linux it takes on whatever loses its parent below it, and
finds it in /proc; elsewhere it ends the process group of its child.
"""

from __future__ import annotations

import ctypes
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

from resim.core.plugins import descendants
from resim.execution.forkserver import readable

_SUBREAPER, _WITH_PARENT = 36, 1
"""PR_SET_CHILD_SUBREAPER and PR_SET_PDEATHSIG of Linux."""
_PATIENCE = 5.0
"""s that processes have to be gone that were killed."""
_LOOK = 0.005
"""s between two looks whether they are."""


def fork_kept(lifeline: int, others: Iterable[int]) -> None:
    """Return in a process of its own, which this one keeps from then on: it ends all and itself when that one ends, or
    when the other end of `lifeline` is closed, however the command that holds it ended.

    others: open files that are the kept process's alone.
    """
    _control(_SUBREAPER, 1)
    keeper = os.getpid()
    if kept := os.fork():
        try:
            _keep(kept, lifeline, others)
        finally:
            os._exit(1)
    os.close(lifeline)
    os.setpgid(0, 0)  # who ends his process group does not end the keeper
    _control(_WITH_PARENT, signal.SIGKILL)
    if os.getppid() != keeper:
        os._exit(1)
    descendants.keeper = keeper


def _control(what: int, value: int) -> None:
    """Set something of this process that Linux knows."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(what, value, 0, 0, 0)


def _keep(kept: int, lifeline: int, others: Iterable[int]) -> NoReturn:
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    woken, wakes = os.pipe()
    os.set_blocking(wakes, False)
    os.set_blocking(woken, False)
    signal.set_wakeup_fd(wakes, warn_on_full_buffer=False)
    signal.signal(signal.SIGCHLD, lambda number, frame: None)
    for file in (1, 2, *others):
        os.close(file)
    status = _reaped(kept)
    while status is None:
        ready = readable((lifeline, woken))
        status = _reaped(kept)
        if lifeline in ready:
            break
        with suppress(BlockingIOError):
            os.read(woken, 4096)
    again = _end_all(kept)
    for left in Path(tempfile.gettempdir()).glob(f"resim-{kept}-*"):  # of its SUMO session
        shutil.rmtree(left, ignore_errors=True)
    _end_as(again if status is None else status)


def _reaped(kept: int) -> int | None:
    """Take note of all that ended; give how the kept process did, if it is one of them."""
    found = None
    with suppress(ChildProcessError):
        while (ended := os.waitpid(-1, os.WNOHANG))[0]:
            found = ended[1] if ended[0] == kept else found
    return found


def _end_all(kept: int) -> int:
    """Kill whatever came of the kept process, and wait until it is gone; give how the process itself ended."""
    status, latest = 0, time.monotonic() + _PATIENCE
    with suppress(OSError):
        os.killpg(kept, signal.SIGKILL)
    while time.monotonic() < latest:
        for one in descendants.descendants(os.getpid()):
            with suppress(OSError):
                os.kill(one.number, signal.SIGKILL)
        status = _reaped(kept) or status
        try:
            os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        except ChildProcessError:
            break
        time.sleep(_LOOK)
    return status


def _end_as(status: int) -> NoReturn:
    """End as the kept process did."""
    if os.WIFSIGNALED(status):
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        number = os.WTERMSIG(status)
        if number != signal.SIGKILL:
            signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)
    os._exit(os.waitstatus_to_exitcode(status))
