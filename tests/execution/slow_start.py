"""A task in a module that takes its time to be imported, as from a network drive; a child process only."""

from __future__ import annotations

import time

from resim.core.plugins import watchdog

if isinstance(watchdog.board, memoryview):
    time.sleep(1.5)


def answer(number: int) -> int:
    """Give the number."""
    return number
