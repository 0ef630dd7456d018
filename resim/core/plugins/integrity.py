"""Whether a user's code changed the program that judges it: functions, classes and constants of resim, numpy's top.

What is there before the first such code runs in a process is right as long as the process lives. The next look tells
what changed, whenever that was: also between two runs, by a thread or by `__del__`.

A check, no wall: what runs in a process can hide from it. It finds what code replaces by mistake or for convenience.
"""

from __future__ import annotations

import ctypes
import dataclasses
import importlib.abc
import importlib.machinery
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import chain
from operator import attrgetter, is_
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

from resim.core.errors import ChangedError

_OTHERS = ("builtins", "math", "json", "pickle", "dataclasses", "numpy", "numpy.linalg")
"""Modules of others on which judgement rests; they may get new names, but none may change."""
_OURS = {
    ("resim.core.plugins.descendants", "keeper"),
    ("resim.core.plugins.watchdog", "board"),
    ("resim.core.plugins.watchdog", "whose"),
    ("resim.core.plugins.watchdog", "broken"),
    ("resim.simulation.sumo.session", "_open"),
}
"""What resim itself sets anew as it runs."""
_LATE = (
    "__pydantic", "__annotations__", "__warningregistry__", "__doc__", "__signature__", "__slotnames__", "_abc_impl",
)  # fmt: skip
"""How names begin that Python and pydantic fill later."""
_ABSENT = object()


class _Place:
    """One thing with named parts, and what they were. new: whether it may get a part that it did not have."""

    def __init__(self, name: str, parts: Mapping[Any, Any], new: Callable[[Any, Any], bool]) -> None:
        self.name, self.parts, self._new = name, parts, new
        self.before = dict(parts)  # holds the parts, so that no other object gets their identity
        self.values = [*self.before.values()]

    def changed(self) -> list[str]:
        """Name the parts that changed and may not."""
        if len(self.parts) == len(self.values) and all(map(is_, self.parts.values(), self.values)):
            return []
        now = dict(self.parts)
        return [
            f"{self.name}.{part}"
            for part in {**self.before, **now}
            if now.get(part, _ABSENT) is not self.before.get(part, _ABSENT) and not self._may(part, now)
        ]

    def _may(self, part: Any, now: dict[Any, Any]) -> bool:
        if str(part).startswith(_LATE):
            return True
        return (self.name, part) in _OURS if part in self.before else self._new(part, now[part])


_places: list[_Place] = []
_modules: dict[str, list[ModuleType]] = {}
"""Modules that are watched, by their names: one for each time that it was loaded."""
_functions: list[tuple[str, FunctionType]] = []
_MADE_OF = [attrgetter(part) for part in ("__code__", "__defaults__", "__kwdefaults__")]
_made: list[list[Any]] = [[] for _ in _MADE_OF]
"""What each function was made of."""
_seen: list[Any] = []
"""All named parts as they were at the last look that found nothing: while each is the same object, none has changed."""
_rewritten: list[str] = []
"""Events of Python that tell of a function that is made of something else now, since functions were looked into."""
_found: list[str] = []
"""What user's code changed in this process, for good."""
_ran: list[Path] = []
"""The user's file whose code ran last."""


def note() -> None:
    """Remember what there is, which is right: no user's code ran yet. What is imported later is noted as it comes."""
    if not _modules:
        for name, module in [*sys.modules.items()]:
            if name in _OTHERS or name.partition(".")[0] == "resim":
                _note(name, module)


def begin(path: Path) -> None:
    """Look before the code of a user's file runs; what is there before the first is right. Raises as `check`."""
    note()
    check()
    _ran[:] = [path]


def check(*, whole: bool = False) -> None:
    """Raise ChangedError where something is not as it was, now or at an earlier look; it names whose code ran last.

    Before user's code ran there is nobody to name, and nothing to find.

    whole: whether functions are looked into as well of which Python told no change; that takes ten times as long.
    """
    if not _ran:
        return
    if not _found:
        _found.extend(_changed(whole=whole or bool(_rewritten)))
    if _found:
        raise ChangedError(
            f"{_ran[0]}: the code changed {', '.join(_found[:3])}, by which it is judged. "
            "Do not change resim, numpy or Python."
        )


def is_spoiled() -> bool:
    """Say whether `check` ever found anything in this process."""
    return bool(_found)


def _changed(*, whole: bool) -> Iterator[str]:
    """Name what is not as it was. whole: whether functions are looked into."""
    for name, modules in _modules.items():
        if not any(sys.modules.get(name, modules[0]) is module for module in modules):
            yield f"sys.modules[{name!r}]"
    now = _everything()
    if not _seen or not _same(now, _seen[0]):
        found = [changed for place in _places for changed in place.changed()]
        yield from found
        _seen[:] = [] if found else [now]
    if whole:
        _rewritten.clear()
        functions = [function for _, function in _functions]
        for part, made in zip(_MADE_OF, _made, strict=True):
            if not all(map(is_, map(part, functions), made)):
                was = zip(_functions, made, strict=True)
                yield from (name for (name, function), old in was if part(function) is not old)


def _everything() -> Any:
    """All named parts, as an array of objects, which it holds."""
    import numpy as np

    return np.fromiter(chain.from_iterable([place.parts.values() for place in _places]), dtype=object)


def _same(one: Any, other: Any) -> bool:
    """Whether two arrays hold the same objects: by where these lie, as what is asked whether it is equal may lie."""
    return bool(one.size == other.size and _lying(one) == _lying(other))


def _lying(objects: Any) -> bytes:
    return ctypes.string_at(objects.ctypes.data, objects.nbytes)


def _note(name: str, module: ModuleType) -> None:
    """Remember a module, and of resim's its classes, functions and constants."""
    _modules.setdefault(name, []).append(module)
    if name in _OTHERS:
        _places.append(_Place(name, vars(module), _always))
        return
    _places.append(_Place(name, vars(module), lambda part, value: _is_watched(f"{name}.{part}", value)))
    for part, value in [*vars(module).items()]:
        if getattr(value, "__module__", None) == name or part.isupper():
            _places.extend(_inside(f"{name}.{part}", value))


def _is_watched(name: str, value: object) -> bool:
    return any(value is module for module in _modules.get(name, ()))


def _always(part: Any, value: Any) -> bool:
    return True


def _is_number(part: Any, value: Any) -> bool:
    """Messages of protobuf keep the numbers of their enums once they were asked for."""
    return isinstance(value, int)


def _never(part: Any, value: Any) -> bool:
    return False


def _inside(name: str, value: Any) -> Iterator[_Place]:
    """What of a value could be changed under the same identity."""
    if isinstance(value, FunctionType):
        _functions.append((name, value))
        for part, made in zip(_MADE_OF, _made, strict=True):
            made.append(part(value))
    elif isinstance(value, type):
        own = str(value.__module__).partition(".")[0] == "resim"
        yield _Place(name, value.__dict__, _never if own else _is_number)
        for attribute, inner in [*value.__dict__.items()]:
            function = getattr(inner, "fget", None) or getattr(inner, "func", None)
            function = function or getattr(inner, "__func__", inner)
            if isinstance(function, FunctionType):
                yield from _inside(f"{name}.{attribute}", function)
    elif isinstance(value, dict):
        yield _Place(name, value, _never)
    elif isinstance(value, tuple):
        for k, item in enumerate(value):
            yield from _inside(f"{name}[{k}]", item)
    elif dataclasses.is_dataclass(value) and hasattr(value, "__dict__"):
        kind = type(value)
        yield _Place(
            name, value.__dict__, lambda part, _: isinstance(getattr(kind, part, None), cached_property)
        )


def _hear(event: str, arguments: tuple[Any, ...]) -> None:
    if event in ("object.__setattr__", "object.__delattr__") and isinstance(arguments[0], FunctionType):
        _rewritten.append(event)


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
                if _modules:
                    _note(fullname, module)

            loader.exec_module = execute  # type: ignore[method-assign]
        return spec


sys.meta_path.insert(0, _Watch())
sys.addaudithook(_hear)  # for good: there is no way to take one away
