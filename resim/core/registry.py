"""Parts of one kind by name, in order: each part's own file adds it, and the package of the kind imports every file."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Generic, Protocol, TypeVar

from resim.core.errors import ResimError
from resim.core.spelling import unknown


class RegistryEntry(Protocol):
    """What can be in a registry."""

    @property
    def name(self) -> str:
        """Give the name that users call it by."""


Part = TypeVar("Part", bound=RegistryEntry)


class Registry(Generic[Part]):
    """The parts of one kind ("sweep plan"), in the order in which they were added."""

    def __init__(self, kind: str) -> None:
        self.kind = kind
        self._parts: dict[str, Part] = {}

    def add(self, part: Part) -> Part:
        """Add a part and give it back. Raises ValueError where the name is taken."""
        if part.name in self._parts:
            raise ValueError(f"two of the kind {self.kind!r} have the name {part.name!r}")
        self._parts[part.name] = part
        return part

    def __getitem__(self, name: str) -> Part:
        """Give the part of this name. Raises ResimError naming those that there are."""
        if name not in self._parts:
            raise ResimError(unknown(self.kind, name, self.names))
        return self._parts[name]

    def __iter__(self) -> Iterator[Part]:
        return iter(self._parts.values())

    def __contains__(self, name: object) -> bool:
        return name in self._parts

    @property
    def names(self) -> tuple[str, ...]:
        """The names, in order."""
        return tuple(self._parts)
