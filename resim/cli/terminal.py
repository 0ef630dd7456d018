"""What is printed: texts of others, such as ids and units, cannot steer the terminal."""

from __future__ import annotations

import json
import re
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, is_dataclass
from pathlib import Path
from typing import Any

import typer

from resim.core.errors import InputError, ResimError

STEERING = re.compile("[\x00-\x08\x0a-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")
"""Control characters but tab (ISO 6429), ends of lines, and what turns the direction of writing (Unicode UAX 9)."""


@dataclass(frozen=True)
class OutputSettings:
    """How the command at work tells of its results and progress.

    Attributes:
        json: Results as one JSON object in place of text.
        quiet: No results and no progress; errors and bad verdicts only.
        verbose: Progress as a line for each step, and for errors where in resim they arose.
        results: What the JSON object holds.
    """

    json: bool = False
    quiet: bool = False
    verbose: bool = False
    results: dict[str, Any] = field(default_factory=dict)


_telling = [OutputSettings()]


def output_settings() -> OutputSettings:
    """Give how the command at work tells of its results."""
    return _telling[-1]


@contextmanager
def output_as(how: OutputSettings) -> Iterator[None]:
    """Tell so within; in the end, also where the verdict is bad, the JSON object is printed."""
    if how.quiet and (how.json or how.verbose):
        raise InputError(
            "--quiet", f"contradicts {'--json' if how.json else '--verbose'}", "Leave out one of the two."
        )
    _telling.append(how)
    try:
        yield
    except ResimError:
        if how.verbose:
            for line in traceback.format_exc().splitlines():
                say(line, err=True)
        raise
    finally:
        _telling.pop()
        if how.results:
            typer.echo(json.dumps(how.results, indent=2))  # noqa: TID251  ASCII: nothing in it steers a terminal


def visible(text: str) -> str:
    """Give a text as one line, its control characters written out: ESC as backslash and x1b."""
    return STEERING.sub(lambda found: found[0].encode("unicode_escape").decode("ascii"), text)


def say(text: str, *, err: bool = False) -> None:
    """Print a line to standard output, if text is wanted there, or to standard error."""
    if err or is_text_wanted():
        typer.echo(visible(text), err=err)  # noqa: TID251


def show(text: str) -> None:
    """Print what a child printed, colours and all, if text is wanted."""
    if is_text_wanted():
        typer.echo(text, nl=False)  # noqa: TID251


def is_text_wanted() -> bool:
    """Say whether standard output is for text."""
    return not (output_settings().json or output_settings().quiet)


def add_to_json(**results: Any) -> None:
    """Add results to the JSON object, if one is wanted: of a JSON file what it holds, of other files where they lie."""
    if output_settings().json:
        output_settings().results.update({name: _plain(value) for name, value in results.items()})


def _plain(value: Any) -> Any:
    """What JSON can hold of a result."""
    if isinstance(value, Path):
        return json.loads(value.read_text(encoding="utf-8")) if value.suffix == ".json" else str(value)
    if is_dataclass(value) and not isinstance(value, type):
        value = asdict(value)
    if isinstance(value, dict):
        return {str(name): _plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    return None if isinstance(value, float) and value - value != 0.0 else value
