"""The recordings that a file names (a suite, a sweep): folders, globs of folders, hashes."""

from __future__ import annotations

import glob
import re
from collections.abc import Iterator, Sequence
from itertools import chain, count
from pathlib import Path

from pydantic import Field

from resim.core.errors import InputError
from resim.core.files import joined, refuse_undecodable
from resim.core.spec import Sha256, Strict
from resim.recordings.present import table_file
from resim.recordings.settings import SETTINGS


class RecordingEntry(Strict):
    """A recording that a file names: its folder, or a glob of folders; hash: of its content (`content_hash`)."""

    folder: str = Field(min_length=1)
    hash: Sha256 | None = None


def found_folders(path: Path, entries: Sequence[RecordingEntry]) -> tuple[dict[str, Path], dict[str, str]]:
    """Give the recordings that the entries of the file at `path` name, and the hashes that they must have, by name."""
    found: list[Path] = []
    hashes: dict[Path, str] = {}
    for entry in entries:
        folders = _folders(path, entry)
        if entry.hash is not None and hashes.setdefault(folders[0], entry.hash) != entry.hash:
            raise InputError(
                path, f"recording {entry.folder!r} is a duplicate, with two hashes", "Remove one."
            )
        found += [folder for folder in folders if folder not in found]
    named = dict(zip(_names(found), found, strict=True))
    return named, {name: hashes[folder] for name, folder in named.items() if folder in hashes}


def _folders(path: Path, entry: RecordingEntry) -> list[Path]:
    """The recordings of an entry; one that is not there is told of when its turn comes."""
    whole = joined(path, entry.folder)
    if entry.hash is not None or not glob.has_magic(entry.folder):
        return [whole]
    try:
        fitting = sorted(_matching(whole))
        found = [f for f in fitting if (f / SETTINGS).is_file()]
    except ValueError as e:
        raise InputError(path, f"recording {entry.folder!r} is not a valid glob ({e})", "Correct it.") from e
    for folder in found:
        refuse_undecodable(folder)
    for folder in fitting:  # what is no recording any more must not drop out without a word
        if folder not in found and (
            not folder.exists() or table_file(folder, "gt") or table_file(folder, "sd")
        ):
            problem = f"recording {entry.folder!r}: {folder} has no {SETTINGS}"
            raise InputError(path, problem, "Put it back, or let the glob not fit it.")
    if not found:
        raise InputError(path, f"recording {entry.folder!r}: there is no recording", "Correct the glob.")
    return found


def _matching(pattern: Path) -> Iterator[Path]:
    """Paths that a glob fits."""
    root = Path(pattern.anchor)
    return root.glob(str(pattern.relative_to(root)) if pattern.anchor else str(pattern))


def _names(folders: Sequence[Path]) -> list[str]:
    """Names of recordings, each its own: of the folder, with as many folders above as it takes, else with a number."""
    out: list[str] = []
    for folder in folders:
        parts = [re.sub(r"[^\w.-]", "_", part) for part in folder.absolute().parts if part.strip("/")]
        parts = parts or ["root"]
        choices = [".".join(parts[-depth:]) for depth in range(1, len(parts) + 1)]
        numbered = (f"{parts[-1]}.{number}" for number in count(2))
        out.append(next(name for name in chain(choices, numbered) if name not in out))
    return out
