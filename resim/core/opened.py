"""Files beside a user's file that his code opens though they are not listed there: its hash does not know them."""

from __future__ import annotations

import os
import sys
from copy import copy
from pathlib import Path
from typing import Any

from resim.core.modules import OwnModules

UNKNOWN = "which its hash does not know: list it in files = [...], and open it from Path(__file__).parent"
_OTHERS = {"__pycache__", "site-packages", "dist-packages", "resim"}
"""Folders of what Python and installed packages open."""


class Opened:
    """Context in which code runs that may open files of its own; `found` are those that it does not list.

    path: the user's file. folder: its place in the frozen copy, where the code believes to be. names: what is in the
    copy. modules: those that the code makes itself.
    """

    def __init__(self, path: Path, folder: Path, names: frozenset[str], modules: OwnModules) -> None:
        self.path = path
        self.found = set[str]()
        self._folders = [os.path.realpath(place) + os.sep for place in (folder, path.absolute().parent)]
        self._names, self._modules = names, modules

    def of_a_run(self) -> Opened:
        """Give the same that has heard of no file yet."""
        run = copy(self)
        run.found = set()
        return run

    def __enter__(self) -> Opened:
        self._modules.__enter__()
        _watching.append(self)
        return self

    def __exit__(self, *error: object) -> None:
        _watching.pop()
        self._modules.__exit__(*error)

    def hear(self, file: Any, flags: int) -> None:
        """Note a file that is about to be opened, unless it is to be written only."""
        if not isinstance(file, str | bytes) or flags & os.O_ACCMODE == os.O_WRONLY:
            return
        place = os.path.realpath(os.fsdecode(file))
        folder = next((f for f in self._folders if place.startswith(f)), None)
        if folder is None:
            return
        name = Path(place[len(folder) :])
        listed = folder == self._folders[0] and name.as_posix() in self._names
        if not listed and _OTHERS.isdisjoint(name.parts):
            self.found.add(name.as_posix())

    def note(self) -> str:
        """Say which files it opened that its hash does not know; "" for none."""
        if not self.found:
            return ""
        return f"the code opened {', '.join(sorted(self.found))} beside {self.path.name}, {UNKNOWN}"

    def remedy(self) -> str:
        """Say what to write into the file so that the code has those that are there; "" where none is."""
        there = [name for name in sorted(self.found) if (self.path.parent / name).is_file()]
        files = ", ".join(f'"{name}"' for name in there)
        return (
            f"List in {self.path.name}: files = [{files}]; open it from Path(__file__).parent."
            if there
            else ""
        )


_watching: list[Opened] = []
"""Whose code runs, innermost last."""


def _hear(event: str, arguments: tuple[Any, ...]) -> None:
    if _watching and event == "open":
        _watching[-1].hear(arguments[0], arguments[2])


sys.addaudithook(_hear)  # for good: there is no way to take one away
