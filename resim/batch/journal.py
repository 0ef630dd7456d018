"""Results as they come: a line a run, written whole or, when everything is killed, not at all."""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any

from resim.core.errors import InputError


class Journal:
    """A file of lines of JSON that one process appends to; a line that was cut short is taken away."""

    def __init__(self, path: Path) -> None:
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # gone with the process, however it ends
        except BlockingIOError as e:
            os.close(self._file)
            problem = "is written by another `resim sweep` at this moment"
            raise InputError(path, problem, "Wait for that one, or end it.") from e
        except OSError:
            pass  # a file system without locks
        os.ftruncate(self._file, _whole(path))
        os.lseek(self._file, 0, os.SEEK_END)

    def append(self, entry: dict[str, Any]) -> None:
        """Write one line. Raises InputError where the disk takes no more."""
        line = memoryview(json.dumps(entry, allow_nan=False).encode() + b"\n")
        try:
            while line:
                line = line[os.write(self._file, line) :]
        except OSError as e:
            problem = f"cannot be written ({e.strerror})"
            raise InputError(
                self.path, problem, "Make room, and go on with --resume: nothing is lost."
            ) from e

    def __enter__(self) -> Journal:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, e: BaseException | None, at: TracebackType | None
    ) -> None:
        os.fsync(self._file)
        os.close(self._file)


def read(folder: Path) -> Iterator[dict[str, Any]]:
    """Give the entries of all journals in a folder. Raises InputError for a damaged one."""
    for _, entry in entries(folder):
        yield entry


def entries(folder: Path) -> Iterator[tuple[bytes, dict[str, Any]]]:
    """Give all whole lines of all journals in a folder, and what they say. Raises InputError for a damaged one."""
    for path in sorted(folder.glob("*.jsonl")):
        with path.open("rb") as file:
            for number, line in enumerate(file, 1):
                if not line.endswith(b"\n"):
                    continue
                try:
                    entry = json.loads(line)
                    entry["run"], entry["row"]["end"], entry["time"]
                except (ValueError, KeyError, TypeError) as e:
                    problem = f"line {number} is damaged"
                    raise InputError(path, problem, "Take the line away: its run is then done again.") from e
                yield line, entry


def _whole(path: Path) -> int:
    """The length [bytes] of the whole lines."""
    return path.read_bytes().rfind(b"\n") + 1
