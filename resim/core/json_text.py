"""JSON as resim writes it: the same bytes for the same data."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

_IN_ONE_LINE = json.JSONEncoder(allow_nan=False).encode


def json_text(data: Any) -> str:
    """Give JSON, an array of numbers or texts in one line; ValueError for NaN."""
    pieces: list[str] = []
    _write(data, "", pieces)
    return "".join(pieces) + "\n"


def _write(data: Any, indent: str, pieces: list[str]) -> None:
    """Add JSON; dictionaries and lists of them are spread over lines."""
    deeper = indent + "  "
    if isinstance(data, Mapping) and data:
        start = "{\n"
        for key, value in data.items():
            pieces.append(f"{start}{deeper}{_IN_ONE_LINE(str(key))}: ")
            _write(value, deeper, pieces)
            start = ",\n"
        pieces.append(f"\n{indent}}}")
    elif isinstance(data, list | tuple) and any(
        issubclass(of, Mapping | list | tuple) for of in set(map(type, data))
    ):
        start = "[\n"
        for value in data:
            pieces.append(start + deeper)
            _write(value, deeper, pieces)
            start = ",\n"
        pieces.append(f"\n{indent}]")
    else:
        pieces.append(_IN_ONE_LINE(data))
