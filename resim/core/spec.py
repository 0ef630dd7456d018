"""Files with a strict schema: TOML as a model says it, JSON as a dataclass says it."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import (
    BaseModel,
    ConfigDict,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    PlainSerializer,
    PlainValidator,
    TypeAdapter,
    ValidationError,
    WithJsonSchema,
)
from pydantic_core import CoreSchema, PydanticCustomError
from pydantic_core.core_schema import no_info_after_validator_function

from resim.core import faults
from resim.core.errors import InputError
from resim.core.files import LARGEST_TEXT, parse_json, parse_toml, read_file
from resim.core.geometry import Floats
from resim.core.sealed import CHECKSUM, read_sealed

EXACT = ConfigDict(extra="forbid", allow_inf_nan=False)
"""For `__pydantic_config__` of a dataclass that is a file: it and its parts hold no other fields, and no NaN."""


def _number(told: Any) -> float:
    if told is None:
        return math.nan
    if isinstance(told, bool) or not isinstance(told, int | float) or not math.isfinite(told):
        raise ValueError("expected a number or none")
    return float(told)


NumberOrNan = Annotated[
    float,
    PlainValidator(_number),
    PlainSerializer(lambda number: None if number != number else number),  # in a union it may be a text
    WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "null"}]}),
]
"""A number of a dataclass that is NaN where there is none: null in its file."""


def _array(told: Any) -> Floats:
    cells = np.array(told, dtype=object)
    if not all(cell is None or type(cell) in (int, float) for cell in cells.ravel()):
        raise ValueError("expected numbers, or null for none")
    return cells.astype(float)


def _rows(array: Floats) -> Any:
    rows = array.astype(object)
    rows[np.isnan(array)] = None
    return rows.tolist()


ArrayInFile = Annotated[
    Floats, PlainValidator(_array), PlainSerializer(_rows), WithJsonSchema({"type": "array"})
]
"""An array of a dataclass, NaN where there is no number: lists in its file, and null."""


@dataclass(frozen=True)
class TextPattern:
    """Text of a form, for `Annotated`. pattern: what all of it must match; expected: that in words."""

    pattern: str
    expected: str

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        return no_info_after_validator_function(self._check, handler(source))

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return {**handler(schema), "pattern": self.pattern}

    def _check(self, text: str) -> str:
        if re.search(self.pattern, text) is None or "\n" in text:
            raise PydanticCustomError("form", "expected {words}", {"words": self.expected})
        return text


ModuleAndName = Annotated[
    str, TextPattern(r"^[\w.]+:\w+$", "a module and a name in it, such as my_module:MyFunction")
]
Sha256 = Annotated[str, TextPattern(r"^[0-9a-f]{64}$", "a SHA-256: 64 characters of 0-9 and a-f")]


class Strict(BaseModel):
    """A file's part: what it does not know, and what is no number, is refused."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)


File = TypeVar("File", bound=Strict)


def read_strict(path: Path, kind: type[File], example: str) -> File:
    """Read a TOML file of this kind. Raises InputError naming every fault; example: where one is to be seen."""
    return strict_of(read_file(path, example), path, kind, example)


def strict_of(raw: bytes, path: Path, kind: type[File], example: str) -> File:
    """Give what the bytes of a TOML file of this kind say, as `read_strict`."""
    try:
        return kind.model_validate(parse_toml(raw, path, example))
    except ValidationError as e:
        raise InputError(path, faults.describe(e.errors(), kind), example) from e


T = TypeVar("T")


def to_json(value: object) -> Any:
    """Give what JSON holds of a dataclass: fields by name, in their order."""
    kind: Any = type(value)
    return _adapter(kind).dump_python(value, by_alias=True)


def read_json(path: Path, kind: Callable[..., T], writer: str, remedy: str) -> T:
    """Read a JSON file as a dataclass. writer: the command that writes it. Raises InputError for what is none."""
    raw = read_file(path, remedy)
    parse_json(raw, path, remedy)
    try:
        found: T = _adapter(kind).validate_json(raw, strict=True)
        return found
    except ValidationError as e:
        raise InputError(
            path, f"is not what `{writer}` writes: {faults.describe(e.errors(), kind)}", remedy
        ) from e


def read_sealed_json(
    path: Path, kind: Callable[..., T], writer: str, remedy: str, *, largest: int = LARGEST_TEXT
) -> T:
    """Read a JSON file with a checksum of itself as a dataclass. Raises InputError, also where it was changed."""
    return from_json(read_sealed(path, remedy, largest=largest), kind, path, writer, remedy)


def from_json(data: Any, kind: Callable[..., T], path: Path, writer: str, remedy: str) -> T:
    """Give what a part of the JSON file at `path` holds as a dataclass. Raises InputError for what is none."""
    try:
        return exactly(data, kind)
    except ValidationError as e:
        raise InputError(
            path, f"is not what `{writer}` writes: {faults.describe(e.errors(), kind)}", remedy
        ) from e


def exactly(data: Any, kind: Callable[..., T]) -> T:
    """Give JSON data as a dataclass. Raises ValidationError (a ValueError) for what is none."""
    found: T = _adapter(kind).validate_json(json.dumps(data), strict=True)
    return found


def json_schema(kind: Any) -> dict[str, Any]:
    """Give the JSON Schema of a file that a dataclass says."""
    return _adapter(kind).json_schema(mode="serialization")


def sealed_schema(kind: Any) -> dict[str, Any]:
    """Give the JSON Schema of a file that a dataclass says, and that has a checksum of itself."""
    found = json_schema(kind)
    checksum: Mapping[str, Any] = {"type": "string", "pattern": "^[0-9a-f]{64}$"}
    return {
        **found,
        "properties": {CHECKSUM: checksum, **found["properties"]},
        "required": [CHECKSUM, *found["required"]],
    }


@lru_cache(maxsize=64)
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)
