"""Results as they come: a line a run, written whole or, when everything is killed, not at all.

A line is the CRC-32 of the rest as eight hexadecimal digits, a space, and JSON: what was altered is told.
"""

from __future__ import annotations

import fcntl
import json
import os
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from types import TracebackType

from resim.core.errors import InputError
from resim.core.files import open_file
from resim.core.schema import Row

REMEDY = "Remove the line: its run is then repeated."
TypeOf = Callable[[str], str]
"""From a column of the rows to what it holds: "text", "flag" or "number"."""
_LARGEST = 1e300
_FEWEST = 2
"""Columns of a run without a result: its end, and why; all others have the same ones."""


@dataclass(frozen=True, slots=True)
class JournalEntry:
    """What a line says: which run it is, what it is of (`plan`), what it came to, and how long it took [s].

    time: None for a run without a result.
    """

    run: int
    plan: str
    row: Row
    time: float | None


_FIELDS = ("run", "plan", "row", "time")
"""Those of an entry, as each line has them."""


class Journal:
    """A file of lines of JSON that one process appends to; a line that was cut short is taken away."""

    def __init__(self, path: Path) -> None:
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.exists() and not path.is_file():
            raise InputError(path, "is not a file, expected the journal of a sweep", "Remove it.")
        self._file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # gone with the process, however it ends
        except BlockingIOError as e:
            os.close(self._file)
            problem = "is being written by another `resim sweep`"
            raise InputError(path, problem, "Wait until it ends, or stop it.") from e
        except OSError:
            pass  # a file system without locks
        os.ftruncate(self._file, _whole(path))
        os.lseek(self._file, 0, os.SEEK_END)

    def append(self, entry: JournalEntry) -> None:
        """Write one line. Raises InputError where the disk takes no more."""
        said = json.dumps({name: getattr(entry, name) for name in _FIELDS}, allow_nan=False).encode()
        line = memoryview(checksum(said) + b" " + said + b"\n")
        try:
            while line:
                line = line[os.write(self._file, line) :]
        except OSError as e:
            problem = f"cannot be written ({e.strerror})"
            raise InputError(
                self.path, problem, "Free disk space, and resume with --resume: nothing is lost."
            ) from e

    def set_aside(self) -> Path:
        """Give the file another name, under which nobody reads it as a journal, and give that."""
        free = (self.path.with_name(f"{self.path.name}.refused{n or ''}") for n in count())
        aside = next(path for path in free if not path.exists())
        self.path.replace(aside)
        return aside

    def __enter__(self) -> Journal:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, e: BaseException | None, at: TracebackType | None
    ) -> None:
        os.fsync(self._file)
        os.close(self._file)


def read(folder: Path, type_of: TypeOf | None = None) -> Iterator[JournalEntry]:
    """Give the entries of all journals in a folder. Raises InputError for a damaged one.

    type_of: of the columns; None where what they hold does not matter.
    """
    for _, entry in entries(folder, type_of):
        yield entry


def entries(
    folder: Path,
    type_of: TypeOf | None = None,
    plans: Mapping[int, str] | None = None,
    *,
    whole: bool = True,
) -> Iterator[tuple[bytes, JournalEntry]]:
    """Give the JSON of every run in all journals in a folder, and what it says; a run that was done twice comes once.

    type_of: of the columns; None where what they hold does not matter. plans: what each run is of, by its number;
    whole: whether there are no others. Raises InputError for a line that is damaged, of another plan, or has another
    result than a line before.
    """
    known: dict[int, int] = {}
    columns: frozenset[str] | None = None
    for path in sorted(folder.glob("*.jsonl")):
        with open_file(path, "Remove it.") as file:
            for number, line in enumerate(file, 1):
                if not line.endswith(b"\n"):
                    continue
                said = line[9:-1]
                entry = _entry(said, type_of) if line[:9] == checksum(said) + b" " else None
                if entry is not None and len(entry.row) > _FEWEST:
                    columns = columns or frozenset(entry.row)
                if entry is None or (len(entry.row) > _FEWEST and columns != frozenset(entry.row)):
                    raise InputError(path, f"line {number} is damaged", REMEDY)
                run = entry.run
                if plans is not None and entry.plan != plans.get(run, "" if whole else entry.plan):
                    raise InputError(path, f"line {number}: run {run} is not in this sweep", REMEDY)
                held = zlib.crc32(json.dumps(entry.row, sort_keys=True).encode())
                if run in known and known[run] != held:
                    problem = f"line {number}: run {run} contradicts an earlier line"
                    raise InputError(path, problem, "Remove both lines: the run is then repeated.")
                if run not in known:
                    known[run] = held
                    yield said, entry


def checksum(said: bytes) -> bytes:
    """Give the CRC-32 of a line, or of what else is kept, as eight hexadecimal digits."""
    return b"%08x" % zlib.crc32(said)


def _entry(said: bytes, type_of: TypeOf | None) -> JournalEntry | None:
    """An entry, None for what is none; by hand, as a million of them are read."""
    try:
        entry = parse(said)
    except (ValueError, TypeError, RecursionError):
        return None
    row = entry.row
    known = type(entry.run) is int and isinstance(entry.plan, str) and _fits("number", entry.time)
    known = (
        known
        and isinstance(row, dict)
        and isinstance(row.get("end"), str)
        and all(_fits(type_of(name), value) for name, value in row.items() if type_of is not None)
    )
    return entry if known else None


def parse(said: bytes) -> JournalEntry:
    """Give what the JSON of a line says, which `entries` has checked. Raises TypeError for other fields."""
    return JournalEntry(**json.loads(said))


def _fits(kind: str, value: object) -> bool:
    """Whether a value is of this type; none is of every type."""
    if value is None:
        return True
    if kind == "flag":
        return isinstance(value, bool)
    if kind == "text":
        return isinstance(value, str)
    return type(value) in (int, float) and -_LARGEST < value < _LARGEST  # type: ignore[operator]


def _whole(path: Path) -> int:
    """The length [bytes] of the whole lines."""
    return path.read_bytes().rfind(b"\n") + 1
