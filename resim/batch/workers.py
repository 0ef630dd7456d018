"""Tasks in child processes: what crashes, hangs or is killed costs its own task only.

libsumo holds one simulation a process, and a fault in it ends the process; so every worker is a child, supervised by a
thread, that keeps what it has loaded from task to task.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import queue
import signal
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TypeVar

from resim.core.errors import ResimError

Task = TypeVar("Task")
Result = TypeVar("Result")

_SPAWN = multiprocessing.get_context("spawn")
_PATIENCE = 5.0
"""s that a child has to end by itself."""


@dataclass(frozen=True)
class Failure:
    """Why a task has no result. crashed: the process died, or the code did; else the input was wrong."""

    reason: str
    crashed: bool


def run_all(
    function: Callable[[Task], Result], tasks: Sequence[Task], *, workers: int, time_limit: float
) -> Iterator[tuple[int, Result | Failure]]:
    """Give the result of each task, or why it failed, with its place in `tasks`, as they come.

    function: of a module, as children import it anew. time_limit: s of wall clock for one task. Closing the iterator
    kills what still runs.
    """
    todo: queue.SimpleQueue[int] = queue.SimpleQueue()
    for k in range(len(tasks)):
        todo.put(k)
    done: queue.SimpleQueue[tuple[int, Result | Failure]] = queue.SimpleQueue()
    supervisors = [
        _Supervisor(function, tasks, todo, done, time_limit) for _ in range(min(workers, len(tasks)))
    ]
    for supervisor in supervisors:
        supervisor.start()
    try:
        for _ in tasks:
            yield done.get()
    finally:
        for supervisor in supervisors:
            supervisor.stop()
        for supervisor in supervisors:
            supervisor.join()


class _Supervisor(threading.Thread):
    """Gives tasks to one child after another that ended."""

    def __init__(
        self,
        function: Callable[[Any], Any],
        tasks: Sequence[Any],
        todo: queue.SimpleQueue[int],
        done: queue.SimpleQueue[tuple[int, Any]],
        time_limit: float,
    ) -> None:
        super().__init__(daemon=True)
        self.function, self.tasks, self.todo, self.done, self.time_limit = (
            function,
            tasks,
            todo,
            done,
            time_limit,
        )
        self.child: _Child | None = None
        self.stopped = False

    def run(self) -> None:
        while not self.stopped:
            try:
                k = self.todo.get_nowait()
            except queue.Empty:
                break
            try:
                if self.child is None:
                    self.child = _Child(self.function)
                result = self.child.work(self.tasks[k], self.time_limit)
            except Exception as e:
                result = Failure(f"the task could not be given to a process: {e!r}", crashed=True)
            if self.child is not None and not self.child.process.is_alive():
                self.child.end()
                self.child = None
            self.done.put((k, result))
        if self.child is not None:
            self.child.end()

    def stop(self) -> None:
        """Take no more tasks, and end what runs."""
        self.stopped = True
        if self.child is not None and self.is_alive():
            self.child.process.kill()


class _Child:
    """A process that answers tasks."""

    def __init__(self, function: Callable[[Any], Any]) -> None:
        os.environ.setdefault(
            "OMP_NUM_THREADS", "1"
        )  # a process a core: more threads would get in each other's way
        self.pipe, other = _SPAWN.Pipe()
        self.process = _SPAWN.Process(target=_serve, args=(function, other), daemon=True)
        self.process.start()
        other.close()

    def work(self, task: Any, time_limit: float) -> Any:
        """Give the result of a task, or a Failure; the process may be dead then."""
        try:
            self.pipe.send(task)
            if self.pipe.poll(time_limit):
                return self.pipe.recv()
        except (EOFError, OSError):
            self.process.join(_PATIENCE)
            return Failure(f"the process {_ended(self.process.exitcode)}", crashed=True)
        self.process.kill()
        self.process.join()
        return Failure(f"took longer than {time_limit:g} s", crashed=True)

    def end(self) -> None:
        """End the process."""
        self.pipe.close()
        self.process.join(_PATIENCE)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()
        self.process.close()


def _ended(code: int | None) -> str:
    if code is not None and code < 0:
        with contextlib.suppress(ValueError):
            return f"was ended by {signal.Signals(-code).name}"
    return f"ended with code {code}"


def _serve(function: Callable[[Any], Any], pipe: Connection) -> None:
    """Answer tasks until nobody asks any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which ends its children
    while True:
        try:
            task = pipe.recv()
        except (EOFError, OSError):
            return
        try:
            result = function(task)
        except ResimError as e:
            result = Failure(str(e), crashed=False)
        except Exception as e:
            where = traceback.extract_tb(e.__traceback__)[-1]
            result = Failure(f"{e!r} in {where.name} ({Path(where.filename).name})", crashed=True)
        pipe.send(result)
