"""Checksums for an MCAP file whose writer leaves them out, as that of rosbags does."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from zlib import crc32

_BEGIN = 8
"""Bytes of the magic before the first record, and after the last."""
_HEAD = 9
"""Bytes of a record before its content: opcode and length."""
_FOOTER, _CHUNK, _DATA_END = 0x02, 0x06, 0x0F


def add_checksums(path: Path) -> None:
    """Write CRC-32 into the chunks, the data end and the footer of a file, of which none is compressed.

    Source: the MCAP specification, records Chunk, Data End and Footer.
    """
    raw = bytearray(path.read_bytes())
    for code, begin, end in _records(raw):
        if code == _CHUNK:
            (name,) = struct.unpack_from("<I", raw, begin + 28)
            if name:
                raise ValueError(f"{path} has compressed chunks")
            struct.pack_into("<I", raw, begin + 24, crc32(memoryview(raw)[begin + 40 : end]))
        elif code == _DATA_END:
            struct.pack_into("<I", raw, begin, crc32(memoryview(raw)[: begin - _HEAD]))
        elif code == _FOOTER:
            (summary,) = struct.unpack_from("<Q", raw, begin)
            struct.pack_into(
                "<I", raw, begin + 16, crc32(memoryview(raw)[summary or begin - _HEAD : begin + 16])
            )
    path.write_bytes(raw)


def _records(raw: bytearray) -> Iterator[tuple[int, int, int]]:
    """The opcode of each record, and where its content begins and ends."""
    at = _BEGIN
    while at < len(raw) - _BEGIN:
        code, size = struct.unpack_from("<BQ", raw, at)
        yield code, at + _HEAD, at + _HEAD + size
        at += _HEAD + size
