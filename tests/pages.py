"""The pages of the documentation: what they show, name and link to."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer

from resim.cli import app

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
OUTSIDE = ("README.md", "CONTRIBUTING.md", "tools/README.md", "networks/README.md")
PAGES = [ROOT / name for name in OUTSIDE] + sorted(DOCS.rglob("*.md"))
SETTINGS = typer.main.get_command(app).context_settings
"""What a command takes over from the one above. Commands keep the help option that they were first asked with."""
_FENCE = re.compile(r"^```(\S*).*?\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def text(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def blocks(page: Path, language: str) -> list[str]:
    """Give the fenced blocks of a language, "" for those of none: commands."""
    return [body for of, body in _FENCE.findall(text(page)) if of == language]


def named(page: Path, language: str) -> dict[str, str]:
    """Give the examples on a page by the file name in their first line."""
    found = blocks(page, language)
    return {body.splitlines()[0].removeprefix("# "): body for body in found}


def commands(page: Path) -> list[list[str]]:
    """Give the commands on a page as words, in order, without comments."""
    lines = (
        line for body in blocks(page, "") for line in body.replace("\\\n", " ").splitlines() if line.strip()
    )
    return [shlex.split(line, comments=True) for line in lines]


def inline(page: Path) -> Iterator[list[str]]:
    """Give what stands between backticks and begins with resim."""
    for code in re.findall(r"`(resim [^`\n]+)`", _FENCE.sub("", text(page))):
        yield code.split()


def anchors(page: Path) -> set[str]:
    """Give the anchors of the headings, as forges make them."""
    heads = re.findall(r"^#+ (.*)$", _FENCE.sub("", text(page)), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", head.lower()).replace(" ", "-") for head in heads}


def command_of(words: list[str]) -> tuple[Any, list[str]]:
    """Give the command that words after `resim` mean, and the rest of them."""
    command: Any = typer.main.get_command(app)
    rest = list(words)
    while below := getattr(command, "commands", None):
        if rest and rest[0] in below:
            command = below[rest.pop(0)]
        elif type(command).__name__ == "_FirstByDefault":
            command = next(iter(below.values()))
        else:
            break
    return command, rest
