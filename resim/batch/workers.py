"""Tasks in child processes: what crashes, hangs or is killed costs its own task only.

libsumo holds one simulation a process, and a fault in it ends the process. So every thread that is given tasks, of this
machine's pool or of a cluster's worker, supervises a child of its own, which keeps what it has loaded.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from resim.batch.child import Failure
from resim.core.errors import ResimError

Task = TypeVar("Task")
Result = TypeVar("Result")

LARGEST = 2048
"""MiB of memory from which on a child is replaced by a fresh one."""
GONE = "the cluster's scheduler is gone. What was finished is kept: start it, and go on with --resume."
_AHEAD = 4
"""Tasks a worker that wait in the pool, so that it is never idle; the rest wait here."""
_SERVE = "import sys; sys.path[:] = {path!r}; from resim.batch.child import main; main()"
_PATIENCE = 5.0
"""s that a child has to end by itself."""


def run_all(
    function: Callable[[Task], Result],
    tasks: Sequence[Task],
    *,
    workers: int,
    time_limit: float,
    pool: Executor | None = None,
) -> Iterator[tuple[int, Result | Failure]]:
    """Give the result of each task, or why it failed, with its place in `tasks`, as they come.

    function: of a module, as children import it anew. time_limit: s of wall clock for one task. pool: that of a cluster
    of so many workers; threads of this machine, if none is given. Closing the iterator kills what still runs here.
    """
    children: list[_Child] = []
    mine = ThreadPoolExecutor(workers, initializer=_keep, initargs=(children,))
    there = pool or mine
    waiting: dict[Future[Result | Failure], int] = {}
    todo = iter(range(len(tasks)))
    try:
        for k in todo:
            waiting[there.submit(supervised, function, tasks[k], time_limit)] = k
            if len(waiting) < _AHEAD * workers:
                continue
            yield from _finished(waiting)
        while waiting:
            yield from _finished(waiting)
    finally:
        for future in waiting:
            future.cancel()
        for child in children:
            child.process.kill()
        mine.shutdown(cancel_futures=True)
        for child in children:
            child.end()


def _keep(children: list[_Child]) -> None:
    """Let this thread note the children that it starts."""
    _own.children = children


def _finished(waiting: dict[Future[Any], int]) -> Iterator[tuple[int, Any]]:
    """Wait for one or more, and give them. Raises ResimError where the pool is gone."""
    done, _ = wait(waiting, return_when=FIRST_COMPLETED)
    for future in done:
        if future.cancelled():
            raise ResimError(GONE)
        why = future.exception()  # as of a cluster's worker that was killed over and over
        result = future.result() if why is None else Failure(f"the pool lost it: {why!r}", crashed=True)
        yield waiting.pop(future), result


def supervised(function: Callable[[Task], Result], task: Task, time_limit: float) -> Result | Failure:
    """Give the result of a task from this thread's child process, or why there is none."""
    try:
        child: _Child | None = getattr(_own, "child", None)
        if child is None or not child.alive:
            child = _own.child = _Child()
            getattr(_own, "children", []).append(child)
        found: Result | Failure = child.work(function, task, time_limit)
        return found
    except OSError as e:
        return Failure(f"no process could be started: {e}", crashed=True)


class _Child:
    """A process that answers tasks."""

    def __init__(self) -> None:
        inner_tasks, tasks = os.pipe()
        results, inner_results = os.pipe()
        environment = {
            "OMP_NUM_THREADS": "1",
            **os.environ,
        }  # a core a process: threads would get in their way
        path = [folder for folder in sys.path if folder]  # "" is the working directory, whatever lies there
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-c", _SERVE.format(path=path), str(inner_tasks), str(inner_results)],
            pass_fds=(inner_tasks, inner_results), stdin=subprocess.DEVNULL, stdout=2,
            env=environment,
        )  # fmt: skip
        os.close(inner_tasks)
        os.close(inner_results)
        self.tasks, self.results = Connection(tasks, readable=False), Connection(results, writable=False)
        self.alive = True

    def work(self, function: Callable[[Any], Any], task: Any, time_limit: float) -> Any:
        """Give the result of a task, or a Failure; the process may have ended then."""
        try:
            self.tasks.send((function, task))
            if self.results.poll(time_limit):
                result, memory = self.results.recv()
                if memory > LARGEST:
                    self.end()
                return result
        except (EOFError, OSError):
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.process.wait(_PATIENCE)
            code = self.process.poll()
            self.end()
            return Failure(f"the process {_ended(code)}", crashed=True)
        self.end()
        return Failure(f"took longer than {time_limit:g} s", crashed=True)

    def end(self) -> None:
        """Kill the process; it has nothing to lose."""
        self.alive = False
        self.process.kill()
        self.process.wait()
        self.tasks.close()
        self.results.close()


_own = threading.local()
"""Of each thread: its child, and where it notes the children that it starts."""


def _ended(code: int | None) -> str:
    if code is not None and code < 0:
        with contextlib.suppress(ValueError):
            return f"was ended by {signal.Signals(-code).name}"
    return f"ended with code {code}"
