"""Calls an AD function so that nothing it does ends the program."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any

from resim.core.errors import FunctionError

_LAST_RING = 5
"""Interruptions after which a function that swallows them all takes its process along, with a word."""


class _Overrun(BaseException):
    """Past the time limit; no `except Exception` of the function stops it."""


class Watchdog:
    """Context in which calls raise FunctionError for an exception or an overrun in what is called.

    In the main thread a call that does not return is interrupted by an interval timer (as far as it runs
    Python code); elsewhere an overrun is only found when the call returns.
    """

    def __init__(self) -> None:
        in_main = threading.current_thread() is threading.main_thread()
        self._timed = in_main and hasattr(signal, "setitimer")  # Windows has none
        self._inside = False
        self._previous: Any = None
        self._rung = 0

    def __enter__(self) -> Watchdog:
        if self._timed:
            self._previous = signal.signal(signal.SIGALRM, self._ring)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, e: BaseException | None, tb: TracebackType | None
    ) -> None:
        if self._timed:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, self._previous)

    def _ring(self, number: int, frame: FrameType | None) -> None:
        if not self._inside:
            return
        self._rung += 1
        if self._rung > _LAST_RING:
            os.write(2, b"resim: the AD function does not answer and swallows every interruption\n")
            os._exit(1)
        raise _Overrun

    def call(self, limit: float, what: Callable[..., Any], *arguments: Any) -> Any:
        """Call within `limit` [s] of wall clock and give the answer."""
        begin = time.perf_counter()
        self._rung = 0
        if self._timed:
            signal.setitimer(signal.ITIMER_REAL, limit, limit)  # again and again, where one is swallowed
        try:
            self._inside = True
            try:
                answer = what(*arguments)
            except FunctionError:
                raise
            except SystemExit as e:
                raise FunctionError(f"tried to end the program: SystemExit({e.code})") from e
            except Exception as e:
                said = " ".join(str(e).split())
                raise FunctionError(f"raised {type(e).__name__}: {said:.300}") from e
            finally:
                self._inside = False
        except _Overrun:
            raise FunctionError(f"did not answer within {limit:g} s") from None
        if time.perf_counter() - begin > limit:
            raise FunctionError(f"took longer than {limit:g} s to answer")
        return answer
