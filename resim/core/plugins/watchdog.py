"""Calls code under test so that nothing it does ends the program, or holds it up."""

from __future__ import annotations

import contextlib
import gc
import os
import re
import signal
import sys
import threading
import time
import traceback
from array import array
from collections.abc import Callable
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any

from resim.core.errors import FunctionError, StopError

_PRIVATE = re.compile(r"\b_resim_[0-9a-f]{16}\.")
"""Before names of a user's modules (`resim.core.plugins.loading`), who knows them without it."""

board: Any = array("d", [0.0, 0.0, 0.0, 0.0])
"""What a supervisor sees of the call that is under way: deadline [s of `time.monotonic`], limit [s], its number;
and when the task was taken up [s of `time.monotonic`].

A deadline of 0 is none. In a child process this is memory that its supervisor reads, so that it can end what no signal
interrupts, such as compiled code that never returns.
"""

whose: Any = bytearray(256)
"""Path of the file whose code runs, or ran last in the task, for the supervisor to name; cut where it is longer."""

BOARD = 32 + len(whose)
"""Bytes of memory that a child process shares with its supervisor."""

words: int | None = None
"""Open file that takes what code under test writes to the standard error; None for none.

In a child process its supervisor reads it, so that it can tell the last words of a function that ended the process.
"""

broken: dict[int, str] = {}
"""Calls that are known to end the process, by number, and how: they are not made again, they fail."""


def boards(shared: Any) -> tuple[Any, Any]:
    """Give `board` and `whose` as parts of this memory."""
    whole = memoryview(shared)
    return whole[: BOARD - len(whose)].cast("d"), whole[BOARD - len(whose) :]


def last_words(file: int, since: int = 0) -> str:
    """Give the end of what code under test wrote to the standard error, by `words`; its last lines as one.

    since: byte from which on it is told.
    """
    with contextlib.suppress(OSError):
        size = os.fstat(file).st_size
        lines = (
            os.pread(file, 4 * _MOST_WORDS, max(size - 4 * _MOST_WORDS, since))
            .decode(errors="replace")
            .splitlines()
        )
        return " | ".join(line.strip() for line in lines if line.strip())[-_MOST_WORDS:]
    return ""


def heard() -> int:
    """Give how many bytes `words` holds."""
    with contextlib.suppress(OSError):
        return 0 if words is None else os.fstat(words).st_size
    return 0


def heard_since(begin: int) -> str:
    """Give what was written to `words` from this byte on; of much the end. "" where nobody listens."""
    if words is None:
        return ""
    with contextlib.suppress(OSError):
        size = os.fstat(words).st_size
        return os.pread(words, _MOST_KEPT, max(size - _MOST_KEPT, begin)).decode(errors="replace")
    return ""


def name_code(path: Path | None) -> None:
    """Note whose code begins to run; None for nobody's yet."""
    told = b"" if path is None else os.fsencode(path.absolute())[: len(whose) - 1]
    whose[:] = told.ljust(len(whose), b"\0")


_MOST_KEPT = 1 << 20
"""Bytes of words that are kept with a run."""
_MOST_WORDS = 300
"""Characters of last words that are told."""
_Frame = tuple[str, int, str]
_MOST_FRAMES = 20
"""Of an exception that are told."""
_RESIM = str(Path(__file__).parents[2]) + os.sep
_DIGITS = 12
"""Of a hash that make the number of a load: as many as a float holds exactly."""


class _Overrun(BaseException):
    """Past the time limit; no `except Exception` of the function stops it."""


_MOST = 10.0
"""Times the limit that a call may take where others have the processor."""


class _Waiting:
    """How long this thread has been ready to run while others had the processor: nobody's fault who is called.

    Linux tells (`/proc/thread-self/schedstat`); elsewhere it is 0.
    """

    def __init__(self) -> None:
        self._file = -1
        with contextlib.suppress(OSError):
            self._file = os.open("/proc/thread-self/schedstat", os.O_RDONLY | os.O_CLOEXEC)

    def time(self) -> float:
        """Give it [s], since the thread began."""
        try:
            return 1e-9 * int(os.pread(self._file, 100, 0).split()[1])
        except (OSError, ValueError, IndexError):  # there is none, or the function closed it
            return 0.0

    def close(self) -> None:
        """Give the file back."""
        with contextlib.suppress(OSError):
            os.close(self._file)


class _Overheard:
    """What is written to the standard error within goes to `words`, and at the end to where it was meant for."""

    def __init__(self) -> None:
        self._before = -1

    def begin(self) -> None:
        """Overhear, if somebody listens."""
        if words is not None:
            with contextlib.suppress(OSError):
                os.ftruncate(words, 0)
                os.lseek(words, 0, os.SEEK_SET)
                _flush_errors()
                self._before = os.dup(2)
                os.dup2(words, 2)

    def end(self) -> None:
        """Hand on what was heard."""
        if words is None or self._before < 0:
            return
        _flush_errors()
        with contextlib.suppress(OSError):
            os.dup2(self._before, 2)
            os.close(self._before)
            at = 0
            while part := os.pread(words, 1 << 16, at):
                at += os.write(2, part)
            os.ftruncate(words, 0)


def _streams_are_there() -> None:
    """Put back what code under test took away: others, and later tasks, look for the standard streams."""
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name, None) is None:
            setattr(sys, name, getattr(sys, f"__{name}__", None))


def _flush_errors() -> None:
    """Write what the standard error holds back, whatever code under test has put in its place."""
    with contextlib.suppress(Exception):
        sys.stderr.flush()


class Watchdog:
    """Context in which calls raise FunctionError for an exception or an overrun in what is called.

    A call's time is wall clock less what it waited for a processor and what Python took to look through all objects of
    the process for garbage, so that answers do not depend on what else the machine does and the process holds; in all
    it has `_MOST` times its limit.
    In the main thread a call that does not return is interrupted by an interval timer (as far as it runs
    Python code); elsewhere an overrun is only found when the call returns, or by who reads `board`. A copy of the
    process that the function forked ends where it returns. The working directory is restored at the end.
    """

    def __init__(self) -> None:
        in_main = threading.current_thread() is threading.main_thread()
        self._timed = in_main and hasattr(signal, "setitimer")  # Windows has none
        self._inside = False
        self._previous: Any = None
        self._process = os.getpid()
        self._home = contextlib.chdir(".")
        self._limit = self._begin = self._began = self._collected = 0.0
        self._collecting: float | None = None
        self._overheard = _Overheard()

    def __enter__(self) -> Watchdog:
        self._waiting = _Waiting()
        self._home.__enter__()
        self._overheard.begin()
        gc.callbacks.append(self._collects)
        if self._timed:
            self._previous = signal.signal(signal.SIGALRM, self._ring)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, e: BaseException | None, tb: TracebackType | None
    ) -> None:
        if self._timed:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, self._previous)
        with contextlib.suppress(ValueError):  # code under test took it away
            gc.callbacks.remove(self._collects)
        self._overheard.end()
        self._waiting.close()
        self._home.__exit__(kind, e, tb)

    def _ring(self, number: int, frame: FrameType | None) -> None:
        if self._inside:
            if (left := self._left()) <= 0.0:
                raise _Overrun
            signal.setitimer(signal.ITIMER_REAL, left, self._limit)
            board[0] = time.monotonic() + left

    def _clock(self) -> float:
        """Time [s] that goes on while this thread has a processor."""
        return time.monotonic() - self._waiting.time()

    def _collects(self, phase: str, info: dict[str, int]) -> None:
        """Note how long the collections of all objects take; what raises in one, Python swallows."""
        if info["generation"] < 2:
            return
        if phase == "start":
            self._collecting = self._clock()
        elif self._collecting is not None:
            self._collected += self._clock() - self._collecting
            self._collecting = None

    def _left(self) -> float:
        """How much longer [s] the call that is under way may take."""
        now = self._clock()
        collected = self._collected + (0.0 if self._collecting is None else now - self._collecting)
        taken = time.monotonic() - self._begin
        return min(self._limit - (now - self._began - collected), _MOST * self._limit - taken)

    def load(self, limit: float, digest: str, what: Callable[..., Any]) -> Any:
        """Call as `call` does what loads the code of this hash: a process does that once, whatever it loaded before."""
        before = board[2]
        board[2] = -1.0 - int(digest[:_DIGITS], 16)
        try:
            return self._call(limit, what)
        finally:
            board[2] = before

    def call(self, limit: float, what: Callable[..., Any], *arguments: Any) -> Any:
        """Call within `limit` [s] and give the answer."""
        board[2] += 1.0
        return self._call(limit, what, *arguments)

    def _call(self, limit: float, what: Callable[..., Any], *arguments: Any) -> Any:
        if broken and (known := broken.get(int(board[2]))) is not None:
            raise FunctionError(known)
        self._limit, self._begin, self._began = limit, time.monotonic(), self._clock()
        self._collected, self._collecting = 0.0, None
        if self._timed:
            signal.setitimer(signal.ITIMER_REAL, limit, limit)  # again and again, where one is swallowed
        board[1] = limit
        board[0] = self._begin + limit
        failure, frames, since = "", tuple[_Frame, ...](), heard()
        try:
            self._inside = True
            try:
                answer = what(*arguments)
            except _Overrun:
                raise
            except BaseException as e:
                if type(e) is FunctionError or _is_of_others(e):
                    raise
                failure, frames = _in_words(e), _frames(e)
            finally:
                self._inside = False
                if os.getpid() != self._process:
                    os._exit(0)
                _streams_are_there()
        except _Overrun:
            raise FunctionError(unanswered(limit)) from None
        finally:
            board[0] = 0.0
        if failure:
            _flush_errors()
            raise FunctionError(failure, frames, "" if words is None else last_words(words, since))
        if time.monotonic() - self._begin > limit and self._left() < 0.0:
            raise FunctionError(f"took longer than {limit:g} s to answer")
        return answer


def unanswered(limit: float) -> str:
    """Say that a call has no answer after `limit` [s]."""
    return f"did not answer within {limit:g} s"


def _is_of_others(e: BaseException) -> bool:
    """Whether a signal to the program raised it, and not the function: one that the process has a handler for."""
    for kind, number in ((KeyboardInterrupt, signal.SIGINT), (StopError, signal.SIGTERM)):
        if issubclass(type(e), kind):
            return callable(signal.getsignal(number))
    return False


def _in_words(e: BaseException) -> str:
    """What a function raised, in words; its text is the function's code, too."""
    if issubclass(type(e), SystemExit):
        return f"tried to exit the program: SystemExit({_said(lambda: str(getattr(e, 'code', '')))})"
    return f"raised {name_of(e)}: {_said(lambda: str(e)):.300}"


def _frames(e: BaseException) -> tuple[_Frame, ...]:
    """Where it was raised, from what is no file of resim on: at most the first and the last of many."""
    told = [
        (frame.f_code.co_filename, line, frame.f_code.co_name)
        for frame, line in traceback.walk_tb(e.__traceback__)
    ]
    first = next((k for k, (file, *_) in enumerate(told) if not file.startswith(_RESIM)), len(told))
    own = told[first:]
    return tuple(own if len(own) <= _MOST_FRAMES else [*own[: _MOST_FRAMES // 2], *own[-_MOST_FRAMES // 2 :]])


def name_of(e: BaseException) -> str:
    """Give the name of an exception's class, whatever its metaclass answers."""
    name: str = type.__dict__["__name__"].__get__(type(e))
    return name


def exception_text(e: BaseException) -> str:
    """Give an exception as `repr` does; its class's name where making that fails."""
    try:
        return _PRIVATE.sub("", repr(e))
    except _Overrun:
        raise
    except BaseException:
        return name_of(e)


def _said(text: Callable[[], str]) -> str:
    """A text in one line; or that there is none, where making it fails."""
    try:
        return _PRIVATE.sub("", " ".join(str(text()).split()))
    except _Overrun:
        raise
    except BaseException:
        return "(its text raised, too)"
