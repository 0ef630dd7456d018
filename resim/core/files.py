"""Reads files of strangers whole: folders, devices and what is too large are refused first. Names the cache."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import stat
import tempfile
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from io import BufferedReader
from pathlib import Path
from typing import Any

from resim.core.errors import InputError

LARGEST_TEXT = 100_000_000
DEEPEST = 30
"""Levels of tables and lists in a file that a person writes."""


def cache_folder(name: str) -> Path:
    """Give the folder of this name in which resim keeps what can be made again: in XDG_CACHE_HOME or ~/.cache."""
    home = os.environ.get("XDG_CACHE_HOME")
    return (Path(home) if home else Path.home() / ".cache") / "resim" / name


def shipped() -> Path:
    """Give the folder of what ships with resim, by its place in the project: in the wheel, or the project itself."""
    package = Path(__file__).parents[1]
    inside = package / "shipped"
    return inside if inside.is_dir() else package.parent


def file_hash(path: Path, remedy: str = "Give a file that can be read.") -> str:
    """Give the SHA-256 of a file of any size; `remedy` is for its errors. Raises InputError for what is no file."""
    with open_file(path, remedy) as file:
        try:
            return hashlib.file_digest(file, "sha256").hexdigest()
        except OSError as e:
            raise InputError(path, f"cannot be read ({e.strerror})", remedy) from e


def open_file(path: Path, remedy: str) -> BufferedReader:
    """Open a file of any size to read its bytes; `remedy` is for its errors. Raises InputError for what is no file."""
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise InputError(path, "cannot be read (it is not a file)", remedy)
        return path.open("rb")
    except OSError as e:
        raise InputError(path, f"cannot be read ({e.strerror})", remedy) from e


def check_hashes(folder: Path, hashes: Mapping[str, str], remedy: str) -> None:
    """Raise InputError for the first file of a folder that has not the SHA-256 that it was written with."""
    for name, digest in hashes.items():
        if (found := file_hash(folder / name, remedy)) != digest:
            problem = f"was changed after it was written: its SHA-256 is {found[:12]}…, expected {str(digest)[:12]}…"
            raise InputError(folder / name, problem, remedy)


def refuse_undecodable(name: str | Path) -> None:
    """Raise InputError for a name of a file or folder whose bytes are no UTF-8: no result could state it."""
    try:
        str(name).encode("utf-8")
    except UnicodeEncodeError as e:
        raise InputError(name, "this name is not UTF-8, in which results are written", "Rename it.") from e


def read_file(path: Path, remedy: str, *, largest: int = LARGEST_TEXT, too_large: str = "") -> bytes:
    """Give the bytes of the file; `remedy` is for its errors, `too_large` for that of over `largest` bytes.

    Raises InputError where it is missing, no regular file (a folder, device or pipe may never end), or too large.
    """
    try:
        found = path.stat()
        if not stat.S_ISREG(found.st_mode) and not stat.S_ISDIR(found.st_mode):
            raise InputError(path, "cannot be read (it is a device or pipe, no file)", remedy)
        if found.st_size > largest:
            sizes = f"has {found.st_size / 1e6:.1f} MB; files of up to {largest / 1e6:.0f} MB are read"
            raise InputError(path, sizes, too_large or remedy)
        return path.read_bytes()
    except OSError as e:
        raise InputError(path, f"cannot be read ({e.strerror})", remedy) from e
    except ValueError as e:  # a name with a zero byte
        raise InputError(path, f"cannot be read ({e})", remedy) from e


@contextlib.contextmanager
def plain_names(paths: Sequence[Path]) -> Iterator[list[str]]:
    """Give other names of the same files, as long as the context lasts: DuckDB reads what names say.

    To it `a[1]`, `a*` and `a?` are patterns, under which it reads other folders, and `width=2` is a column.
    """
    with tempfile.TemporaryDirectory(prefix="resim-") as folder:
        links = [Path(folder) / f"{n}{path.suffix}" for n, path in enumerate(paths)]
        for link, path in zip(links, paths, strict=True):
            link.symlink_to(path.absolute())
        yield [str(link) for link in links]


def parse_toml(raw: bytes, path: Path, remedy: str = "") -> dict[str, Any]:
    """Give what the TOML text says; `path` and `remedy` are for its errors. Raises InputError for no TOML."""
    found: dict[str, Any] = _parsed("TOML", tomllib.loads, raw, path, remedy)
    return found


def parse_json(raw: bytes, path: Path, remedy: str = "") -> Any:
    """Give what the JSON text says; `path` and `remedy` are for its errors. Raises InputError for no JSON."""
    return _parsed("JSON", partial(json.loads, object_pairs_hook=_once), raw, path, remedy)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object of JSON; which of two values of one name counts is nobody's guess."""
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"{next(n for n in names if names.count(n) > 1)!r} is a duplicate in one object")
    return found


def _parsed(form: str, loads: Callable[[str], Any], raw: bytes, path: Path, remedy: str) -> Any:
    too_deep = InputError(path, f"is not {form} of resim (nested deeper than {DEEPEST} levels)", remedy)
    try:
        found = loads(raw.decode("utf-8-sig"))
    except RecursionError:
        raise too_deep from None
    except ValueError as e:  # of the syntax, of the encoding, of an integer with thousands of digits
        raise InputError(path, f"is not {form} ({e})", remedy) from None
    level = [found]
    for _ in range(DEEPEST):  # what parses can still be too deep for whoever copies or prints it
        inside = [list(v.values()) if isinstance(v, dict) else v for v in level if isinstance(v, dict | list)]
        level = [v for values in inside for v in values]
    if level:
        raise too_deep
    return found


def joined(path: Path, name: str) -> Path:
    """Give the path of what the file at `path` names."""
    return Path(os.path.normpath(path.parent / name))


def relative(path: Path, folder: Path) -> str:
    """Give a path as seen from a folder, the same on every machine."""
    return Path(os.path.relpath(path.absolute(), folder.absolute())).as_posix()
