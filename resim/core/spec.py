"""TOML files with a strict schema."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ConfigDict, ValidationError

from resim.core import faults
from resim.core.errors import InputError
from resim.core.files import parse_toml, read_file


class Strict(BaseModel):
    """A file's part: what it does not know, and what is no number, is refused."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)


File = TypeVar("File", bound=Strict)


def read_strict(path: Path, kind: type[File], example: str) -> File:
    """Read a TOML file of this kind. Raises InputError naming every fault; example: where one is to be seen."""
    try:
        return kind.model_validate(parse_toml(read_file(path, example), path, example))
    except ValidationError as e:
        raise InputError(path, faults.describe(e.errors()), example) from e
