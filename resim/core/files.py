"""Reads files of strangers whole: folders, devices and what is too large are refused first. Names the cache."""

from __future__ import annotations

import os
import stat
import tomllib
from pathlib import Path
from typing import Any

from resim.core.errors import InputError

LARGEST_TEXT = 100_000_000


def cache_folder(name: str) -> Path:
    """Give the folder of this name in which resim keeps what can be made again: in XDG_CACHE_HOME or ~/.cache."""
    home = os.environ.get("XDG_CACHE_HOME")
    return (Path(home) if home else Path.home() / ".cache") / "resim" / name


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


def parse_toml(raw: bytes, path: Path, remedy: str = "") -> dict[str, Any]:
    """Give what the TOML text says; `path` and `remedy` are for its errors. Raises InputError for no TOML."""
    try:
        return tomllib.loads(raw.decode("utf-8"))
    except RecursionError:
        raise InputError(path, "is not TOML (it is nested too deeply)", remedy) from None
    except ValueError as e:  # of the syntax, of the encoding, of an integer with thousands of digits
        raise InputError(path, f"is not TOML ({e})", remedy) from None
