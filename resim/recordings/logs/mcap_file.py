"""MCAP files: their messages one after the other, as far as sizes and checksums say that they are whole.

Source: https://mcap.dev/spec. Records are read in the order of the file; its index is not needed.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BufferedReader
from pathlib import Path

from resim.core.errors import InputError
from resim.core.files import open_file
from resim.recordings.logs.kinds import MCAP
from resim.recordings.logs.limits import (
    LARGEST_CHUNK,
    LARGEST_MESSAGE,
    LARGEST_SCHEMA,
    MOST_TIMES_SMALLER,
)
from resim.recordings.logs.raw import LogChannel, RawMessage, need

_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x02, 0x03, 0x04, 0x05, 0x06, 0x0F
_HEAD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQI")
_WRITE = "Write it again, or `mcap recover FILE` what is whole."


@dataclass
class _Known:
    """What is known so far: schemas (name, encoding, definition) and channels by their ids, and all chunks' bytes."""

    path: Path
    topic: str | None
    schemas: dict[int, tuple[str, str, bytes]] = field(default_factory=dict)
    channels: dict[int, LogChannel] = field(default_factory=dict)
    expanded: int = 0


def mcap_messages(path: Path, topic: str | None) -> Iterator[RawMessage]:
    """Give the messages of a topic in the order of the file; None: of all topics, without bodies.

    Raises InputError for what is damaged, cut off or too large.
    """
    known = _Known(path, topic)
    with open_file(path, "Check the path") as file:
        size = os.fstat(file.fileno()).st_size
        file.seek(len(MCAP))
        while True:
            at = file.tell()
            head = file.read(_HEAD.size)
            if len(head) < _HEAD.size:
                raise _cut_off(path, at)
            code, length = _HEAD.unpack(head)
            if code in (_DATA_END, _FOOTER):
                return
            if not code or length > size - file.tell():
                raise _cut_off(path, at)
            try:
                yield from _record(known, file, code, length, at)
            except (struct.error, UnicodeDecodeError) as e:
                raise InputError(path, f"the record at byte {at} is damaged ({e})", _WRITE) from e
            file.seek(at + _HEAD.size + length)


def _record(known: _Known, file: BufferedReader, code: int, length: int, at: int) -> Iterator[RawMessage]:
    """The messages in a record of the file; schemas and channels in it become known."""
    where = f"the record at byte {at}"
    if code == _CHUNK:
        if length > LARGEST_CHUNK:
            raise InputError(
                known.path, f"{where} has {length} bytes, expected up to {LARGEST_CHUNK}", _WRITE
            )
        data = _expanded(known, file.read(length), at)
        place = 0
        while place < len(data):
            code, size = _HEAD.unpack_from(data, place)
            place += _HEAD.size
            if not code or size > len(data) - place:
                problem = f"the chunk at byte {at}: its record at {place} claims {size} bytes of {len(data)}"
                raise InputError(known.path, problem, _WRITE)
            if code == _MESSAGE:
                yield from _message(known, data, place, size, at)
            elif code in (_SCHEMA, _CHANNEL):
                _define(known, code, data[place : place + size], where)
            place += size
    elif code == _MESSAGE:
        data = file.read(min(length, _MESSAGE_HEAD.size))
        if known.topic is not None and _is_wanted(known, data[:2]):
            if length > LARGEST_MESSAGE:
                raise _too_long(known, length, where)
            data += file.read(length - len(data))
        yield from _message(known, data, 0, length, at)
    elif code in (_SCHEMA, _CHANNEL):
        if length > LARGEST_SCHEMA:
            raise InputError(
                known.path, f"{where} has {length} bytes, expected up to {LARGEST_SCHEMA}", _WRITE
            )
        _define(known, code, file.read(length), where)


def _is_wanted(known: _Known, number: bytes) -> bool:
    channel = known.channels.get(int.from_bytes(number, "little"))
    return channel is None or channel.topic == known.topic


def _message(known: _Known, data: bytes, place: int, size: int, at: int) -> Iterator[RawMessage]:
    """The message at a place, where it is of the topic."""
    if size < _MESSAGE_HEAD.size:
        raise struct.error(f"a message has {size} bytes")
    number, sequence, log_time, _ = _MESSAGE_HEAD.unpack_from(data, place)
    channel = known.channels.get(number)
    if channel is None:
        problem = f"a message at byte {at} is of channel {number}, which no record before it describes"
        raise InputError(known.path, problem, _WRITE)
    if known.topic is None:
        yield RawMessage(channel, log_time, b"", "")
    elif channel.topic == known.topic:
        where = f"message {sequence} of {channel.topic} at {log_time} ns"
        if size > LARGEST_MESSAGE:
            raise _too_long(known, size, where)
        if log_time >= 1 << 63:
            raise InputError(known.path, f"{where}: that is no time", _WRITE)
        yield RawMessage(channel, log_time, data[place + _MESSAGE_HEAD.size : place + size], where)


def _define(known: _Known, code: int, data: bytes, where: str) -> None:
    """Take a schema or a channel."""
    number = int.from_bytes(data[:2], "little")
    name, place = _text(data, 2 if code == _SCHEMA else 4)
    encoding, place = _text(data, place)
    if code == _SCHEMA:
        size = int.from_bytes(data[place : place + 4], "little")
        definition = data[place + 4 : place + 4 + size]
        if len(definition) != size:
            problem = f"{where}: the schema {name!r} claims {size} bytes, {len(definition)} are there"
            raise InputError(known.path, problem, _WRITE)
        known.schemas[number] = (name, encoding, definition)
        return
    of = int.from_bytes(data[2:4], "little")
    if of and of not in known.schemas:
        problem = f"{where}: the channel {name!r} has schema {of}, which no record before it describes"
        raise InputError(known.path, problem, _WRITE)
    kind, written, definition = known.schemas.get(of, ("", "", b""))
    told = _entries(data, place)
    known.channels[number] = LogChannel(
        name, kind, encoding, written, definition, metadata=tuple(told.items())
    )


def _entries(data: bytes, place: int) -> dict[str, str]:
    """A map of texts with its length before it."""
    (size,) = struct.unpack_from("<I", data, place)
    place, end, found = place + 4, place + 4 + size, dict[str, str]()
    while place < end:
        key, place = _text(data, place)
        found[key], place = _text(data, place)
    return found


def _text(data: bytes, place: int) -> tuple[str, int]:
    """A text with its length before it, and where it ends."""
    (size,) = struct.unpack_from("<I", data, place)
    end = place + 4 + size
    if end > len(data):
        raise struct.error(f"a text claims {size} bytes of {len(data)}")
    return data[place + 4 : end].decode(), end


def _expanded(known: _Known, data: bytes, at: int) -> bytes:
    """The records of a chunk. Raises InputError where sizes or checksum say that they are not whole."""
    where = f"the chunk at byte {at}"
    _, _, size, checksum = _CHUNK_HEAD.unpack_from(data)
    compression, place = _text(data, _CHUNK_HEAD.size)
    (packed,) = struct.unpack_from("<Q", data, place)
    body = data[place + 8 :]
    if packed != len(body):
        problem = f"{where} claims {packed} bytes of records, {len(body)} are there"
        raise InputError(known.path, problem, _WRITE)
    if size > LARGEST_CHUNK:
        raise InputError(known.path, f"{where} claims {size} bytes, expected up to {LARGEST_CHUNK}", _WRITE)
    known.expanded += size
    if known.expanded > MOST_TIMES_SMALLER * (at + len(data)) + LARGEST_CHUNK:
        problem = f"{where} claims {size} bytes: what compression made so small is no measurement"
        raise InputError(known.path, problem, _WRITE)
    unpack = _UNPACK.get(compression)
    if unpack is None:
        problem = f"{where} is compressed by {compression[:40]!r}"
        raise InputError(known.path, problem, "Compress by zstd or lz4, or not at all.")
    if compression:
        need(
            known.path,
            {"zstd": "zstandard", "lz4": "lz4"}[compression],
            f"MCAP files compressed by {compression}",
        )
    try:
        found = unpack(body, size)
    except Exception as e:  # of damaged bytes, zstandard and lz4 raise what they like
        raise InputError(known.path, f"{where} is damaged ({type(e).__name__}: {e})", _WRITE) from e
    if len(found) != size or (checksum and zlib.crc32(found) != checksum):
        raise InputError(known.path, f"{where} is damaged: size or checksum of its records is wrong", _WRITE)
    return found


def _zstd(data: bytes, size: int) -> bytes:
    import zstandard

    with zstandard.ZstdDecompressor(max_window_size=LARGEST_CHUNK).stream_reader(data) as reader:
        return bytes(reader.read(size + 1))


def _lz4(data: bytes, size: int) -> bytes:
    from lz4.frame import LZ4FrameDecompressor

    found = LZ4FrameDecompressor().decompress(data, max_length=size + 1)
    return bytes(found)


_UNPACK: dict[str, Callable[[bytes, int], bytes]] = {"": lambda data, _: data, "zstd": _zstd, "lz4": _lz4}


def _cut_off(path: Path, at: int) -> InputError:
    return InputError(path, f"ends, or is damaged, at byte {at}: it was not written to its end", _WRITE)


def _too_long(known: _Known, size: int, where: str) -> InputError:
    problem = f"{where} has {size} bytes, expected up to {LARGEST_MESSAGE}"
    return InputError(known.path, problem, "Name a topic of objects, or of the EGO.")
