"""What a user's code puts into `sys.modules` by itself: it is there while that code runs, and for no other.

An import of an installed module is everybody's, as always. What code writes into an installed module stays there.
"""

from __future__ import annotations

import os
import sys
from types import ModuleType
from typing import Any

_PATH = tuple(os.path.realpath(folder) + os.sep for folder in sys.path if folder)
"""Where installed modules are."""
_ANYBODY = ("_resim_", "_cython", "cython_runtime")
"""How names of modules begin that have private names as it is, and of what compiled modules share."""


class OwnModules:
    """Context in which one user's code runs; what it puts into `sys.modules`, over others too, is kept for its next."""

    def __init__(self) -> None:
        self._own: dict[str, ModuleType] = {}
        self._before: dict[str, ModuleType] = {}
        self._depth = 0

    @property
    def active(self) -> bool:
        """Whether the code runs."""
        return self._depth > 0

    def forget(self) -> None:
        """Let the next run begin without what is kept."""
        self._own.clear()

    def __enter__(self) -> None:
        self._depth += 1
        if self._depth == 1:
            self._before = dict(sys.modules)
            sys.modules.update(self._own)

    def __exit__(self, *error: object) -> None:
        self._depth -= 1
        if self._depth:
            return
        before, self._before = self._before, {}
        now = dict(sys.modules)
        self._own = {
            name: module
            for name, module in now.items()
            if before.get(name) is not module and (name in before or not _is_installed(name, now))
        }
        for name in self._own:
            del sys.modules[name]
        for name in self._own.keys() | before.keys() - now.keys():
            if name in before:
                sys.modules[name] = before[name]


def _is_installed(name: str, modules: dict[str, ModuleType]) -> bool:
    """Whether everybody who imports this name gets this module: it, or the package that it is of, is installed."""
    top = name.partition(".")[0]
    if top.startswith(_ANYBODY):
        return True
    spec: Any = getattr(modules.get(top), "__spec__", None)
    if spec is None:
        return False
    places = [spec.origin] if spec.origin else list(spec.submodule_search_locations or ())
    return spec.origin in ("built-in", "frozen") or any(os.path.realpath(p).startswith(_PATH) for p in places)
