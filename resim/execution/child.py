"""What a child process of `resim.execution.workers` does: it answers tasks."""

from __future__ import annotations

import errno
import importlib.util
import math
import mmap
import os
import pickle
import resource
import signal
import struct
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from resim.core.errors import FunctionError, ResimError
from resim.core.plugins import descendants, integrity, watchdog
from resim.execution.keeper import fork_kept

_PASSING = (errno.ENOSPC, errno.EDQUOT, errno.ENOMEM, errno.EMFILE, errno.ENFILE)
"""What a machine lacks for a time: disk, memory, open files."""

SIZE = struct.Struct("!Q")
"""Before each message: how many bytes it has."""


@dataclass(frozen=True)
class Failure:
    """Why a task has no result. crashed: the process died, the code did, or the machine had no more; else the input was
    wrong. of_function: whether the function under test is to blame.
    """

    reason: str
    crashed: bool
    of_function: bool = False


def memory() -> int:
    """Give the memory [MiB] of this process: what it has now, where the system tells, else the most that it has had."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") // (1 << 20)
    except (OSError, ValueError, IndexError):
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return most // (1 << (20 if sys.platform == "darwin" else 10))


def main(tasks: int, results: int, board: int, lifeline: int, words: int) -> None:
    """Serve on these open files; `lifeline` is closed when nobody waits any more, however the command ended."""
    for mine in (tasks, results, board, lifeline, words):
        os.set_inheritable(mine, False)
    fork_kept(lifeline, (tasks, results, board, words))
    sys.modules["__main__"].__spec__ = importlib.util.find_spec("resim.core.plugins.spawned")
    watchdog.board, watchdog.whose = watchdog.boards(mmap.mmap(board, watchdog.BOARD))
    watchdog.words = words
    for number in (signal.SIGINT, signal.SIGALRM):
        signal.signal(number, signal.SIG_IGN)  # Ctrl-C is for the command, which ends its children
    try:
        with os.fdopen(tasks, "rb") as incoming, os.fdopen(results, "wb") as outgoing:
            serve(incoming, outgoing)
    except OSError:  # nobody listens, or a task closed what is not its own
        os._exit(1)


def serve(tasks: BinaryIO, results: BinaryIO) -> None:
    """Answer (working directory, function, task, broken calls) with (result, memory) until nobody asks any more."""
    process = os.getpid()
    while True:
        try:
            folder, function, task, watchdog.broken = pickle.load(tasks)
        except EOFError:
            return
        if folder is not None:
            os.chdir(folder)  # the task before may have left it
        watchdog.name_code(None)
        watchdog.board[2] = 0.0
        watchdog.board[3] = time.monotonic()
        message = _packed(_answer(function, task))
        if os.getpid() != process:
            os._exit(0)  # a copy that the task forked
        results.write(SIZE.pack(len(message)) + message)
        results.flush()


def _packed(result: Any) -> bytes:
    """A result and the memory of the process as bytes; one that is not as it was is too large to be used again."""
    try:
        return pickle.dumps((result, math.inf if integrity.is_spoiled() else memory()))
    except Exception as e:
        return pickle.dumps((Failure(f"its result cannot be sent: {type(e).__name__}", crashed=True), 0))


def _answer(function: Callable[[Any], Any], task: Any) -> Any:
    """The result, or a Failure, whatever is raised: also what a function raises to look interrupted, or to end all."""
    try:
        result = function(task)
        integrity.check(whole=True)
        _end_strays()
        return result
    except ResimError as e:
        crashed = getattr(e.__cause__, "errno", None) in _PASSING
        return Failure(str(e), crashed, of_function=isinstance(e, FunctionError))
    except BaseException as e:
        if isinstance(e, ModuleNotFoundError) and str(e.name).partition(".")[0] == "resim":
            reason = "the code under test took modules of resim away"
            return Failure(reason, crashed=True, of_function=True)
        where = traceback.extract_tb(e.__traceback__)[-1]
        return Failure(
            f"unexpected {watchdog.exception_text(e)} in {where.name} ({Path(where.filename).name})",
            crashed=True,
        )


def _end_strays() -> None:
    """Raise FunctionError where code under test left processes behind, whatever its task gave."""
    try:
        descendants.end_strays()
    except FunctionError as e:
        raise FunctionError(f"code that this task ran {e}") from None
