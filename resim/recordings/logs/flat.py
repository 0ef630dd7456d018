"""A message as rows of a table: one for each element of its list, columns named by their dotted path."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from resim.recordings.logs.cdr import LONGEST_BYTES, Wanted
from resim.recordings.logs.limits import DEEPEST, LONGEST_ARRAY, MOST_CELLS, MOST_COLUMNS, MOST_ELEMENTS

LOG_TIME = "log_time"
"""Column of the time at which a message was recorded [ns]."""
SECONDS, NANOS = ("sec", "secs", "seconds"), ("nanosec", "nsec", "nsecs", "nanos", "nanoseconds")
"""Names of the two fields of a time, which becomes one number [ns]."""
SHARES = ("probability", "score", "confidence", "existence_probability")
"""Names of the field by which the likeliest element of a list within an object is taken."""
UUID = 16
"""Bytes of a UUID."""


def wanted_of(columns: Sequence[str], list_path: tuple[str, ...]) -> Wanted:
    """Give which fields of a message those columns are of, in the message and in the elements of its list."""
    own: dict[str, Any] = {}
    for column in columns:
        _enter(own, tuple(column.split(".")))
    if not list_path:
        return own
    of_message: dict[str, Any] = {}
    for column in columns:
        _enter(of_message, tuple(column.split(".")))
    place = of_message
    for name in list_path[:-1]:
        place = place.setdefault(name, {})
        if not isinstance(place, dict):
            return None
    place[list_path[-1]] = own
    return of_message


def _enter(tree: dict[str, Any], path: tuple[str, ...]) -> None:
    """Take a path into the tree; None ends it: all that lies below is wanted."""
    for name in path[:-1]:
        if name in tree and tree[name] is None:
            return
        tree = tree.setdefault(name, {})
    tree[path[-1]] = None


def rows_of(message: object, list_path: tuple[str, ...]) -> Iterator[dict[str, object]]:
    """Give the rows of a message: one, or one for each element of the list at list_path.

    An element's fields come before those of the message with the same path. Raises ValueError where there is no such
    list.
    """
    if not isinstance(message, Mapping):
        raise ValueError(f"it is {_kind(message)}, expected named fields")
    if not list_path:
        yield dict(_scalars(message, "", 0))
        return
    elements = list_at(message, list_path)
    whole = dict(_scalars(_without(message, list_path), "", 0))
    for element in elements:
        if not isinstance(element, Mapping):
            raise ValueError(
                f"an element of {'.'.join(list_path)} is {_kind(element)}, expected named fields"
            )
        yield whole | dict(_scalars(element, "", 0))


def list_at(message: object, path: tuple[str, ...]) -> Sequence[object]:
    """Give the list at a path of a message. Raises ValueError where there is none, naming what is there."""
    found: object = message
    for n, name in enumerate(path):
        if not isinstance(found, Mapping) or name not in found:
            there = ", ".join(list(found)[:40]) if isinstance(found, Mapping) else _kind(found)
            above = ".".join(path[:n]) or "it"
            raise ValueError(f"it has no list {'.'.join(path)!r}: {above} has {there or 'nothing'}")
        found = found[name]
    if found is None:
        return ()
    if not isinstance(found, list):
        raise ValueError(f"{'.'.join(path)} is {_kind(found)}, expected a list")
    if len(found) > MOST_ELEMENTS:
        raise ValueError(f"{'.'.join(path)} has {len(found)} elements, expected up to {MOST_ELEMENTS}")
    return found


def _without(message: Mapping[str, object], path: tuple[str, ...]) -> dict[str, object]:
    """The message without its list."""
    out = dict(message)
    inner = out.pop(path[0])
    if len(path) > 1 and isinstance(inner, Mapping):
        out[path[0]] = _without(inner, path[1:])
    return out


def _scalars(value: object, path: str, depth: int) -> Iterator[tuple[str, object]]:
    """The numbers and texts of a value, each with its path."""
    if depth > DEEPEST:
        raise ValueError(f"{path[:60]!r} is nested deeper than {DEEPEST} levels")
    if isinstance(value, Mapping):
        time = _time(value)
        if time is not None and path:
            yield path, time
            return
        for name, inner in value.items():
            yield from _scalars(inner, f"{path}.{name}" if path else str(name), depth + 1)
    elif isinstance(value, bytes):
        if len(value) <= LONGEST_BYTES:
            yield path, value.hex()
    elif isinstance(value, list):
        yield from _of_list(value, path, depth)
    elif value is not None:
        yield path, value


def _of_list(values: list[Any], path: str, depth: int) -> Iterator[tuple[str, object]]:
    """Of few numbers each, of 16 bytes a UUID, of structures those of the likeliest."""
    if not values or len(values) > MOST_ELEMENTS:
        return
    if len(values) == UUID and all(type(v) is int and 0 <= v < 256 for v in values):
        yield path, bytes(values).hex()
    elif all(isinstance(v, Mapping) for v in values):
        entries = [dict(_scalars(v, path, depth + 1)) for v in values]
        shares = [_share(entry, path) for entry in entries]
        if len(entries) == 1:
            yield from entries[0].items()
        elif all(share is not None for share in shares):
            yield from max(zip(shares, entries, strict=True), key=lambda both: both[0] or 0.0)[1].items()
    elif len(values) <= LONGEST_ARRAY:
        for n, value in enumerate(values):
            if isinstance(value, int | float | str):
                yield f"{path}.{n}", value


def _share(entry: Mapping[str, object], path: str) -> float | None:
    """How likely an element of a list is, None where it does not say."""
    for name, value in entry.items():
        own = name.removeprefix(f"{path}.").rpartition(".")[2]
        if own in SHARES and isinstance(value, int | float) and math.isfinite(value):
            return float(value)
    return None


def _time(value: Mapping[str, object]) -> int | None:
    """The ns of a time of seconds and nanoseconds, None for what is none."""
    if len(value) != 2:
        return None
    seconds = next((value[n] for n in SECONDS if n in value), None)
    nanos = next((value[n] for n in NANOS if n in value), None)
    if type(seconds) is not int or type(nanos) is not int:
        return None
    return seconds * 10**9 + nanos


def _kind(value: object) -> str:
    """What a value is, in words."""
    words = {dict: "a structure", list: "a list", str: "a text", bool: "true or false", bytes: "bytes"}
    return "nothing" if value is None else words.get(type(value), "a number")


class RowTable:
    """Rows that come one after the other, kept by column."""

    def __init__(self, columns: frozenset[str] | None) -> None:
        """columns: those that are kept; None: all."""
        self.columns = columns
        self.count = 0
        self._values: dict[str, list[object]] = {}

    def add(self, row: Mapping[str, object]) -> None:
        """Add a row. Raises ValueError where the table becomes too large."""
        for name, value in row.items():
            if self.columns is not None and name not in self.columns:
                continue
            own = self._values.setdefault(name, [])
            own.extend([None] * (self.count - len(own)))
            own.append(value)
        self.count += 1
        if len(self._values) > MOST_COLUMNS:
            raise ValueError(f"its rows have more than {MOST_COLUMNS} different fields")
        if self.count * len(self._values) > MOST_CELLS:
            raise ValueError(
                f"{self.count} rows of {len(self._values)} columns are too many, up to {MOST_CELLS} values"
            )

    @property
    def names(self) -> list[str]:
        """The columns that have a value in any row."""
        return list(self._values)

    def frame(self) -> pd.DataFrame:
        """Give the table, rows numbered from 1; whole numbers stay whole."""
        columns = {}
        for name, values in self._values.items():
            values.extend([None] * (self.count - len(values)))
            columns[name] = _column(values)
        return pd.DataFrame(columns, index=pd.RangeIndex(1, self.count + 1))


def _column(values: list[object]) -> Any:
    """The values as numbers where all are, whole ones exact; else as they are."""
    kinds = {type(v) for v in values}
    missing = type(None) in kinds
    if kinds <= {int, type(None)} and _are_whole(values):
        return pd.Series(values, dtype="Int64" if missing else "int64").array
    if kinds <= {int, float, type(None)}:
        with contextlib.suppress(OverflowError):  # a whole number of hundreds of digits
            return np.array([math.nan if v is None else v for v in values], dtype=float)
    return pd.Series([math.nan if v is None else v for v in values], dtype=object).array


def _are_whole(values: list[Any]) -> bool:
    """Whether all whole numbers have 64 bits at most."""
    return all(v is None or abs(v) < 1 << 63 for v in values)
