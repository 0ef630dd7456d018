"""Messages of ROS 2 as bytes (CDR): read by the definition of their type, without code made from it.

Source: OMG DDS-XTypes 1.3, 7.4 (XCDR version 1); alignment counts from behind the four bytes of the encapsulation.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from resim.recordings.logs.limits import DEEPEST, LONGEST_ARRAY, MOST_ELEMENTS

PRIMITIVES: Mapping[str, str] = {
    "bool": "?", "byte": "B", "char": "B", "octet": "B", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H",
    "int32": "i", "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip
"""Types of one number, by the letters of `struct`."""
_BYTES = ("byte", "char", "octet", "uint8", "int8")
LONGEST_BYTES = 32
"""Bytes of an array that are kept, as of a UUID."""


@dataclass(frozen=True)
class MessageField:
    """A field of a message type.

    Attributes:
        name: Of the field.
        type: "float64", "string", or the full name of a message type.
        size: None for one value, 0 for a list of any length, else how many values there always are.
    """

    name: str
    type: str
    size: int | None = None


Definitions = Mapping[str, Sequence[MessageField]]
"""Fields by the full name of the type, such as nav_msgs/msg/Odometry."""
Wanted = Mapping[str, "Wanted"] | None
"""Which fields are kept, and which of those within; None: all."""


class CdrReader:
    """Reads messages of one type.

    Attributes:
        types: Definitions of all types in it.
        name: Of the type.
        wanted: Fields that are kept; others are skipped. Within a list all are, but in the one of objects.
        list: Path of the list of objects, () where there is none.
    """

    def __init__(self, types: Definitions, name: str, wanted: Wanted, list: tuple[str, ...]) -> None:
        """Raises ValueError for a type that is not defined, or contains itself."""
        self.types, self.name, self.wanted, self.list = types, name, wanted, list
        self._numbers: dict[str, tuple[str, int] | None] = {}
        self._check(name, ())
        self._data, self._at, self._order, self._left = b"", 0, "<", 0

    def read(self, body: bytes) -> dict[str, object]:
        """Give a message of its bytes. Raises ValueError where they are none of this type."""
        if len(body) < 4 or body[0] or body[1] not in (0, 1):
            raise ValueError(
                f"its encapsulation is {body[:4].hex(' ') or 'missing'}, expected 00 00 or 00 01 (CDR)"
            )
        self._data, self._at, self._order = body[4:], 0, "<" if body[1] else ">"
        self._left = MOST_ELEMENTS
        found = self._structure(self.name, self.wanted, ())
        if (left := len(self._data) - self._at) > 3:
            raise ValueError(
                f"{left} bytes are left: its type {self.name} is another than the definition says"
            )
        return found

    def _check(self, name: str, above: tuple[str, ...]) -> None:
        if name in self._numbers:
            return
        if name in above or len(above) > DEEPEST:
            raise ValueError(f"the type {name} contains itself")
        if name not in self.types:
            raise ValueError(f"the type {name} is not defined")
        fields = self.types[name]
        for field in fields:
            if field.type not in PRIMITIVES and field.type != "string":
                self._check(field.type, (*above, name))
        self._numbers[name] = self._of_one_kind(fields)

    def _of_one_kind(self, fields: Sequence[MessageField]) -> tuple[str, int] | None:
        """Type and count of the numbers that such a structure consists of, None where they differ in type or count."""
        kinds, count = set(), 0
        for field in fields:
            inner = (field.type, 1) if field.type in PRIMITIVES else self._numbers.get(field.type)
            if inner is None or field.size == 0:
                return None
            kinds.add(inner[0])
            count += inner[1] * (1 if field.size is None else field.size)
        return (kinds.pop(), count) if len(kinds) == 1 else None

    def _structure(self, name: str, wanted: Wanted, path: tuple[str, ...]) -> dict[str, object]:
        """The wanted fields of a structure that begins here."""
        found: dict[str, object] = {}
        fields = self.types[name]
        if not fields:  # an empty type has one byte
            self._advance(1)
        for field in fields:
            if wanted is not None and field.name not in wanted:
                self._skip(field)
                continue
            inner = None if wanted is None else wanted[field.name]
            here = (*path, field.name)
            if field.size is None:
                found[field.name] = self._one(field.type, inner, here)
            else:
                found[field.name] = self._several(field, inner, here)
        return found

    def _one(self, kind: str, wanted: Wanted, path: tuple[str, ...]) -> object:
        if kind in PRIMITIVES:
            return self._unpacked(kind, 1)[0]
        if kind == "string":
            return self._text().decode(errors="replace")
        return self._structure(kind, wanted, path)

    def _several(self, field: MessageField, wanted: Wanted, path: tuple[str, ...]) -> object:
        count = self._count(field)
        if field.type in PRIMITIVES:
            if field.type in _BYTES and count <= LONGEST_BYTES:
                return bytes(self._take(count))
            if count <= LONGEST_ARRAY:
                return list(self._unpacked(field.type, count))
            self._pass(field.type, count)
            return None
        self._left -= count
        if self._left < 0:
            raise ValueError(f"its lists have more than {MOST_ELEMENTS} elements")
        inner = wanted if path == self.list else None
        return [self._one(field.type, inner, path) for _ in range(count)]

    def _skip(self, field: MessageField) -> None:
        """Go behind a field."""
        count = 1 if field.size is None else self._count(field)
        if field.type == "string":
            for _ in range(count):
                self._advance(self._length())
            return
        kind = (field.type, 1) if field.type in PRIMITIVES else self._numbers[field.type]
        if kind is not None:
            self._pass(kind[0], kind[1] * count)
            return
        fields = self.types[field.type]
        for _ in range(count):
            if not fields:
                self._advance(1)
            for inner in fields:
                self._skip(inner)

    def _count(self, field: MessageField) -> int:
        """How many values a list has here. Raises ValueError where there are fewer bytes."""
        count = field.size or int(self._unpacked("uint32", 1)[0])
        if count > len(self._data) - self._at:
            raise ValueError(f"{field.name} claims {count} elements in {len(self._data) - self._at} bytes")
        return count

    def _text(self) -> bytes:
        return self._take(self._length()).rstrip(b"\0")

    def _length(self) -> int:
        """How many bytes a text has here, with the 0 that ends it."""
        return int(self._unpacked("uint32", 1)[0])

    def _unpacked(self, kind: str, count: int) -> tuple[float | int | bool, ...]:
        start = self._at
        self._pass(kind, count)
        size = struct.calcsize("=" + PRIMITIVES[kind])
        return struct.unpack_from(
            f"{self._order}{count}{PRIMITIVES[kind]}", self._data, -(-start // size) * size
        )

    def _pass(self, kind: str, count: int) -> None:
        """Go behind numbers, which begin at a multiple of their size."""
        if count:
            size = struct.calcsize("=" + PRIMITIVES[kind])
            self._at = -(-self._at // size) * size
            self._advance(size * count)

    def _take(self, size: int) -> bytes:
        """The next bytes."""
        start = self._at
        self._advance(size)
        return self._data[start : self._at]

    def _advance(self, size: int) -> None:
        """Go behind the next bytes. Raises ValueError where there are fewer."""
        if size > len(self._data) - self._at:
            raise ValueError(f"it ends after {len(self._data) + 4} bytes, within its type {self.name}")
        self._at += size
