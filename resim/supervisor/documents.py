"""Files in folders of results and of tasks, as a browser may open them."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from resim.core.errors import InputError
from resim.results.scanning import is_utf8

TYPES = {
    ".html": "text/html; charset=utf-8", ".css": "text/css; charset=utf-8", ".json": "application/json",
    ".xml": "text/plain; charset=utf-8", ".txt": "text/plain; charset=utf-8", ".toml": "text/plain; charset=utf-8",
    ".csv": "text/plain; charset=utf-8", ".svg": "image/svg+xml", ".png": "image/png",
    **dict.fromkeys((".xodr", ".xosc", ".yaml", ".yml", ".md", ".log", ".jsonl"), "text/plain; charset=utf-8"),
    **dict.fromkeys((".parquet", ".feather", ".osi", ".mcap", ".db3", ".mf4", ".zip"), "application/octet-stream"),
}  # fmt: skip
"""Of files that are given, by suffix: those of recordings, maps, results and exports."""
SHOWN = 5_000_000
"""Bytes of the largest file that a browser shows itself; pages aside."""
MOST_FILES, MOST_SEEN, DEEPEST = 200, 5_000, 3
"""Files of a folder that are listed, and looked at, and levels of folders in it."""


@dataclass(frozen=True)
class Document:
    """A file and what it is. is_shown: by the browser, which keeps it otherwise."""

    path: Path
    type: str
    is_shown: bool = True


def find_document(folder: Path, name: str) -> Document:
    """Give the file of this name in a folder. Raises InputError for one that is not there, or leads out of it."""
    none = InputError(f"{name:.200}", "is no file of this folder")
    parts = name.split("/")
    if any(not p or p.startswith(".") or "\\" in p or not p.isprintable() for p in parts):
        raise none
    try:
        path = Path(os.path.realpath(folder.joinpath(*parts)))
        found = path.stat()
        inside = path.is_relative_to(os.path.realpath(folder)) and stat.S_ISREG(found.st_mode)
    except (OSError, ValueError):
        raise none from None
    if not inside or path.suffix not in TYPES:
        raise none
    kind = TYPES[path.suffix]
    is_small = found.st_size <= SHOWN or path.suffix == ".html"
    return Document(path, kind, is_small and kind != "application/octet-stream")


def pages(folder: Path) -> list[str]:
    """Give the names of the pages in a folder and in those right below, seen from it."""
    found: list[str] = []
    for pattern in ("*.html", "*/*.html"):
        found += sorted(p.relative_to(folder).as_posix() for p in folder.glob(pattern) if p.is_file())
    return [name for name in found if is_utf8(Path(name)) and not name.startswith(".") and "/." not in name]


def files_in(folder: Path, left_out: Iterable[str] = ()) -> list[tuple[str, int]]:
    """Give the names of the files in a folder that may be opened, seen from it, and their sizes [bytes].

    left_out: names of files right in it. Of very many the first.
    """
    found: list[tuple[str, int]] = []
    seen = 0
    for where, folders, names in os.walk(folder):
        here = Path(where).relative_to(folder)
        folders[:] = sorted(n for n in folders if len(here.parts) + 1 < DEEPEST and is_utf8(Path(n)))
        seen += len(names)
        if seen > MOST_SEEN:
            return found
        for name in sorted(names):
            told = (here / name).as_posix()
            if not is_utf8(Path(name)) or (here == Path() and name in left_out):
                continue
            with suppress(InputError, OSError):
                found.append((told, find_document(folder, told).path.stat().st_size))
            if len(found) >= MOST_FILES:
                return found
    return found
