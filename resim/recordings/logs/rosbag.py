"""Bags of ROS 2: a folder, or one of its files (SQLite .db3, or MCAP).

Source: rosbag2's storage plug-ins sqlite3 (schema versions 1 to 4) and mcap; metadata.yaml says which files there are.
"""

from __future__ import annotations

import contextlib
import re
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

from resim.core.errors import InputError
from resim.core.files import open_file, read_file
from resim.recordings.logs.kinds import log_kind
from resim.recordings.logs.limits import LARGEST_MESSAGE
from resim.recordings.logs.mcap_file import mcap_messages
from resim.recordings.logs.raw import LogChannel, RawMessage, need

METADATA = "metadata.yaml"
_LISTED = re.compile(r"^ *relative_file_paths:\s*\n((?: *- .*\n?)+)", re.MULTILINE)
_DISTRIBUTION = re.compile(r"^ *ros_distro:\s*(\w+)\s*$", re.MULTILINE)
_ZSTD = b"\x28\xb5\x2f\xfd"
_STEPS = 1_000_000
"""Steps of SQLite between two looks at how many there were."""
_WRITE = "Write it again, or rebuild it by `ros2 bag reindex FOLDER`."


def folder_messages(folder: Path, topic: str | None) -> Iterator[RawMessage]:
    """Give the messages of a topic in a bag; None: of all topics, without bodies. Raises InputError."""
    distribution = _distribution(folder)
    for path in _files(folder):
        kind = log_kind(path)
        if kind == "mcap":
            yield from mcap_messages(path, topic)
        elif kind == "db3":
            yield from db3_messages(path, topic, distribution)
        else:
            raise InputError(path, "is no file of a bag (neither SQLite nor MCAP)", "Record the bag again.")


def _files(folder: Path) -> list[Path]:
    """The files of a bag in their order, all that its metadata name."""
    told = folder / METADATA
    if told.is_file():
        listed = _LISTED.search(read_file(told, _WRITE).decode("utf-8", "replace"))
        names = [line.strip()[2:].strip().strip("'\"") for line in (listed[1] if listed else "").splitlines()]
        found = [_decompressed_file(folder / Path(name).name) for name in names if name]
        lost = [path.name for path in found if not path.is_file()]
        if lost:
            problem = f"has no file {lost[0]}, which {METADATA} names"
            raise InputError(folder, problem, "Copy the whole bag: a part of the drive would be missing.")
        if found:
            return found
    found = [p for p in folder.iterdir() if p.suffix in (".db3", ".mcap")]
    if not found:
        zipped = next((p.name for p in folder.iterdir() if p.name.endswith(".zstd")), None)
        if zipped:
            raise InputError(
                folder / zipped, "is a compressed part of a bag", f"Decompress it: zstd -d {zipped}"
            )
        there = ", ".join(sorted(p.name for p in folder.iterdir())[:20]) or "nothing"
        problem = f"is a folder without the files of a bag (.db3 or .mcap); it has {there}"
        raise InputError(folder, problem, "Give a rosbag2 folder, or a file.")
    return sorted(found, key=lambda p: [int(n) if n.isdigit() else 0 for n in re.split(r"(\d+)", p.stem)])


def _decompressed_file(path: Path) -> Path:
    """A file that the metadata name, or what somebody has decompressed of it."""
    beside = path.with_suffix("")
    return beside if path.suffix == ".zstd" and beside.is_file() else path


def _distribution(folder: Path) -> str:
    told = folder / METADATA
    if not told.is_file():
        return ""
    found = _DISTRIBUTION.search(read_file(told, _WRITE).decode("utf-8", "replace"))
    return found[1] if found else ""


def db3_messages(path: Path, topic: str | None, distribution: str = "") -> Iterator[RawMessage]:
    """Give the messages of a topic in an SQLite file, by time; None: of all topics, without bodies.

    distribution: of ROS, where the bag's metadata say it. Raises InputError.
    """
    open_file(path, "Check the path").close()
    journal = path.with_name(path.name + "-wal")
    if journal.is_file() and journal.stat().st_size:
        problem = f"was not closed: {journal.name} holds messages that are not in it yet"
        raise InputError(path, problem, f'Merge them: sqlite3 {path.name} "PRAGMA wal_checkpoint(TRUNCATE)"')
    try:
        address = f"file:{quote(str(path.absolute()))}?mode=ro&immutable=1"
        with contextlib.closing(sqlite3.connect(address, uri=True)) as db:
            _fence(db, path)
            yield from _rows(db, path, topic, distribution)
    except (sqlite3.Error, sqlite3.Warning, UnicodeError, OverflowError) as e:
        raise InputError(path, f"is damaged or incomplete ({' '.join(str(e).split())[:200]})", _WRITE) from e


def _fence(db: sqlite3.Connection, path: Path) -> None:
    """Let no file take more time or memory than its size explains. Raises InputError where tables are none."""
    db.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST_MESSAGE * 16)
    db.execute("PRAGMA trusted_schema = OFF")
    db.execute("PRAGMA cell_size_check = ON")
    most = 20 * path.stat().st_size // _STEPS + 100
    steps = iter(range(most))
    db.set_progress_handler(lambda: next(steps, None) is None, _STEPS)
    kinds = dict(db.execute("SELECT name, type FROM sqlite_schema WHERE sql NOT LIKE 'CREATE VIRTUAL%'"))
    if any(kinds.get(name) != "table" for name in ("topics", "messages")):
        there = ", ".join(map(str, kinds)) or "none"
        raise InputError(
            path, f"is an SQLite file, and no bag: its tables are {there[:200]}", "Give a rosbag2."
        )


def _rows(db: sqlite3.Connection, path: Path, topic: str | None, distribution: str) -> Iterator[RawMessage]:
    defined = {}
    if db.execute(
        "SELECT 1 FROM sqlite_schema WHERE type = 'table' AND name = 'message_definitions'"
    ).fetchone():
        defined = {
            _text(name): (_text(encoding), _bytes(text))
            for name, encoding, text in db.execute(
                "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
            )
        }
    channels = {}
    for number, name, kind, encoding in db.execute("SELECT id, name, type, serialization_format FROM topics"):
        written, schema = defined.get(_text(kind), ("", b""))
        channels[number] = LogChannel(
            _text(name), _text(kind), _text(encoding), written, schema, distribution
        )
    if topic is None:
        for (number,) in db.execute("SELECT DISTINCT topic_id FROM messages"):
            if number in channels:
                yield RawMessage(channels[number], 0, b"", "")
        return
    for number, channel in channels.items():
        if channel.topic != topic:
            continue
        query = "SELECT timestamp, data FROM messages WHERE topic_id = ? ORDER BY timestamp"
        for n, (time, data) in enumerate(db.execute(query, (number,))):
            where = f"message {n + 1} of {topic}"
            if type(time) is not int or not isinstance(data, bytes):
                raise InputError(path, f"{where} has the time {str(time)[:40]!r} and no bytes", _WRITE)
            yield RawMessage(channel, time, _decompressed(path, data, where), f"{where} at {time} ns")


def _decompressed(path: Path, data: bytes, where: str) -> bytes:
    """The message, where it was compressed by itself."""
    if data.startswith(_ZSTD):
        need(path, "zstandard", "bags with compressed messages")
        import zstandard

        try:
            with zstandard.ZstdDecompressor(max_window_size=1 << 27).stream_reader(data) as reader:
                data = bytes(reader.read(LARGEST_MESSAGE + 1))
        except zstandard.ZstdError as e:
            raise InputError(path, f"{where} is damaged ({e})", _WRITE) from e
    if len(data) > LARGEST_MESSAGE:
        problem = f"{where} has more than {LARGEST_MESSAGE} bytes"
        raise InputError(path, problem, "Name a topic of objects, or of the EGO.")
    return data


def _text(value: object) -> str:
    return value if isinstance(value, str) else str(value)[:200]


def _bytes(value: object) -> bytes:
    return value if isinstance(value, bytes) else str(value).encode("utf-8", "replace")
