"""Definitions of message types in IDL, as ROS 2 writes them: modules, structures, type names and lists.

Source: OMG IDL 4.2, and what https://design.ros2.org/articles/idl_interface_definition.html uses of it. Constants,
annotations and comments do not change what is sent: they are passed over.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from resim.recordings.logs.cdr import PRIMITIVES, MessageField

MOST_FIXED = 1_000_000
"""Values of a list of a fixed length."""
_PASSED = re.compile(
    r"/\*.*?(?:\*/|\Z)|//[^\n]*|^\s*\#[^\n]*|@[\w:]+(?:\s*\((?:[^()\"]|\"(?:\\.|[^\"\\])*\")*\))?",
    re.MULTILINE | re.DOTALL,
)
_TOKEN = re.compile(r"[A-Za-z_]\w*(?:::\w+)*|::|\d+|[{}<>\[\],;]|\S")
_NUMBERS: Mapping[str, str] = {
    **{name: name for name in PRIMITIVES},
    "boolean": "bool", "short": "int16", "unsigned short": "uint16", "long": "int32", "unsigned long": "uint32",
    "long long": "int64", "unsigned long long": "uint64", "float": "float32", "double": "float64",
}  # fmt: skip
_ENUM = "uint32"


def parse_idl(text: str) -> dict[str, tuple[MessageField, ...]]:
    """Give the types in a definition, by their full names. Raises ValueError for what is no such definition."""
    reader = _IdlReader(_TOKEN.findall(_PASSED.sub(" ", text)))
    while reader.at < len(reader.tokens):
        reader.definition()
    if reader.modules:
        raise ValueError(f"the module {reader.modules[-1]} does not end")
    return reader.found


@dataclass
class _IdlReader:
    """What is read so far: the place, the modules around it, types, and other names of types with their lengths."""

    tokens: list[str]
    at: int = 0
    modules: list[str] = field(default_factory=list)
    found: dict[str, tuple[MessageField, ...]] = field(default_factory=dict)
    names: dict[str, tuple[str, int | None]] = field(default_factory=dict)

    def definition(self) -> None:
        """Read what begins here."""
        word = self._next()
        if word == "module":
            self.modules.append(self._next())
            self._expect("{")
        elif word == "}" and self.modules:
            self.modules.pop()
        elif word == "struct":
            self._structure(self._next())
        elif word == "typedef":
            kind, size = self._type()
            name = self._next()
            self.names["/".join([*self.modules, name])] = kind, self._length(size)
            self._expect(";")
        elif word == "enum":
            self.names["/".join([*self.modules, self._next()])] = _ENUM, None
            self._pass_to("}")
        elif word == "const":
            self._pass_to(";")
        elif word != ";":
            raise ValueError(f"{word!r} is no definition")

    def _structure(self, name: str) -> None:
        fields = []
        self._expect("{")
        while (word := self._next()) != "}":
            self.at -= 1
            kind, size = self._type()
            name_of = self._next()
            if not re.fullmatch(r"[A-Za-z_]\w*", name_of):
                raise ValueError(f"{name}: {word} {name_of!r} is no field")
            fields.append(MessageField(name_of, kind, self._length(size)))
            self._expect(";")
        self.found["/".join([*self.modules, name])] = tuple(fields)

    def _type(self) -> tuple[str, int | None]:
        """A type and its length: None for one value, 0 for any number of them."""
        word = self._next()
        if word == "sequence":
            self._expect("<")
            kind, size = ("", 0) if self._peek() == "sequence" else self._type()
            if size is not None:
                raise ValueError("a list of lists is not read")
            self._bound()
            return kind, 0
        if word == "string":
            if self._peek() == "<":
                self._expect("<")
                self._bound(first=True)
            return "string", None
        while word in ("unsigned", "long", "unsigned long") and self._peek() in ("short", "long", "double"):
            word = f"{word} {self._next()}"
        if word in _NUMBERS:
            return _NUMBERS[word], None
        if word in ("wstring", "wchar", "long double", "any", "map", "union"):
            raise ValueError(f"a {word} is not read")
        own = word.replace("::", "/")
        return self.names.get(own) or self.names.get("/".join([*self.modules, own]), (self._full(own), None))

    def _full(self, name: str) -> str:
        return name if "/" in name else "/".join([*self.modules, name])

    def _bound(self, *, first: bool = False) -> None:
        """Go behind the largest length of a list or text, and its bracket."""
        if first or self._peek() == ",":
            self.at += 0 if first else 1
            self._next()
        self._expect(">")

    def _length(self, size: int | None) -> int | None:
        """The length of a list by the brackets that follow, else as it was."""
        if self._peek() != "[":
            return size
        self._expect("[")
        told = self._next()
        self._expect("]")
        if size is not None or not told.isdecimal() or not 0 < int(told[:9]) <= MOST_FIXED:
            raise ValueError(f"a list of {told[:20]} is not read")
        return int(told[:9])

    def _peek(self) -> str:
        return self.tokens[self.at] if self.at < len(self.tokens) else ""

    def _next(self) -> str:
        if self.at >= len(self.tokens):
            raise ValueError("it ends too early")
        self.at += 1
        return self.tokens[self.at - 1]

    def _expect(self, sign: str) -> None:
        if (found := self._next()) != sign:
            raise ValueError(f"{found[:40]!r} stands where {sign!r} is expected")

    def _pass_to(self, sign: str) -> None:
        while self._next() != sign:
            pass
