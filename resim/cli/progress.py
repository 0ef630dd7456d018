"""How far a command is: a bar on a terminal, elsewhere a line at once and then now and then, or for each step; to
standard error.
"""

from __future__ import annotations

import json
import os
import sys
import time
from contextlib import suppress
from types import TracebackType
from typing import TYPE_CHECKING, TextIO

from resim.cli.terminal import output_settings, say, visible
from resim.core.watched import progress_file

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

NOTED = 0.5
"""s between two notes for who watches."""
LAST = 30
"""How many of the last words are in a note."""
EVERY = 10.0
"""s between two lines where there is no terminal."""
FEWEST = 3
"""How many have to be done before anything is said of the rest: the first one bears what is loaded and prepared."""


def _screen() -> TextIO:
    """The standard error, also while that takes the words of code under test."""
    if sys.stderr.isatty():
        return os.fdopen(os.dup(sys.stderr.fileno()), "w", encoding="utf-8")
    return sys.stderr


class ProgressReporter:
    """Context in which a command tells how far it is.

    Attributes:
        unit: What it counts, such as "runs".
        done: How many are done.
    """

    def __init__(self, unit: str, total: int | None = None) -> None:
        """total: how many there are, None for what is not known yet."""
        self.unit, self._total, self.done, self._first = unit, total, 0, 0
        self._begin, self._told = time.monotonic(), float("-inf")
        self._bar: Bar | None = None
        self._file, self._noted, self._last = progress_file(), float("-inf"), list[str]()

    def __enter__(self) -> ProgressReporter:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
        from rich.progress import Progress as Bar

        console = Console(file=_screen())
        if console.is_terminal and not output_settings().quiet and not output_settings().verbose:
            self._bar = Bar(
                TextColumn("{task.description:24}", markup=False), BarColumn(), MofNCompleteColumn(),
                TextColumn("{task.fields[rate]}"), TimeRemainingColumn(), console=console, transient=True,
            )  # fmt: skip
            self._bar.start()
            self._bar.add_task("", total=self._total, rate="")
        self._show("")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, e: BaseException | None, tb: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()
        self._note("", whole=True)

    def expect(self, total: int) -> None:
        """Note how many there are."""
        if self._total is None:
            self._told = float("-inf")  # nothing was told yet but that it begins
        self._total = total
        self._show("")

    def skip(self, by: int = 1) -> None:
        """Note that so many were done before."""
        self._first += by
        self.step("", by=by)

    def step(self, doing: str, *, by: int = 1) -> None:
        """Go on by so many; doing: what was done last, or is being done."""
        self.done += by
        self._show(doing)

    def _note(self, doing: str, *, whole: bool = False) -> None:
        """Write how far it is for who watches, now and then."""
        if self._file is None:
            return
        if doing and doing not in self._last[-1:]:
            self._last = [*self._last, doing][-LAST:]
        if not whole and time.monotonic() < self._noted + NOTED:
            return
        self._noted = time.monotonic()
        told = {"unit": self.unit, "done": self.done, "total": self._total, "last": self._last}
        beside = self._file.with_name(f".{self._file.name}.{os.getpid()}.new")
        with suppress(OSError):  # who watches is of no importance
            beside.write_text(json.dumps(told), encoding="utf-8")
            beside.replace(self._file)

    def _show(self, doing: str) -> None:
        self._note(doing)
        if self._bar is not None:
            rate = (self.done - self._first) / max(time.monotonic() - self._begin, 1e-3)
            self._bar.update(
                self._bar.task_ids[0], description=visible(doing)[:24], completed=self.done, total=self._total,
                rate=f"{rate:.1f}/s" if rate > 0.1 else "",
            )  # fmt: skip
        elif not output_settings().quiet and (
            (now := time.monotonic()) >= self._told + EVERY or (doing and output_settings().verbose)
        ):
            self._told = now
            of = "" if self._total is None else f" of {self._total}"
            say(f"{self.done}{of} {self.unit}{self._left(now)}{f': {doing}' * bool(doing)}", err=True)

    def _left(self, now: float) -> str:
        """How long it may take, in words; nothing where that cannot be told."""
        done = self.done - self._first
        if self._total is None or not FEWEST <= done < self._total - self._first:
            return ""
        left = (now - self._begin) / done * (self._total - self.done)
        return f", about {left:.0f} s left" if left < 100.0 else f", about {left / 60.0:.0f} min left"
