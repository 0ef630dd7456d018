"""What is wrong with a user's file is said in words of the file, not of the library that reads it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import pytest
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from resim.core.faults import describe
from resim.core.spec import TextPattern

RESIM = Path(__file__).parents[2] / "resim"


class Part(BaseModel):
    """A part of a file."""

    model_config = ConfigDict(extra="forbid")

    length: float = Field(gt=0.0, le=30.0)
    kind: Annotated[str, TextPattern("^[a-z]+$", "lower-case letters")] = "car"


class File(BaseModel):
    """A file."""

    model_config = ConfigDict(extra="forbid")

    name: str
    cycle_time: float = Field(default=0.1, ge=0.01, lt=10.0)
    parts: list[Part] = Field(default=[], max_length=2)
    needed: tuple[Part, ...] = Field(default=(Part(length=1.0),), min_length=1)
    quiet: bool = False
    at: Literal["ends", "middle"] | Annotated[float, Field(gt=0.0)] = "ends"
    outputs: dict[Literal["acceleration", "curvature"], str] = {}


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ({}, "name: is missing"),
        ({"name": "a", "cycle_tme": 1.0}, "cycle_tme: there is no such field, did you mean 'cycle_time'?"),
        ({"name": "a", "colour": 1.0}, "colour: there is no such field"),
        ({"name": "a", "parts": [{"lenght": 1.0}]}, "parts.0.length: is missing; "
         "parts.0.lenght: there is no such field, did you mean 'length'?"),
        ({"name": "a", "cycle_time": 0.001}, "cycle_time: expected 0.01 or more, found 0.001"),
        ({"name": "a", "cycle_time": 10.0}, "cycle_time: expected less than 10, found 10.0"),
        ({"name": "a", "parts": [{"length": 0.0}]}, "parts.0.length: expected more than 0, found 0.0"),
        ({"name": "a", "parts": [{"length": 31}]}, "parts.0.length: expected 30 or less, found 31"),
        ({"name": "a", "parts": {}}, "parts: expected a list"),
        ({"name": "a", "parts": [1]}, "parts.0: expected a table, found 1"),
        ({"name": "a", "parts": 3 * [{"length": 1.0}]}, "parts: expected at most 2 items, found 3"),
        ({"name": "a", "parts": [{"length": 1.0, "kind": "A"}]},
         "parts.0.kind: expected lower-case letters, found 'A'"),
        ({"name": "a", "needed": []}, "needed: expected at least 1 item, found 0"),
        ({"name": "a", "needed": [{"length": 0.0}]}, "needed.0.length: expected more than 0, found 0.0"),
        ({"name": 1, "quiet": []}, "name: expected text, found 1; quiet: expected true or false"),
        ({"name": "a", "outputs": {"acceleratoin": "x"}}, "outputs: a name is 'acceleratoin', expected "
         "'acceleration' or 'curvature', did you mean 'acceleration'?"),
        ({"name": "a", "at": -1.0},
         "at: expected 'ends' or 'middle', found -1.0; at: expected more than 0, found -1.0"),
        ([1], "the whole: expected a table"),
    ],
)  # fmt: skip
def test_each_fault_has_its_field_what_was_expected_and_what_was_found(data: object, said: str) -> None:
    with pytest.raises(ValidationError) as raised:
        File.model_validate(data)
    assert describe(raised.value.errors(), File) == said


def test_no_field_tells_its_pattern() -> None:
    """`TextPattern` says what is expected in words."""
    assert [file for file in RESIM.rglob("*.py") if "Field(pattern" in file.read_text()] == []
