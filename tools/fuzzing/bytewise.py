"""Damages any file byte by byte, with no idea of what is in it."""

from __future__ import annotations

import re
from collections.abc import Callable
from random import Random

from fuzzing.values import NUMBERS, RAW, TEXTS

NUMBER = re.compile(rb"-?\d+(\.\d+)?([eE][+-]?\d+)?")
Damage = Callable[[Random, bytes, bytes], bytes]


def damaged(rng: Random, data: bytes, other: bytes) -> bytes:
    """Give the data with one to four damages; `other` is a file to splice from."""
    for _ in range(rng.choice((1, 1, 1, 2, 3, 4))):
        data = rng.choice(ALL)(rng, data, other)
    return data


def _span(rng: Random, data: bytes, most: int = 400) -> tuple[int, int]:
    start = rng.randrange(len(data) + 1)
    return start, min(len(data), start + int(rng.random() ** 3 * most) + 1)


def _flip(rng: Random, data: bytes, _: bytes) -> bytes:
    out = bytearray(data)
    for _n in range(rng.randint(1, 8) if out else 0):
        out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
    return bytes(out)


def _delete(rng: Random, data: bytes, _: bytes) -> bytes:
    start, end = _span(rng, data)
    return data[:start] + data[end:]


def _insert(rng: Random, data: bytes, _: bytes) -> bytes:
    at = rng.randrange(len(data) + 1)
    new = rng.choice(RAW) if rng.random() < 0.7 else rng.randbytes(rng.randint(1, 64))
    return data[:at] + new + data[at:]


def _duplicate(rng: Random, data: bytes, _: bytes) -> bytes:
    start, end = _span(rng, data, 2000)
    return data[:end] + data[start:end] * rng.choice((1, 1, 2, 50)) + data[end:]


def _truncate(rng: Random, data: bytes, _: bytes) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _splice(rng: Random, data: bytes, other: bytes) -> bytes:
    start, end = _span(rng, other, 3000)
    low, high = _span(rng, data, 3000)
    return data[:low] + other[start:end] + data[high if rng.random() < 0.5 else low :]


def _numbers(rng: Random, data: bytes, _: bytes) -> bytes:
    """Put other numbers in the place of some."""
    found = list(NUMBER.finditer(data))
    for match in sorted(rng.sample(found, min(len(found), rng.randint(1, 4))), key=lambda m: -m.start()):
        new = rng.choice(NUMBERS if rng.random() < 0.8 else TEXTS).encode()
        data = data[: match.start()] + new + data[match.end() :]
    return data


def _exchange(rng: Random, data: bytes, _: bytes) -> bytes:
    """Exchange two numbers."""
    found = list(NUMBER.finditer(data))
    if len(found) < 2:
        return data
    a, b = sorted(rng.sample(found, 2), key=lambda m: m.start())
    return data[: a.start()] + b.group() + data[a.end() : b.start()] + a.group() + data[b.end() :]


def _encoding(rng: Random, data: bytes, _: bytes) -> bytes:
    text = data.decode("utf-8", errors="replace")
    how = rng.choice(
        ("utf-8-sig", "utf-16", "utf-16-le", "utf-32", "latin-1", "cp037", "crlf", "cr", "empty")
    )
    if how == "empty":
        return b""
    if how in ("crlf", "cr"):
        return text.replace("\n", "\r\n" if how == "crlf" else "\r").encode()
    return text.encode(how, errors="replace")


ALL: tuple[Damage, ...] = (
    _flip, _delete, _insert, _duplicate, _truncate, _splice, _numbers, _numbers, _numbers, _exchange, _encoding
)  # fmt: skip
