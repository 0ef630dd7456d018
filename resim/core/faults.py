"""What pydantic finds wrong with a user's file, in words."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from typing import Any

from pydantic import TypeAdapter
from pydantic.errors import PydanticInvalidForJsonSchema
from pydantic_core import ErrorDetails

from resim.core.spelling import did_you_mean

_PLAIN = (
    (re.compile(r"^Input should be greater than or equal to (.*)$"), r"expected \1 or more"),
    (re.compile(r"^Input should be less than or equal to (.*)$"), r"expected \1 or less"),
    (re.compile(r"^Input should be greater than (.*)$"), r"expected more than \1"),
    (re.compile(r"^Input should be "), "expected "),
    (re.compile(r"^Value error, "), ""),
    (re.compile(r"^\w+ should have (.*?)(?: after validation)?, not (.*)$"), r"expected \1, found \2"),
    (re.compile(r"^\w+ should have "), "expected "),
)
"""What pydantic's texts begin with, and how it is said here."""
_TYPES = {
    **dict.fromkeys(
        ("model_type", "model_attributes_type", "dict_type", "dataclass_type"), "expected a table"
    ),
    **dict.fromkeys(("list_type", "tuple_type", "set_type"), "expected a list"),
    **{"string_type": "expected text", "bool_type": "expected true or false"},
}
"""What is said of a fault of this type in place of pydantic's text."""
_CHOICES = ("literal_error", "enum")
"""Faults of what is none of several names, each of which the text has between quotation marks."""
_ALTERNATIVE = re.compile(r"^constrained-|^literal\[")
"""Parts of a place that say which of several types of a field was tried."""
_CHOICE = re.compile(r"'([^']*)'")


def describe(faults: Iterable[ErrorDetails], kind: Callable[..., object]) -> str:
    """Give every fault: field, what was expected, and the value where it is a plain one.

    kind: the model or dataclass that was read, whose fields are asked for one that is spelt alike.
    """
    found = list(faults)
    at = {fault["loc"][:n] for fault in found for n in range(len(fault["loc"]))}
    follow = [
        fault["type"] == "too_short" and fault["loc"] in at for fault in found
    ]  # of entries that are faulty
    return "; ".join(_said(fault, kind) for fault, drop in zip(found, follow, strict=True) if not drop)


_KEY = "[key]"
"""Last part of a place that is the name of an entry, not its value."""


def _said(fault: ErrorDetails, kind: Callable[..., object]) -> str:
    loc = fault["loc"]
    is_name = len(loc) > 1 and loc[-1] == _KEY
    parts = [part for part in map(str, loc[:-2] if is_name else loc) if not _ALTERNATIVE.match(part)]
    where = ".".join(parts) or "the whole"
    if fault["type"] == "missing":
        return f"{where}: is missing"
    if fault["type"] == "extra_forbidden":
        name = str(fault["loc"][-1])
        alike = did_you_mean(name, [field for field in _fields(kind) if field != name], cutoff=0.65)
        return f"{where}: there is no such field{alike}"
    said, found = _TYPES.get(fault["type"], fault["msg"]), fault["input"]
    for pattern, words in _PLAIN:
        said = pattern.sub(words, said)
    told = isinstance(found, str | int | float) and ", found " not in said
    meant = did_you_mean(str(found), _CHOICE.findall(said)) if fault["type"] in _CHOICES else ""
    said = (
        f"a name is {found!r:.60}, {said}" if is_name else said + (f", found {found!r:.60}" if told else "")
    )
    return f"{where}: {said}{meant}"


@cache
def _fields(kind: Callable[..., object]) -> tuple[str, ...]:
    """The names of all fields of a model and of its parts; none where it has no schema."""
    try:
        model: Any = kind
        adapter: TypeAdapter[Any] = TypeAdapter(model)
        return tuple(dict.fromkeys(_properties(adapter.json_schema())))
    except PydanticInvalidForJsonSchema:
        return ()


def _properties(schema: Any) -> Iterator[str]:
    if isinstance(schema, dict):
        if isinstance(schema.get("properties"), dict):
            yield from schema["properties"]
        for part in schema.values():
            yield from _properties(part)
    elif isinstance(schema, list):
        for part in schema:
            yield from _properties(part)
