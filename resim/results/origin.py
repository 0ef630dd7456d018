"""With which versions and settings a folder of results was made, as its mark says."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from resim.core.errors import InputError
from resim.core.sealed import read_sealed
from resim.results.entry import KINDS, ItemKind

_SETTINGS = ("seed", "seeds", "engine", "vehicle", "step", "lead_in", "traffic", "prediction", "time_limit")
"""Of a mark what is told, wherever it stands in it; what is not set is left out."""
_WITHIN = ("inputs", "sweep", "options", "settings")
"""Parts of a mark that are looked into."""
_LARGEST = 20_000_000
"""Bytes of the largest mark that is read for this: pages show it."""


@dataclass(frozen=True)
class ResultOrigin:
    """How results were made.

    Attributes:
        versions: Of resim, its source and all packages that results depend on.
        settings: Seeds, engine, vehicle model and the like, as text, by name.
    """

    versions: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, str] = field(default_factory=dict)


def read_origin(folder: Path, kind: ItemKind) -> ResultOrigin:
    """Say how results were made; nothing of what is not there, or was altered."""
    try:
        told = read_sealed(folder / KINDS[kind][0], "Make it again.", largest=_LARGEST)
        versions = {str(name): str(version) for name, version in told["versions"].items()}
    except (InputError, KeyError, TypeError, AttributeError):
        return ResultOrigin()
    return ResultOrigin(versions, dict(_settings(told)))


def _settings(told: Any) -> Iterator[tuple[str, str]]:
    if not isinstance(told, Mapping):
        return
    for name in _WITHIN:
        yield from _settings(told.get(name))
    if isinstance(seen := told.get("perception"), Mapping) and isinstance(seeds := seen.get("seeds"), list):
        yield "seeds", str(len(seeds))
    if isinstance(told.get("traffic"), Mapping):
        yield "traffic", "reactive"
    for name in _SETTINGS:
        value = told.get(name)
        if isinstance(value, str | int | float) and not isinstance(value, bool):
            yield name, str(value)
        elif isinstance(value, list) and all(isinstance(one, str | int | float) for one in value) and value:
            yield name, " ".join(map(str, value))
