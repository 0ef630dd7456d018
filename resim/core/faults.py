"""What pydantic finds wrong with a user's file, in words."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from difflib import get_close_matches
from functools import cache
from typing import Any

from pydantic import TypeAdapter
from pydantic.errors import PydanticInvalidForJsonSchema
from pydantic_core import ErrorDetails

_PLAIN = (
    (re.compile(r"^Input should be greater than or equal to (.*)$"), r"expected \1 or more"),
    (re.compile(r"^Input should be less than or equal to (.*)$"), r"expected \1 or less"),
    (re.compile(r"^Input should be greater than (.*)$"), r"expected more than \1"),
    (re.compile(r"^Input should be "), "expected "),
    (re.compile(r"^Value error, "), ""),
    (re.compile(r"^String should match pattern "), "expected text that matches "),
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


def describe(faults: Iterable[ErrorDetails], kind: Callable[..., object]) -> str:
    """Give every fault: field, what was expected, and the value where it is a plain one.

    kind: the model or dataclass that was read, whose fields are asked for one that is spelt alike.
    """
    return "; ".join(_said(fault, kind) for fault in faults)


def _said(fault: ErrorDetails, kind: Callable[..., object]) -> str:
    where = ".".join(map(str, fault["loc"])) or "the whole"
    if fault["type"] == "missing":
        return f"{where}: is missing"
    if fault["type"] == "extra_forbidden":
        name = str(fault["loc"][-1])
        alike = get_close_matches(name, [field for field in _fields(kind) if field != name], 1, cutoff=0.65)
        return f"{where}: there is no such field" + (f", did you mean {alike[0]!r}?" if alike else "")
    said, found = _TYPES.get(fault["type"], fault["msg"]), fault["input"]
    for pattern, words in _PLAIN:
        said = pattern.sub(words, said)
    told = isinstance(found, str | int | float) and ", found " not in said
    return f"{where}: {said}" + (f", found {found!r:.60}" if told else "")


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
