"""What is printed: texts of others, such as ids and units, cannot steer the terminal."""

from __future__ import annotations

import json
import re
from typing import Any

import typer

STEERING = re.compile("[\x00-\x08\x0a-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")
"""Control characters but tab (ISO 6429), ends of lines, and what turns the direction of writing (Unicode UAX 9)."""


def visible(text: str) -> str:
    """Give a text as one line, its control characters written out: ESC as backslash and x1b."""
    return STEERING.sub(lambda found: found[0].encode("unicode_escape").decode("ascii"), text)


def say(text: str, *, err: bool = False) -> None:
    """Print a line to standard output, or to standard error."""
    typer.echo(visible(text), err=err)  # noqa: TID251


def say_json(told: Any) -> None:
    """Print what JSON can hold to standard output."""
    for line in json.dumps(told, indent=2).splitlines():
        say(line)
