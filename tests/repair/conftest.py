from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from resim.ingest import Tables, read_tables

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="session")
def tables() -> Callable[[str], Tables]:
    """Give the tables of a recording that ships, by name."""
    return lambda name: read_tables(ROOT / "scenarios" / name)
