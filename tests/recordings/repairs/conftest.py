from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from resim.recordings import RecordingTables, read_tables

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="session")
def tables() -> Callable[[str], RecordingTables]:
    """Give the tables of a recording that ships, by name."""
    return lambda name: read_tables(ROOT / "scenarios" / name)
