"""Logs whose topics are known: the mappings that ship, for what Autoware records."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from resim.core.files import parse_toml, read_file

MAPPINGS = Path(__file__).with_name("mappings")
_REMEDY = "Install resim again."


def known_mappings(topics: Collection[str]) -> list[Path]:
    """Give the mappings that ship whose topics are all among those of a log, those that take most of them first."""
    found = {path: _topics(path) for path in sorted(MAPPINGS.glob("*.toml"))}
    fitting = [path for path, wanted in found.items() if wanted <= {*topics}]
    return sorted(fitting, key=lambda path: -len(found[path]))


def _topics(path: Path) -> set[str]:
    """The topics that a mapping takes."""
    told = parse_toml(read_file(path, _REMEDY), path, _REMEDY)
    tables = [told[name] for name in ("gt", "sd") if name in told]
    return {one["topic"] for table in tables for one in (table if isinstance(table, list) else [table])}
