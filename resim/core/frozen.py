"""Input files as they were when they were read: copies named by their hash, from which all processes of a command load.

A user may edit a file at any time. What runs is the copy, and its hash is what results state.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from resim.core.errors import InputError
from resim.core.files import cache_folder, read_file

_ITSELF, _INDEX, _HOME = "input", "files.json", "home"
_UP = "_"
"""Stands for a folder above the file itself, where a name begins with "../"."""


@dataclass(frozen=True)
class Frozen:
    """A file and all that belongs to it, as it was read. path: as the user names it, for messages. hash: SHA-256."""

    path: Path
    hash: str


@dataclass(frozen=True, eq=False)
class Copy:
    """The frozen copy of a file, found to be whole.

    raw: its bytes. folder: where the files that belong to it lie, as they lay beside it. names: of these files, as seen
    from there. sources: the bytes of those that are Python.
    """

    raw: bytes
    folder: Path
    sources: Mapping[str, bytes]
    names: frozenset[str]


def freeze(
    path: Path, raw: bytes, sources: Mapping[str, bytes] | None = None, data: Mapping[str, Path] | None = None
) -> Frozen:
    """Keep a copy of the file at `path`, which holds `raw`, with the files that belong to it.

    sources: bytes by name, as seen from the file's folder; data: where others lie, by name. The hash is of bytes and
    names, not of the place. Raises InputError where something cannot be read, or the cache not be written.
    """
    sources, data = sources or {}, data or {}
    digests = {name: hashlib.sha256(content).hexdigest() for name, content in sources.items()}
    digests |= {name: _file_digest(file) for name, file in data.items()}
    index = json.dumps(digests, sort_keys=True).encode() if digests else b""
    frozen = Frozen(path, _digest(raw, index))
    if _read(frozen.hash) is None:
        try:
            _write(frozen.hash, raw, index, sources, data)
        except OSError as e:
            problem = f"cannot be written ({e.strerror})"
            raise InputError(
                cache_folder("inputs"), problem, "Set XDG_CACHE_HOME to a folder that can."
            ) from e
        if _read(frozen.hash) is None:
            raise InputError(
                path, "was changed while it was read, or a file that belongs to it", "Try again."
            )
    return frozen


def freeze_file(path: Path, remedy: str = "") -> Frozen:
    """Freeze a file that nothing else belongs to. Raises InputError."""
    return freeze(path, read_file(path, remedy))


def thaw(frozen: Frozen, again: Callable[[Path], Frozen] = freeze_file) -> Copy:
    """Give the copy, checked against its hash.

    again: freezes the file once more where its copy is gone or belongs to another machine. Raises InputError where the
    file has changed by then.
    """
    found = _read(frozen.hash)
    if found is None and again(frozen.path).hash == frozen.hash:
        found = _read(frozen.hash)
    if found is None:
        problem = "has changed since it was first read, and its copy is not on this machine"
        raise InputError(frozen.path, problem, "Begin anew.")
    return found


def _digest(raw: bytes, index: bytes) -> str:
    return hashlib.sha256(raw + b"\0" + index if index else raw).hexdigest()


def _file_digest(file: Path) -> str:
    try:
        with file.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as e:
        raise InputError(file, f"cannot be read ({e.strerror})") from e


def _read(digest: str) -> Copy | None:
    """The copy of this hash; None where there is none, or a file of it is damaged."""
    root = cache_folder("inputs") / digest
    try:
        raw, index = (root / _ITSELF).read_bytes(), (root / _INDEX).read_bytes()
        if _digest(raw, index) != digest:
            return None
        digests: dict[str, str] = json.loads(index) if index else {}
        home = root / _HOME / _within(digests)
        sources = {name: (home / name).read_bytes() for name in digests if name.endswith(".py")}
        held = {name: hashlib.sha256(content).hexdigest() for name, content in sources.items()}
        held |= {name: _file_digest(home / name) for name in digests if name not in sources}
    except (OSError, InputError):
        return None
    return Copy(raw, home, sources, frozenset(digests)) if held == digests else None


def _write(
    digest: str, raw: bytes, index: bytes, sources: Mapping[str, bytes], data: Mapping[str, Path]
) -> None:
    """Write the copy beside its place, and move it there whole; another process may do the same."""
    store = cache_folder("inputs")
    store.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="new-", dir=store) as made:
        new = Path(made) / digest
        home = new / _HOME / _within([*sources, *data])
        home.mkdir(parents=True)
        (new / _ITSELF).write_bytes(raw)
        (new / _INDEX).write_bytes(index)
        for name in (*sources, *data):
            place = Path(os.path.normpath(home / name))
            place.parent.mkdir(parents=True, exist_ok=True)
            if name in sources:
                place.write_bytes(sources[name])
            else:
                shutil.copyfile(data[name], place)
            place.chmod(0o444)  # a function that writes into its own files changes what the next one reads
        try:
            new.rename(store / digest)
        except OSError:
            if _read(digest) is not None:
                return
            (store / digest).rename(Path(made) / "damaged")
            new.rename(store / digest)


def _within(names: Mapping[str, str] | list[str]) -> PurePosixPath:
    """The folder of the file itself in the copy: as deep as names lead up from it."""
    up = max((PurePosixPath(name).parts.count("..") for name in names), default=0)
    return PurePosixPath(*[_UP] * up)
