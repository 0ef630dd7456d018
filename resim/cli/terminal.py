"""What is printed: texts of others, such as ids and units, cannot steer the terminal."""

from __future__ import annotations

import re

import typer

STEERING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069]")
"""Control characters but tab and new line (ISO 6429), and those that turn the direction of writing (Unicode UAX 9)."""


def visible(text: str) -> str:
    """Give a text with its control characters written out: ESC as backslash and x1b."""
    return STEERING.sub(lambda found: found[0].encode("unicode_escape").decode("ascii"), text)


def say(text: str, *, err: bool = False) -> None:
    """Print a line to standard output, or to standard error."""
    typer.echo(visible(text), err=err)  # noqa: TID251
