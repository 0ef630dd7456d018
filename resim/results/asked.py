"""How results were asked for: the command line that makes them again, in a file beside them."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from resim.core.errors import InputError
from resim.core.files import file_hash
from resim.core.json_text import json_text
from resim.core.sealed import read_sealed, sealed
from resim.results.entry import KINDS, CatalogEntry, ItemKind, digest, kind_of

FILE = "asked.json"
AGAIN = "again"
"""Folder, below where the command is called, into which results are made again."""
MOST_PATHS = 200
"""Files of a command line that is offered; that of more is of no use to a person."""
_REMEDY = "Make the results again."
SWEEP_RUN = ("sweep", "repeat")
_ROLES: dict[ItemKind, tuple[str, ...]] = {
    "run": ("recording", "build", "criteria", "perception"), "verification": ("suite", "build", "against"),
    "assessment": ("criteria",), "mining": ("recording",),
}  # fmt: skip
"""Inputs whose hash the results state themselves: what is asked for must be these."""


@dataclass(frozen=True)
class AskedValue:
    """A value of a command line.

    option: such as --seed, "" for an argument. text: of it, "" for an option without a value; of a file its path. hash:
    SHA-256 of what lies there, "" where it is no path.
    """

    option: str
    text: str = ""
    hash: str = ""


@dataclass(frozen=True)
class AskedResults:
    """A command line without what changes no result, such as where it goes. command: its words after `resim`."""

    command: tuple[str, ...]
    values: tuple[AskedValue, ...]


def mark_of(folder: Path) -> Path | None:
    """Give the file by which results in a folder are known, None where there are none."""
    return next((folder / file for file, _ in KINDS.values() if (folder / file).is_file()), None)


def write_asked(asked: AskedResults, folder: Path) -> None:
    """Write down how the results in a folder were asked for: paths seen from it. Raises OSError or InputError."""
    home = os.path.realpath(folder)
    values = [
        vars(v) | {"text": os.path.relpath(os.path.realpath(v.text), home) if v.hash else v.text}
        for v in asked.values
    ]
    told = {
        "of": digest(folder, kind_of(folder)),
        "command": [*asked.command],
        "values": values,
    }
    new = folder / f".{FILE}.{os.getpid()}.new"
    new.write_text(json_text(sealed(told)), encoding="utf-8")
    new.replace(folder / FILE)


def read_asked(entry: CatalogEntry) -> AskedResults | None:
    """Give how results were asked for; None where nobody wrote it down, or it is not of what lies there now."""
    try:
        told: dict[str, Any] = read_sealed(entry.folder / FILE, _REMEDY)
        if told["of"] != entry.digest:
            return None
        values = tuple(
            AskedValue(v["option"], str(entry.folder / v["text"]) if v["hash"] else v["text"], v["hash"])
            for v in told["values"]
        )
        command = tuple(str(word) for word in told["command"])
    except (InputError, OSError, KeyError, TypeError):
        return None
    if command == SWEEP_RUN:  # the sweep, whose content is told, says of what
        return AskedResults(command, values)
    asked = {v.hash for v in values}
    stated = {i.hash for i in entry.inputs if i.role in _ROLES.get(entry.kind, ()) and i.hash}
    return AskedResults(command, values) if stated <= asked else None


def words_of(asked: AskedResults, find: Callable[[str], str | None]) -> list[str]:
    """Give the words of the command line, arguments first; [] where something of it is nowhere.

    find: gives where a content lies, by its hash; None for one that it does not know.
    """
    if sum(bool(v.hash) for v in asked.values) > MOST_PATHS:
        return []
    arguments: list[str] = []
    options: list[str] = []
    for value in asked.values:
        text = value.text
        if value.hash:
            path = find(value.hash) or (text if _is_at(value) else None)
            if path is None:
                return []
            text = os.path.normpath(path)
        if value.option:
            options += [word for word in (value.option, text) if word]
        else:
            arguments.append(text)
    return ["resim", *asked.command, *arguments, *options, "--out", AGAIN]


def _is_at(value: AskedValue) -> bool:
    try:
        return content_of(Path(value.text)) == value.hash
    except (InputError, OSError, ValueError, KeyError, TypeError):
        return False


def content_of(path: Path) -> str:
    """Give the SHA-256 of what a command is given, as the lake has it: a recording, results, or a file.

    Of a recording whose content has no hash it is that of its settings. Raises InputError or OSError for anything else
    that cannot be read.
    """
    from resim.metrics.criteria import freeze_criteria
    from resim.recordings.content import content_hash
    from resim.recordings.settings import SETTINGS
    from resim.results.inputs import input_kind
    from resim.simulation.function.interface import freeze_build

    if (path / SETTINGS).is_file():
        try:
            return content_hash(path)
        except InputError:  # the command went on without it, and would again
            return file_hash(path / SETTINGS)
    if path.is_dir():
        return digest(path, kind_of(path))
    freeze = {"build": freeze_build, "criteria": freeze_criteria}.get(input_kind(path) or "")
    return file_hash(path) if freeze is None else freeze(path).hash
