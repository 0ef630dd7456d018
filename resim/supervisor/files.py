"""Files in registered folders that the lake does not know, such as settings and recordings of other formats.

A page names one by a number of its own; which file that is says a look into the folders, never the page.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase
from functools import lru_cache
from pathlib import Path

from resim.recordings.settings import SETTINGS
from resim.results.entry import KINDS
from resim.results.inputs import input_kind
from resim.results.scanning import DEEPEST, INSIDE, is_utf8
from resim.supervisor.runner import OWN_FILES

MOST_SEEN = 200_000
"""Files that are looked at."""
_KNOWN = (".toml", ".json")
"""Suffixes of files of which the lake knows some."""


def file_id(path: Path) -> str:
    """Give by what a page names a file."""
    return f"file-{hashlib.sha256(os.fsencode(path)).hexdigest()[:16]}"


def loose_files(roots: Sequence[Path], patterns: Sequence[str]) -> Iterator[Path]:
    """Give the files below some folders that are called like one of the patterns, in order, each once.

    A pattern "./NAME" is of folders that hold such a file, "././NAME" of those that hold such folders. What lies in
    recordings and results is theirs, and links and hidden files are left out, as by the lake.
    """
    given: set[Path] = set()
    for here, names in _folders(roots):
        found = [here / name for name in names if _is_called(name, patterns, "")]
        found += [here] if any(_is_called(name, patterns, "./") for name in names) else []
        found += [here.parent] if any(_is_called(name, patterns, "././") for name in names) else []
        for path in found:
            inside = any(path.is_relative_to(root) for root in roots)
            if inside and path not in given and not (path.suffix in _KNOWN and _is_known(path)):
                given.add(path)
                yield path


def _is_known(path: Path) -> bool:
    """Whether a file is one that the lake knows; it is read once, until it changes."""
    try:
        found = path.stat()
    except OSError:
        return True
    return _is_kind(path, found.st_mtime_ns, found.st_size)


@lru_cache(maxsize=10_000)
def _is_kind(path: Path, stamp: int, size: int) -> bool:
    return input_kind(path) is not None


def _is_called(name: str, patterns: Sequence[str], begin: str) -> bool:
    """Whether a file is called like a pattern that begins so; one of a folder ends with the name of its file."""
    own = (p.removeprefix(begin) for p in patterns if p.startswith(begin))
    return any(fnmatchcase(name, p) for p in own if not p.startswith("./"))


def _folders(roots: Sequence[Path]) -> Iterator[tuple[Path, list[str]]]:
    """All folders that are looked into, with the names of the files in each."""
    seen = 0
    for root in roots:
        if root.is_file():
            yield root.parent, [root.name]
            continue
        for where, folders, names in os.walk(root):
            here = Path(where)
            deep = len(here.relative_to(root).parts) < DEEPEST
            folders[:] = sorted(n for n in folders if not n.startswith(".") and deep and is_utf8(Path(n)))
            result = next((kind for kind, (mark, _) in KINDS.items() if mark in names), None)
            if SETTINGS in names or result is not None:
                folders[:] = [n for n in folders if n in INSIDE.get(result or "", ())]
                names = [n for n in names if n == SETTINGS]
            seen += len(names)
            if seen > MOST_SEEN:
                return
            told = (n for n in sorted(names) if not n.startswith(".") and n not in OWN_FILES)
            yield here, [n for n in told if is_utf8(Path(n)) and not (here / n).is_symlink()]
