"""Tasks in child processes: what crashes, hangs or is killed costs its own task only.

libsumo holds one simulation a process, and a fault in it ends the process. So every thread that is given tasks, of this
machine's pool or of a cluster's worker, supervises a child of its own, which keeps what it has loaded. The child has a
session of its own: Ctrl-C is for the command alone, and what the child started ends with it.
"""

from __future__ import annotations

import atexit
import contextlib
import mmap
import os
import pickle
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from typing import Any, TypeVar

from resim.core.errors import FunctionError, ResimError
from resim.core.plugins.watchdog import BOARD, boards, last_words, unanswered
from resim.execution import forkserver
from resim.execution.child import SIZE, Failure

Task = TypeVar("Task")
Result = TypeVar("Result")

_LONGEST = 1 << 34
"""Bytes of the longest message that a child sends."""
_BETWEEN = "wrote to a file that it did not open, by which resim's processes speak to each other"
LARGEST = 2048
"""MiB of memory from which on a child is replaced by a fresh one."""
GONE = "the cluster's scheduler is gone. Finished runs are kept: start it, and resume with --resume."
_AHEAD = 4
"""Tasks a worker that wait in the pool, so that it is never idle; the rest wait here."""
_START = 180.0
"""s that a fresh process has to start and to take up its task, beyond the task's own time."""
_TICK = 0.1
"""s between two looks whether the child is alive, and whether its function answers in time."""
_STALLED = 20.0
"""s without a further part of a message after which it is none of resim's."""
_GRACE = 2.0
"""s beyond its limit that a call has to be interrupted by the child itself."""
_PATIENCE = 5.0
"""Half of the time [s] that a child has to end by itself that closed its pipe; its keeper takes the other at most."""
_MOST_ENDS = 3
"""How often a function may end its process in one task, until the task is given up."""
_FOREIGN = (signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGINT)
"""Signals that come from outside: of the system that is short of memory, or of somebody."""


def in_child(function: Callable[[Task], Result], task: Task) -> Result:
    """Give the result of one task from this thread's child process, which waits for the next one then.

    Raises FunctionError where the function under test ended its process over and over, or cannot be loaded in time,
    else ResimError.
    """
    try:
        result = supervised(function, task, float("inf"))
    except BaseException:  # as of a signal
        _end_own()
        raise
    if isinstance(result, Failure):
        raise (FunctionError if result.of_function else ResimError)(result.reason)
    return result


def in_fresh_child(function: Callable[[Task], Result], task: Task) -> Result:
    """Give the result of one task from a child in which no user's code ran, as `in_child`; it ends with the task."""
    kept = _own.__dict__.pop("child", None)
    try:
        return in_child(function, task)
    finally:
        _end_own()
        if kept is not None:
            _own.child = kept


@atexit.register
def _end_own() -> None:
    """End the child of this thread, if it has one."""
    if hasattr(_own, "child"):
        _own.child.end()


def run_all(
    function: Callable[[Task], Result],
    tasks: Sequence[Task],
    *,
    workers: int,
    time_limit: float,
    pool: Executor | None = None,
    has_parts: Callable[[Task], bool] = lambda task: False,
) -> Iterator[tuple[int, Result | Failure]]:
    """Give the result of each task, or why it failed, with its place in `tasks`, as they come.

    function: of a module, as children import it anew. time_limit: s of wall clock for a task, from when its process
    took it up. has_parts: whether who gave a task may give its parts; it is given up where the function under test ends
    its process. pool: that of a cluster of so many workers; threads of this machine,
    if none is given. Closing the iterator kills what still runs here.
    """
    children: list[_Child] = []
    over = threading.Event()
    mine = ThreadPoolExecutor(workers, initializer=_keep, initargs=(children, over))
    there = pool or mine
    waiting: dict[Future[Result | Failure], int] = {}
    todo = iter(range(len(tasks)))
    try:
        for k in todo:
            waiting[there.submit(supervised, function, tasks[k], time_limit, not has_parts(tasks[k]))] = k
            if len(waiting) < _AHEAD * workers:
                continue
            yield from _finished(waiting)
        while waiting:
            yield from _finished(waiting)
    finally:
        over.set()
        for future in waiting:
            future.cancel()
        mine.shutdown(cancel_futures=True)
        for child in children:
            child.end()


def _keep(children: list[_Child], over: threading.Event) -> None:
    """Let this thread note the children that it starts, and know when nobody waits for them any more."""
    _own.children, _own.over = children, over


def _finished(waiting: dict[Future[Any], int]) -> Iterator[tuple[int, Any]]:
    """Wait for one or more, and give them. Raises ResimError where the pool is gone."""
    done, _ = wait(waiting, return_when=FIRST_COMPLETED)
    for future in done:
        if future.cancelled():
            raise ResimError(GONE)
        why = future.exception()  # as of a cluster's worker that was killed over and over
        result = (
            future.result() if why is None else Failure(f"the worker pool lost it: {why!r}", crashed=True)
        )
        yield waiting.pop(future), result


def supervised(
    function: Callable[[Task], Result], task: Task, time_limit: float, again: bool = True
) -> Result | Failure:
    """Give the result of a task from this thread's child process, or why there is none.

    Where the function under test ends its process, the task is done `again`, and that call fails instead. A process
    that was killed in a call may have been so from outside: the function is to blame if it is in the same call once
    more.
    """
    broken: dict[int, str] = {}
    killed = set[int]()
    while True:
        try:
            child: _Child | None = getattr(_own, "child", None)
            if child is None or not child.is_alive():
                child = _own.child = _Child(function.__module__)
                getattr(_own, "children", []).append(child)
            found: Result | Failure = child.work(function, task, time_limit, broken, killed)
        except OSError as e:
            return Failure(f"no process could be started: {e}", crashed=True)
        if not again:
            return found
        if child.killed and child.call not in killed:
            killed.add(child.call)
            continue
        if not isinstance(found, Failure) or not child.blame:
            return found
        if len(broken) == _MOST_ENDS or child.call in broken:
            return found
        broken[child.call] = child.blame


class _Child:
    """A process that answers tasks."""

    def __init__(self, module: str) -> None:
        """module: what it is asked for first, which may be loaded before it starts."""
        with contextlib.ExitStack() as of_child, contextlib.ExitStack() as mine:
            shared = of_child.enter_context(tempfile.TemporaryFile())
            shared.write(bytes(BOARD))
            shared.flush()
            self.board, self.whose = boards(mmap.mmap(shared.fileno(), BOARD))
            self._words = mine.enter_context(tempfile.TemporaryFile())
            inner_tasks, self.tasks = _pipe(of_child, mine)
            self.results, inner_results = _pipe(mine, of_child)
            inner_life, _ = _pipe(of_child, mine)
            inner = (inner_tasks, inner_results, shared.fileno(), inner_life, self._words.fileno())
            self.process = forkserver.fork(module, inner)
            self._files = mine.pop_all()
        self.alive = True
        self.blame = ""  # what the function did to the process in the last task
        self.words = ""  # the last that it wrote to its standard error
        self.killed = False  # in a call of it, and not evidently by it

    def is_alive(self) -> bool:
        """Say whether the process waits for tasks; what is left of one that ended by itself is ended."""
        if self.alive and self.process.poll() is not None:
            self.end()
        return self.alive

    @property
    def call(self) -> int:
        """Number of the call of the function that is under way, or was the last one, in this task."""
        return int(self.board[2])

    def work(
        self,
        function: Callable[[Any], Any],
        task: Any,
        time_limit: float,
        broken: dict[int, str],
        killed: set[int],
    ) -> Any:
        """Give the result of a task, or a Failure; the process may have ended then. killed: calls in which it was."""
        self.board[2] = self.board[3] = 0.0
        self.blame, self.killed = "", False
        try:
            _write(self.tasks, pickle.dumps((_here(), function, task, broken)))
        except OSError:
            return self._died(killed)
        latest, message, came = time.monotonic() + _START, bytearray(), 0.0
        over: threading.Event | None = getattr(_own, "over", None)
        while over is None or not over.is_set():
            alive = self.process.poll() is None
            if forkserver.is_readable(self.results, _TICK if alive else 0.0):
                part = os.read(self.results, 1 << 20)
                message += part  # in place: a result may be large
                came = time.monotonic()
                if _size(message) > _LONGEST:
                    self.end()
                    return self._blamed(_BETWEEN)
                if len(message) >= SIZE.size + _size(message):
                    return self._unpacked(message[SIZE.size :])
                if not part:
                    return self._died(killed)
            elif not alive:
                return self._died(killed)
            elif message and time.monotonic() > came + _STALLED:  # resim writes a message without a pause
                self.end()
                return self._blamed(_BETWEEN)
            now = time.monotonic()  # before the deadline is read, and that once: the next call has another
            deadline = self.board[0]
            if deadline and now > deadline + _GRACE:
                limit = self.board[1]
                self.end()
                return self._blamed(f"{unanswered(limit)}, and could not be interrupted")
            if now > (self.board[3] or latest) + time_limit:
                self.end()
                return Failure(f"took longer than {time_limit:g} s", crashed=True)
        self.end()
        return Failure("was stopped", crashed=True)

    def _unpacked(self, message: bytes | bytearray) -> Any:
        """The result; a process that has grown large is not used again."""
        try:
            result, memory = pickle.loads(message)
        except Exception:
            self.end()
            return self._blamed(_BETWEEN)
        if memory > LARGEST:
            self.end()
        return result

    def _died(self, killed: set[int]) -> Failure:
        """Say how the process ended, and whether it did so in a call of the function."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(2.0 * _PATIENCE)
        code, inside, called = self.process.poll(), self.board[0] > 0.0, self.call != 0
        self.end()
        foreign = code is None or -code in _FOREIGN
        if inside and not foreign:
            return self._blamed(f"ended its process, which {_ended(code)}")
        if inside and self.call in killed:
            return self._blamed(f"ended its process, which {_ended(code)} twice in the same call")
        if called and (code is None or code >= 0):  # resim does neither
            return self._blamed(f"{_OUTSIDE}: it {_ended(code)}")
        self.killed = inside and code is not None
        return Failure(f"the process {_ended(code)}", crashed=True)

    def _blamed(self, blame: str) -> Failure:
        """Give the failure of the function that did this, and name its file."""
        self.blame = blame = blame + (f"; its last words: {self.words}" if self.words else "")
        file = bytes(self.whose).partition(b"\0")[0].decode(errors="replace")
        return Failure(f"the function {f'of {file} ' if file else ''}{blame}", crashed=True, of_function=True)

    def forget(self) -> None:
        """Leave the process to who started it."""
        self.alive = False
        self._files.close()

    def end(self) -> None:
        """Have the process and all that it started killed; they have nothing to lose."""
        if not self.alive:
            return
        self.alive = False
        self.words = last_words(self._words.fileno())
        self._files.close()  # which its keeper sees
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(2.0 * _PATIENCE)
        self.process.kill()


def _forget_children() -> None:
    """In a copy of the process: its children are the other's."""
    child: _Child | None = getattr(_own, "child", None)
    if child is not None:
        child.forget()
    _own.__dict__.clear()


_own = threading.local()
"""Of each thread: its child, where it notes the children that it starts, and whether nobody waits any more."""

os.register_at_fork(after_in_child=_forget_children)

_OUTSIDE = (
    "ended its process outside its calls, for example from a thread or by closing files that are not its own"
)


def _here() -> str | None:
    """The working directory, None where it is gone."""
    try:
        return os.getcwd()  # noqa: PTH109
    except OSError:
        return None


def _pipe(reader: contextlib.ExitStack, writer: contextlib.ExitStack) -> tuple[int, int]:
    """A pipe that nobody inherits; its ends are closed by who holds them."""
    ends = os.pipe()
    reader.callback(os.close, ends[0])
    writer.callback(os.close, ends[1])
    return ends


def _write(file: int, message: bytes) -> None:
    """Write all of a message."""
    left = memoryview(message)
    while left:
        left = left[os.write(file, left) :]


def _size(message: bytearray) -> int:
    """How many bytes come after the size, as far as it is known."""
    return int(SIZE.unpack(message[: SIZE.size])[0]) if len(message) >= SIZE.size else 1


def _ended(code: int | None) -> str:
    """How a process ended, by its exit code."""
    if code is None:
        return "closed its connection"
    if code < 0:
        with contextlib.suppress(ValueError):
            return f"was ended by {signal.Signals(-code).name}"
    return f"ended with code {code}"
