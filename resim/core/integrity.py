"""Whether a user's code changed the program that judges it: functions, classes and constants of resim, numpy's top.

A check, no wall: what runs in a process can hide from it. It finds what code replaces by mistake or for convenience.
"""

from __future__ import annotations

import dataclasses
import importlib.abc
import importlib.machinery
import sys
from collections.abc import Iterator, Mapping, Sequence
from operator import attrgetter, is_
from types import FunctionType, ModuleType
from typing import Any

_OTHERS = ("builtins", "math", "json", "pickle", "dataclasses", "numpy", "numpy.linalg")
"""Modules of others on which judgement rests; they may get new names, but none may change."""
_OURS = {
    ("resim.core.watchdog", "board"),
    ("resim.core.watchdog", "broken"),
    ("resim.sim.session", "_open"),
}
"""What resim itself sets anew as it runs."""
_LATE = (
    "__pydantic", "__annotations__", "__warningregistry__", "__doc__", "__signature__", "__slotnames__", "_abc_impl",
)  # fmt: skip
"""How names begin that Python and pydantic fill later."""
_ABSENT = object()


class _Place:
    """One thing with named parts, and what they were. open: whether it may get parts that it did not have."""

    def __init__(self, name: str, parts: Mapping[Any, Any], *, open: bool) -> None:
        self.name, self.parts, self.open = name, parts, open
        self.keep()

    def keep(self) -> None:
        self.before = dict(self.parts)  # holds the parts, so that no other object gets their identity
        self.values = [*self.before.values()]

    def same(self) -> bool:
        """Say whether every part is what it was."""
        return len(self.parts) == len(self.values) and all(map(is_, self.parts.values(), self.values))

    def changed(self) -> list[str]:
        """Name the parts that changed and may not."""
        if self.same():
            return []
        now = dict(self.parts)
        return [
            f"{self.name}.{part}"
            for part in {**self.before, **now}
            if now.get(part, _ABSENT) is not self.before.get(part, _ABSENT) and not self._may(part, now)
        ]

    def _may(self, part: Any, now: dict[Any, Any]) -> bool:
        if part not in self.before:
            return self.open or isinstance(now[part], ModuleType) or str(part).startswith(_LATE)
        return str(part).startswith(_LATE) or (self.name, part) in _OURS


_places: dict[str, list[_Place]] = {}
"""What each module was when it was first looked at."""
_functions: dict[str, FunctionType] = {}
_MADE_OF = [attrgetter(part) for part in ("__code__", "__defaults__", "__kwdefaults__")]
_made: list[list[Any]] = [[] for _ in _MADE_OF]
"""What each function was made of."""
_found: list[str] = []
"""What user's code changed in this process, for good."""


def remember() -> None:
    """Take everything as it is now as right: no user's code runs."""
    for name in [name for name in sys.modules if _is_judge(name) and name not in _places]:
        _note(name, sys.modules[name])
    for place in _all():
        if not place.same():
            place.keep()
    _made[:] = [[*map(part, _functions.values())] for part in _MADE_OF]


def changed() -> list[str]:
    """Name what is no longer as it was remembered, now or at an earlier call."""
    if not _found:
        _found.extend(name for place in _all() for name in place.changed())
        for part, made in zip(_MADE_OF, _made, strict=True):
            if not all(map(is_, map(part, _functions.values()), made)):
                was = zip(_functions.items(), made, strict=True)
                _found.extend(name for (name, function), old in was if part(function) is not old)
    return _found


def is_spoiled() -> bool:
    """Say whether `changed` ever named anything in this process."""
    return bool(_found)


def _all() -> list[_Place]:
    return [place for places in _places.values() for place in places]


def _is_judge(name: str) -> bool:
    return name in _OTHERS or name.partition(".")[0] == "resim"


def _note(name: str, module: ModuleType) -> None:
    """Remember a module, and of resim's its classes, functions and constants."""
    ours = name not in _OTHERS
    places = _places[name] = [_Place(name, vars(module), open=not ours)]
    if ours:
        for part, value in [*vars(module).items()]:
            if getattr(value, "__module__", None) == name or part.isupper():
                places.extend(_inside(f"{name}.{part}", value))


def _inside(name: str, value: Any) -> Iterator[_Place]:
    """What of a value could be changed under the same identity."""
    if isinstance(value, FunctionType):
        if name not in _functions:
            _functions[name] = value
            for part, made in zip(_MADE_OF, _made, strict=True):
                made.append(part(value))
    elif isinstance(value, type):
        yield _Place(name, value.__dict__, open=False)
        for attribute, inner in [*value.__dict__.items()]:
            function = getattr(inner, "fget", None) or getattr(inner, "func", None)
            function = function or getattr(inner, "__func__", inner)
            if isinstance(function, FunctionType):
                yield from _inside(f"{name}.{attribute}", function)
    elif isinstance(value, dict):
        yield _Place(name, value, open=False)
    elif isinstance(value, tuple):
        for k, item in enumerate(value):
            yield from _inside(f"{name}[{k}]", item)
    elif dataclasses.is_dataclass(value) and hasattr(value, "__dict__"):
        yield _Place(name, value.__dict__, open=True)  # which cached properties fill


class _Watch(importlib.abc.MetaPathFinder):
    """Remembers modules of resim as they are right after they were loaded, whoever imports them."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname.partition(".")[0] != "resim":
            return None
        spec = importlib.machinery.PathFinder.find_spec(fullname, path, target)
        loader: Any = None if spec is None else spec.loader
        if isinstance(loader, importlib.machinery.SourceFileLoader):
            load = loader.exec_module

            def execute(module: ModuleType) -> None:
                load(module)
                _note(fullname, module)

            loader.exec_module = execute  # type: ignore[method-assign]
        return spec


sys.meta_path.insert(0, _Watch())
