"""Input files as they were when they were read: copies named by their hash, from which all processes of a command load.

A user may edit a file at any time. What runs is the copy, and its hash is what results state. A process locks the
copies that it uses as long as it lives; who writes a new one clears away what nobody has locked or used for long.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from resim.core.errors import InputError
from resim.core.files import cache_folder, file_hash, read_file

_ITSELF, _INDEX, _HOME = "input", "files.json", "home"
_OUTSIDE = "/"
"""Before the words that name programs which are run where they are."""
_UP = "_"
"""Stands for a folder above the file itself, where a name begins with "../"."""
_NEW = "new-"
"""How the names of folders begin in which copies are made, and cleared away."""
_OPENED = os.O_RDONLY | os.O_NONBLOCK
"""How files are opened to be locked: without waiting for the other end of what is a pipe."""
KEPT = 30 * 24 * 3600.0
"""Time [s] without use after which a copy is cleared away."""
_locked: dict[tuple[Path, int], int] = {}
"""Open files that hold the locks of this process, by copy and inode; closed by its end."""


@dataclass(frozen=True)
class FrozenFile:
    """A file and all that belongs to it, as it was read. path: as the user names it, for messages. hash: SHA-256."""

    path: Path
    hash: str


@dataclass(frozen=True, eq=False)
class FrozenCopy:
    """The frozen copy of a file, found to be whole.

    raw: its bytes. folder: where the files that belong to it lie, as they lay beside it. names: of these files, as seen
    from there; digests: SHA-256 of each. sources: the bytes of those that are Python. outside: SHA-256 of programs that
    are no part of the copy.
    """

    raw: bytes
    folder: Path
    sources: Mapping[str, bytes]
    digests: Mapping[str, str]
    outside: Mapping[str, str]

    @property
    def names(self) -> frozenset[str]:
        """The names of the files that belong to it."""
        return frozenset(self.digests)


def freeze(
    path: Path,
    raw: bytes,
    sources: Mapping[str, bytes] | None = None,
    data: Mapping[str, Path] | None = None,
    outside: Mapping[str, Path] | None = None,
) -> FrozenFile:
    """Keep a copy of the file at `path`, which holds `raw`, with the files that belong to it.

    sources: bytes by name, as seen from the file's folder; data: where others lie, by name; outside: programs that are
    run where they are, by the word that names them. The hash is of bytes and names, not of the place. Raises InputError
    where something cannot be read, or the cache not be written.
    """
    sources, data = sources or {}, data or {}
    digests = {name: hashlib.sha256(content).hexdigest() for name, content in sources.items()}
    digests |= {name: file_hash(file) for name, file in data.items()}
    digests |= {f"{_OUTSIDE}{word}": file_hash(file) for word, file in (outside or {}).items()}
    index = json.dumps(digests, sort_keys=True).encode() if digests else b""
    frozen = FrozenFile(path, _digest(raw, index))
    if _read(frozen.hash) is None:
        try:
            _write(frozen.hash, raw, index, sources, data)
        except OSError as e:
            problem = f"cannot be written ({e.strerror})"
            raise InputError(
                cache_folder("inputs"), problem, "Set XDG_CACHE_HOME to a writable folder."
            ) from e
        if _read(frozen.hash) is None:
            raise InputError(
                path, "was changed while it was read, or a file that belongs to it", "Try again."
            )
    return frozen


def freeze_file(path: Path, remedy: str = "") -> FrozenFile:
    """Freeze a file that nothing else belongs to. Raises InputError."""
    return freeze(path, read_file(path, remedy))


def load_frozen(frozen: FrozenFile, again: Callable[[Path], FrozenFile] = freeze_file) -> FrozenCopy:
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


def files_of(*frozen: FrozenFile | None) -> list[Path]:
    """Give where the files lie that were frozen, each with all that belongs to it."""
    found = []
    for one in frozen:
        if one is not None:
            copy = _read(one.hash)
            found += [one.path, *(one.path.parent / name for name in sorted(copy.names if copy else ()))]
    return found


def find_copy(beginning: str) -> FrozenCopy | None:
    """Give the copy whose hash begins so; None where there is none."""
    found = next(cache_folder("inputs").glob(f"{beginning}*"), None)
    return None if found is None else _read(found.name)


def _digest(raw: bytes, index: bytes) -> str:
    return hashlib.sha256(raw + b"\0" + index if index else raw).hexdigest()


def _read(digest: str) -> FrozenCopy | None:
    """The copy of this hash; None where there is none, or a file of it is damaged."""
    root = cache_folder("inputs") / digest
    _lock(root)
    try:
        raw, index = read_file(root / _ITSELF, ""), read_file(root / _INDEX, "")
        if _digest(raw, index) != digest:
            return None
        listed: dict[str, str] = json.loads(index) if index else {}
        outside = {name.removeprefix(_OUTSIDE): h for name, h in listed.items() if name.startswith(_OUTSIDE)}
        digests = {name: h for name, h in listed.items() if not name.startswith(_OUTSIDE)}
        home = root / _HOME / _within(digests)
        sources = {name: read_file(home / name, "") for name in digests if name.endswith(".py")}
        held = {name: hashlib.sha256(content).hexdigest() for name, content in sources.items()}
        held |= {name: file_hash(home / name) for name in digests if name not in sources}
    except InputError:
        return None
    return FrozenCopy(raw, home, sources, digests, outside) if held == digests else None


def _write(
    digest: str, raw: bytes, index: bytes, sources: Mapping[str, bytes], data: Mapping[str, Path]
) -> None:
    """Write the copy beside its place, and move it there whole; another process may do the same."""
    store = cache_folder("inputs")
    store.mkdir(parents=True, exist_ok=True)
    _clear(store)
    with tempfile.TemporaryDirectory(prefix=_NEW, dir=store) as made:
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
            # programs as well; who writes into his own files changes what the next one reads
            place.chmod(0o555)
        try:
            new.rename(store / digest)
        except OSError:
            if _read(digest) is not None:
                return
            (store / digest).rename(Path(made) / "damaged")
            new.rename(store / digest)


def _lock(root: Path) -> None:
    """Keep a copy, if it is there, from being cleared away as long as this process lives, and note that it is used.

    Where the file system has no locks, copies are not cleared away either.
    """
    file = root / _ITSELF
    with suppress(OSError):
        while (root, file.stat().st_ino) not in _locked:
            held = os.open(file, _OPENED)
            fcntl.flock(held, fcntl.LOCK_SH)
            _locked[root, os.fstat(held).st_ino] = held  # it may be cleared away by now: then it is not there
        os.utime(file)


def _clear(store: Path) -> None:
    """Clear away the copies that nobody has used for long and no process has locked, and what was left half made."""
    for root in store.iterdir():
        with suppress(OSError):
            if root.name.startswith(_NEW):
                if _is_old(root):
                    shutil.rmtree(root)
            elif _is_old(root / _ITSELF):
                _clear_copy(root)


def _clear_copy(root: Path) -> None:
    """Clear a copy away unless it is in use. Raises OSError where it is."""
    file = os.open(root / _ITSELF, _OPENED)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if _is_old(root / _ITSELF):  # still, now that nobody else can lock it
            with tempfile.TemporaryDirectory(prefix=_NEW, dir=root.parent) as away:
                root.rename(Path(away) / root.name)
    finally:
        os.close(file)


def _is_old(path: Path) -> bool:
    return time.time() - path.stat().st_mtime > KEPT


def _within(names: Mapping[str, str] | list[str]) -> PurePosixPath:
    """The folder of the file itself in the copy: as deep as names lead up from it."""
    up = max((PurePosixPath(name).parts.count("..") for name in names), default=0)
    return PurePosixPath(*[_UP] * up)
