"""Registered folders: the recordings, builds, suites and other files in them, each known to pages by an id alone."""

from __future__ import annotations

import hashlib
import os
import threading
import time
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from resim.core.errors import InputError, ResimError
from resim.recordings.content import content_hash
from resim.recordings.settings import SETTINGS, read_settings

KINDS = ("recording", "build", "suite", "sweep", "criteria", "model", "kernels", "map")
MOST_FILES = 500_000
"""Files and folders that are looked at; what comes after is told of, and left out."""
DEEPEST = 12
SHOWN = 2.0
"""s after which hashes are shown, while others are still read."""
LARGEST = 1_000_000
"""Bytes of the largest file that a person writes."""
_TABLES = ("gt", "sd", "plan")


@dataclass(frozen=True)
class RegisteredFile:
    """A file or folder that jobs may be given.

    id: of its path and kind, 16 hex digits. name: as its folder or itself is called. place: folder, as seen from the
    registered one. tables: of a recording those that it has. hash: of a recording's content, "" until it is known.
    fault: why that cannot be told.
    """

    id: str
    kind: str
    name: str
    place: str
    path: Path
    tables: tuple[str, ...] = ()
    hash: str = ""
    fault: str = ""


@dataclass
class _Index:
    files: dict[str, RegisteredFile] = field(default_factory=dict)
    left_out: int = 0
    version: int = 0


class RegisteredFolders:
    """What lies in the registered folders. `scan` looks again; all else is fast, and may be called from any thread."""

    def __init__(self, folders: Sequence[Path]) -> None:
        """Raises InputError for one that is no folder."""
        for folder in folders:
            if not folder.is_dir():
                raise InputError(folder, "is no folder", "Register folders with recordings, builds, suites.")
        self.folders = tuple(dict.fromkeys(Path(os.path.realpath(folder)) for folder in folders))
        self._index = _Index()
        self._kinds: dict[Path, tuple[tuple[int, int], str]] = {}
        self._hashes: dict[Path, _KnownHash] = {}
        self.scanned = False
        """Whether they were looked at once."""
        self._scanning = threading.Lock()

    def all(self, *kinds: str) -> list[RegisteredFile]:
        """Give what there is of some kinds, by name."""
        found = (f for f in self._index.files.values() if f.kind in kinds)
        return sorted(found, key=lambda f: (f.name, f.place))

    def get(self, name: str, kinds: Sequence[str]) -> RegisteredFile:
        """Give what has this id. Raises InputError where nothing of these kinds has."""
        found = self._index.files.get(name)
        if found is None or found.kind not in kinds:
            raise InputError(f"{name:.20}", f"is no {' or '.join(kinds)} in a registered folder")
        return found

    @property
    def left_out(self) -> int:
        """How many files were not looked at, as there are too many."""
        return self._index.left_out

    @property
    def version(self) -> int:
        """Another number after every change."""
        return self._index.version

    def scan(self) -> None:
        """Look what there is now. One thread does so at a time."""
        with self._scanning:
            files, seen = {}, 0
            for folder in self.folders:
                for path, place in _walk(folder):
                    seen += 1
                    if seen <= MOST_FILES and (found := self._look(path, place)) is not None:
                        files[found.id] = found
            self._put(files, max(0, seen - MOST_FILES))
            self.scanned = True

    def hash_recordings(self) -> None:
        """Find the hashes of recordings out that are not known yet: their files are read."""
        told = time.monotonic()
        for found in self.all("recording"):
            known = self._hashes.get(found.path)
            if known is None or not known.holds(found.path):
                self._hashes[found.path] = _hashed(found.path)
            if time.monotonic() > told + SHOWN:
                self._show_hashes()
                told = time.monotonic()
        self._show_hashes()

    def _show_hashes(self) -> None:
        files = {name: self._with_hash(f) for name, f in self._index.files.items()}
        self._put(files, self._index.left_out)

    def _put(self, files: dict[str, RegisteredFile], left_out: int) -> None:
        old = self._index
        if files != old.files or left_out != old.left_out:
            self._index = _Index(files, left_out, old.version + 1)

    def _look(self, path: Path, place: str) -> RegisteredFile | None:
        """What a file is, if it is of use; a recording is found by its recording.toml."""
        try:
            stat = path.stat()
        except OSError:
            return None
        stamp = (stat.st_mtime_ns, stat.st_size)
        if (known := self._kinds.get(path)) is None or known[0] != stamp:
            known = self._kinds[path] = (stamp, _kind(path, stat.st_size))
        kind = known[1]
        if not kind:
            return None
        what = path.parent if kind == "recording" else path
        where = str(Path(place).parent) if kind == "recording" else place
        name = hashlib.sha256(os.fsencode(f"{kind}\n{what}")).hexdigest()[:16]
        shown = what.name if kind in ("recording", "map") else what.stem
        tables = _tables(what) if kind == "recording" else ()
        return self._with_hash(RegisteredFile(name, kind, shown, where, what, tables))

    def _with_hash(self, found: RegisteredFile) -> RegisteredFile:
        """A recording with its hash, if that is known of what its files hold now."""
        known = self._hashes.get(found.path) if found.kind == "recording" else None
        if known is None or not known.holds(found.path):
            return replace(found, hash="", fault="")
        return replace(found, hash=known.digest, fault=known.fault)


@dataclass(frozen=True)
class _KnownHash:
    """What was read of a recording: as of which state of its files and of its map, its hash or why it has none."""

    stamp: object
    road: Path | None
    road_stamp: object
    digest: str
    fault: str

    def holds(self, folder: Path) -> bool:
        """Whether nothing was changed since."""
        return self.stamp == _stamp(folder) and self.road_stamp == _file_stamp(self.road)


def _hashed(folder: Path) -> _KnownHash:
    """Read a recording. What is changed meanwhile is read again later."""
    stamp, road, road_stamp = _stamp(folder), None, None
    try:
        road = folder / read_settings(folder / SETTINGS).map
        road_stamp = _file_stamp(road)
        return _KnownHash(stamp, road, road_stamp, content_hash(folder), "")
    except (ResimError, OSError) as e:
        return _KnownHash(stamp, road, road_stamp, "", str(e))


def is_utf8(path: Path) -> bool:
    """Say whether a path can be written down."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        return False
    return True


def _walk(folder: Path) -> Iterator[tuple[Path, str]]:
    """Files below a folder, without links and hidden ones, and the folder of each as seen from it."""
    for where, folders, names in os.walk(folder):
        here = Path(where)
        inside = here.relative_to(folder)
        names.sort()
        if "recording.toml" in names:  # what else lies there belongs to it
            names, folders[:] = ["recording.toml"], []
        folders[:] = sorted(n for n in folders if not n.startswith(".") and len(inside.parts) < DEEPEST)
        place = str(Path(folder.name) / inside)
        for name in names:
            path = here / name
            if not is_utf8(path):  # resim writes no such name down
                continue
            if (
                path.suffix in (".toml", ".json", ".xodr")
                and not name.startswith(".")
                and not path.is_symlink()
            ):
                yield path, place


def _kind(path: Path, size: int) -> str:
    """Which kind of file it is, by what stands in it; "" for any other."""
    if path.name == "recording.toml":
        return "recording"
    if path.suffix == ".xodr":
        return "map"
    try:
        if path.suffix == ".json":
            with path.open("rb") as file:
                head = file.read(400)
            return next((k for k, mark in _JSON.items() if mark in head), "")
        told = tomllib.loads(path.read_text("utf-8")) if size <= LARGEST else {}
    except (OSError, ValueError, RecursionError):
        return ""
    return _toml_kind(told)


_JSON = {"model": b'"resim-perception-', "kernels": b'"resim-kernels-'}


def _toml_kind(told: Mapping[str, Any]) -> str:
    if "version" in told and {"factory", "process", "grpc", "fmi", "recorded"} & told.keys():
        return "build"
    if "criterion" in told:
        return "criteria"
    if "criteria" in told and ("recording" in told or "suite" in told):
        return "sweep" if {"build", "parameter", "variation"} & told.keys() else "suite"
    return ""


def _tables(folder: Path) -> tuple[str, ...]:
    return tuple(t for t in _TABLES if any((folder / f"{t}.{s}").is_file() for s in ("csv", "parquet")))


def _file_stamp(path: Path | None) -> object:
    """What changes with a file; None where it is not there."""
    try:
        return None if path is None else ((stat := path.stat()).st_mtime_ns, stat.st_size)
    except OSError:
        return None


def _stamp(folder: Path) -> object:
    """What changes with the files of a recording, its map apart."""
    try:
        with os.scandir(folder) as held:
            return sorted((f.name, f.stat().st_mtime_ns, f.stat().st_size) for f in held if f.is_file())
    except OSError:
        return None
