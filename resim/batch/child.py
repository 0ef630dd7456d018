"""What a child process of `resim.batch.workers` does: it answers tasks."""

from __future__ import annotations

import errno
import os
import resource
import signal
import sys
import threading
import time
import traceback
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

from resim.core.errors import ResimError

_PASSING = (errno.ENOSPC, errno.EDQUOT, errno.ENOMEM, errno.EMFILE, errno.ENFILE)
"""What a machine lacks for a time: disk, memory, open files."""


@dataclass(frozen=True)
class Failure:
    """Why a task has no result. crashed: the process died, the code did, or the machine had no more; else the input was
    wrong.
    """

    reason: str
    crashed: bool


def memory() -> int:
    """Give the memory [MiB] of this process: what it has now, where the system tells, else the most that it has had."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") // (1 << 20)
    except (OSError, ValueError, IndexError):
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return most // (1 << (20 if sys.platform == "darwin" else 10))


def serve(tasks: Connection, results: Connection) -> None:
    """Answer (function, task) with (result, memory) until nobody asks any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which ends its children
    threading.Thread(target=_mourn, args=(os.getppid(),), daemon=True).start()
    while True:
        try:
            function, task = tasks.recv()
        except (EOFError, OSError):
            return
        try:
            result = function(task)
        except ResimError as e:
            result = Failure(str(e), crashed=getattr(e.__cause__, "errno", None) in _PASSING)
        except BaseException as e:  # also what a function raises to end the process, or to look interrupted
            where = traceback.extract_tb(e.__traceback__)[-1]
            result = Failure(f"{e!r} in {where.name} ({Path(where.filename).name})", crashed=True)
        try:
            results.send((result, memory()))
        except (BrokenPipeError, OSError):
            return


def _mourn(parent: int) -> None:
    """End with the parent, also one that was killed in the middle of a task."""
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


def main() -> None:
    """Serve on the pipes that the command line names by their numbers."""
    serve(Connection(int(sys.argv[1]), writable=False), Connection(int(sys.argv[2]), readable=False))
