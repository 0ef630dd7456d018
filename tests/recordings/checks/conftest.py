from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from resim.core.finding import Finding
from resim.recordings import RecordingTables, read_tables
from resim.recordings.checks import examine
from resim.road.opendrive import RoadNetwork

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="session")
def tables() -> Callable[[str], RecordingTables]:
    """Give the tables of a recording that ships, by name."""
    return lambda name: read_tables(ROOT / "scenarios" / name)


@pytest.fixture(scope="session")
def look(network: RoadNetwork) -> Callable[[RecordingTables], tuple[Finding, ...]]:
    """Examine on the proving ground."""
    return lambda tables: examine(tables, network)
