"""Processes that outlive who started them, told from later ones of the same number by when they began."""

from __future__ import annotations

import json
import os
import stat
from io import BufferedReader
from pathlib import Path
from typing import Any

import psutil

LARGEST = 100_000
"""Bytes of a file that tells of a process."""
CLOSE = 0.05
"""s by which two readings of the start of one process may differ."""


def process_name(number: int | None = None) -> str:
    """Give a name of a process that no other one of this machine has: its number and when it began."""
    number = os.getpid() if number is None else number
    return f"{number}@{psutil.Process(number).create_time():.3f}"


def is_alive(name: str) -> bool:
    """Say whether the process of this name still runs; what has ended and waits to be noticed does not."""
    number, _, began = name.partition("@")
    try:
        process = psutil.Process(int(number))
        same = abs(process.create_time() - float(began)) < CLOSE
        return bool(same and process.status() != psutil.STATUS_ZOMBIE)
    except (psutil.Error, ValueError):
        return False


def number_of(name: str) -> int:
    """Give the number of a process."""
    return int(name.partition("@")[0])


def write_whole(path: Path, told: dict[str, Any]) -> None:
    """Write a JSON file whole or not at all."""
    beside = path.with_name(f".{path.name}.{os.getpid()}.new")
    with beside.open("w", encoding="utf-8") as file:
        json.dump(told, file)
        file.flush()
        os.fsync(file.fileno())
    beside.replace(path)


def opened(path: Path) -> BufferedReader:
    """Open a file in a folder in which commands write; never waits. Raises OSError for a pipe, a device or a folder."""
    number = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    if not stat.S_ISREG(os.fstat(number).st_mode):
        os.close(number)
        raise OSError(f"{path} is no file")
    return os.fdopen(number, "rb")


def read_whole(path: Path) -> dict[str, Any]:
    """Read such a file; {} where it is not there, or is none."""
    try:
        with opened(path) as file:
            found = json.loads(file.read(LARGEST))
    except (OSError, ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}
