"""What a recording is known by: the hash of its settings, tables and map."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from pathlib import Path

from resim.core.errors import InputError
from resim.core.files import file_hash
from resim.recordings.settings import SETTINGS, read_settings

_FILES = re.compile(r"(recording\.toml|(gt|sd|plan)\.(csv|parquet))")


def content_hash(folder: Path) -> str:
    """Give the SHA-256 of a recording: of its settings, tables and map. Raises InputError."""
    settings = read_settings(folder / SETTINGS)
    files = {p.name: file_hash(p) for p in folder.iterdir() if _FILES.fullmatch(p.name)}
    road = file_hash(folder / settings.map, "The recording names a map that is not there.")
    return hash_of_hashes(files, road)


def tracks_hash(folder: Path) -> str:
    """Give the SHA-256 of a recording's GT, EGO and map, which copies under other names share. Raises InputError."""
    settings = read_settings(folder / SETTINGS)
    files = {p.name: file_hash(p) for p in folder.iterdir() if p.name in ("gt.csv", "gt.parquet")}
    told = hash_of_hashes(files, file_hash(folder / settings.map))
    return hashlib.sha256(f"{told} {settings.ego}".encode()).hexdigest()


def refuse_changed(folder: Path, digest: str | None) -> None:
    """Raise InputError where a recording's content has not this hash, or had none (None) when the command began."""
    found = content_hash(folder)
    if digest is None:
        raise InputError(folder, "could not be read at the start", "Begin anew.")
    if found != digest:
        problem = f"its content has the hash {found[:12]}…, expected was {digest[:12]}…"
        raise InputError(folder, problem, "Restore the recording, or start again with the changed one.")


def hash_of_hashes(files: Mapping[str, str], road: str) -> str:
    """Give the SHA-256 of a recording from those of its files by name (others are left out) and of its map."""
    told = hashlib.sha256()
    for name in sorted(name for name in files if _FILES.fullmatch(name)):
        told.update(f"{name} {files[name]}\n".encode())
    told.update(f"map {road}\n".encode())
    return told.hexdigest()
