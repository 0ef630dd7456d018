"""What several tests of pages take."""

from collections.abc import Iterator
from typing import Any

import pytest
from browsed import chromium


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium, for the tests of a module."""
    with chromium() as found:
        yield found
