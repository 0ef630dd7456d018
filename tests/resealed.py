"""Results that say something else than what was written, under a checksum that fits: who edits both."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from resim.core.sealed import read_sealed, sealed
from resim.results import write_json


def edit(path: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    """Change what a file says, and its checksum with it."""
    said = read_sealed(path, "")
    change(said)
    write_json(sealed(said), path)
