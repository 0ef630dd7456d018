"""Files in folders of results and of tasks, as a browser may open them."""

from __future__ import annotations

import os
import stat
from dataclasses import dataclass
from pathlib import Path

from resim.core.errors import InputError
from resim.results.scanning import is_utf8

TYPES = {
    ".html": "text/html; charset=utf-8", ".css": "text/css; charset=utf-8", ".json": "application/json",
    ".xml": "text/plain; charset=utf-8", ".txt": "text/plain; charset=utf-8", ".toml": "text/plain; charset=utf-8",
    ".csv": "text/csv; charset=utf-8", ".parquet": "application/octet-stream", ".svg": "image/svg+xml",
}  # fmt: skip
"""Of files that are given, by suffix; there are no others in results."""


@dataclass(frozen=True)
class Document:
    """A file and what it is."""

    path: Path
    type: str


def find_document(folder: Path, name: str) -> Document:
    """Give the file of this name in a folder. Raises InputError for one that is not there, or leads out of it."""
    none = InputError(f"{name:.200}", "is no file of this folder")
    parts = name.split("/")
    if any(not p or p.startswith(".") or "\\" in p or not p.isprintable() for p in parts):
        raise none
    try:
        path = Path(os.path.realpath(folder.joinpath(*parts)))
        inside = path.is_relative_to(os.path.realpath(folder)) and stat.S_ISREG(path.stat().st_mode)
    except (OSError, ValueError):
        raise none from None
    if not inside or path.suffix not in TYPES:
        raise none
    return Document(path, TYPES[path.suffix])


def pages(folder: Path) -> list[str]:
    """Give the names of the pages in a folder and in those right below, seen from it."""
    found: list[str] = []
    for pattern in ("*.html", "*/*.html"):
        found += sorted(p.relative_to(folder).as_posix() for p in folder.glob(pattern) if p.is_file())
    return [name for name in found if is_utf8(Path(name)) and not name.startswith(".") and "/." not in name]
