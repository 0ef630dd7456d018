"""JSON as resim writes it: the same bytes for the same data."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any


def json_text(data: Any) -> str:
    """Give JSON, an array of numbers or texts in one line; ValueError for NaN."""
    return "".join(_json(data, "")) + "\n"


def _json(data: Any, indent: str) -> Iterator[str]:
    """JSON in pieces; dictionaries and lists of them are spread over lines."""
    deeper = indent + "  "
    if isinstance(data, Mapping) and data:
        start = "{\n"
        for key, value in data.items():
            yield f"{start}{deeper}{json.dumps(str(key))}: "
            yield from _json(value, deeper)
            start = ",\n"
        yield f"\n{indent}}}"
    elif isinstance(data, list | tuple) and any(
        issubclass(of, Mapping | list | tuple) for of in set(map(type, data))
    ):
        start = "[\n"
        for value in data:
            yield start + deeper
            yield from _json(value, deeper)
            start = ",\n"
        yield f"\n{indent}]"
    else:
        yield json.dumps(data, allow_nan=False)
