"""The map as a user's code gets it: a copy, so that nothing which that code does to it reaches those who judge."""

from __future__ import annotations

import io
import pickle
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache, cached_property
from itertools import chain
from operator import is_
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import shapely

from resim.core.errors import ChangedError
from resim.road.opendrive.network import RoadNetwork


@contextmanager
def lend_network(network: RoadNetwork, path: Path) -> Iterator[RoadNetwork]:
    """Give the copy of a map that all runs of a process share. path: of the file that names the user's code.

    Raises ChangedError at the end where that code changed it; the next run gets another.
    """
    if network not in _copies:
        _copies[network] = _Copy(network)
    copy = _copies[network]
    try:
        yield copy.network
    finally:
        if changed := copy.changed():
            _copies.pop(network, None)
            raise ChangedError(
                f"{path}: the code changed {changed} of the map, which every run is given. Leave the map as it is, "
                "or change a copy of it."
            )


class _Copy:
    """A copy of a map, and what it was made of."""

    def __init__(self, network: RoadNetwork) -> None:
        stream = io.BytesIO()
        pickler = _Pickler(stream, pickle.HIGHEST_PROTOCOL)
        pickler.dump(network)
        stream.seek(0)
        self.network: RoadNetwork = _Unpickler(stream, pickler.shared).load()
        parts = [_LentPart(name, thing) for name, thing in _things("", self.network)]
        self._lazy = [part for part in parts if part.later]
        self._parts = [part for part in parts if not part.later]
        self._held = [part.held for part in self._parts]
        self._tables = [part.held for part in self._parts if part.is_table]
        self._seen, self._sizes = [*self._look()], [*map(len, self._held)]

    def changed(self) -> str:
        """Name a part that is not what it was, "" where there is none; takes 25 ns a part, 1.5 ms for 1,200 lanes."""
        same = [*map(len, self._held)] == self._sizes and all(map(is_, self._look(), self._seen))
        parts = self._lazy if same else [*self._lazy, *self._parts]
        return next((name for part in parts for name in part.changed()), "")

    def _look(self) -> Iterator[Any]:
        """All at once, which is much quicker than one part after the other."""
        return chain(chain.from_iterable(map(dict.values, self._held)), chain.from_iterable(self._tables))


class _LentPart:
    """A table or an object of the map, and what it held."""

    def __init__(self, name: str, thing: Any) -> None:
        self.name, self.held, self.is_table = name, _contents(thing), isinstance(thing, dict)
        kind: Any = type(thing)
        self.later, self._before = _later(kind), dict(self.held)

    def changed(self) -> Iterator[str]:
        """Names of what is not what it was; what an object makes when it is first asked for may be new."""
        for name in {**self._before, **self.held}:
            new = name in self.later and name not in self._before
            if not new and self._before.get(name, _ABSENT) is not self.held.get(name, _ABSENT):
                yield _name(self.name, name, self.is_table)


_ABSENT = object()
_PLAIN = (str, float, int, np.ndarray)


def _things(name: str, thing: Any) -> Iterator[tuple[str, Any]]:
    """Give everything with contents that can be changed, by name."""
    if isinstance(thing, _PLAIN):
        return
    if isinstance(thing, tuple):
        for k, item in enumerate(thing):
            yield from _things(f"{name}[{k}]", item)
    elif isinstance(thing, dict) or (hasattr(thing, "__dict__") and not isinstance(thing, shapely.STRtree)):
        yield name, thing
        for key, item in _contents(thing).items():
            yield from _things(_name(name, key, isinstance(thing, dict)), item)


def _contents(thing: Any) -> dict[Any, Any]:
    return thing if isinstance(thing, dict) else vars(thing)


def _name(owner: str, part: Any, in_table: bool) -> str:
    return f"{owner}[{part!r}]" if in_table else f"{owner}.{part}".lstrip(".")


@cache
def _later(kind: Any) -> frozenset[str]:
    """Names of what an object of this kind makes when it is first asked for."""
    return frozenset(name for name in dir(kind) if isinstance(getattr(kind, name), cached_property))


class _Pickler(pickle.Pickler):
    """Keeps what nobody can change for the copy, too: constant arrays and search trees, most of a map's tables."""

    def __init__(self, file: io.BytesIO, protocol: int) -> None:
        super().__init__(file, protocol)
        self.shared: list[Any] = []

    def persistent_id(self, part: Any) -> int | None:
        constant = isinstance(part, np.ndarray) and not (part.flags.writeable or part.flags.owndata)
        if not constant and not isinstance(part, shapely.STRtree):
            return None
        self.shared.append(part)
        return len(self.shared) - 1


class _Unpickler(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, shared: list[Any]) -> None:
        super().__init__(file)
        self._shared = shared

    def persistent_load(self, number: int) -> Any:
        """Give a constant array itself, of a tree another object over the same."""
        part = self._shared[number]
        if isinstance(part, np.ndarray):
            return part
        tree = object.__new__(type(part))
        vars(tree).update(vars(part))
        return tree


_copies: WeakKeyDictionary[RoadNetwork, _Copy] = WeakKeyDictionary()
"""Of each map that is in use."""
