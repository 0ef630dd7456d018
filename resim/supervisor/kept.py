"""Pages that many ask for are made once a second at most, and anew after every change."""

from __future__ import annotations

import secrets
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Hashable

FRESH = 1.0
"""s that a page is kept where no change is noticed: times, load and files in it are as old at most."""
MOST_KEPT, LARGEST = 64, 200_000
"""Pages that are kept, and letters of the largest of them."""


class KeptPages:
    """Pages as they were made last, without what is a session's own.

    Attributes:
        mark: Stands in a kept page where the seal of a session comes; nobody else knows it.
    """

    def __init__(self) -> None:
        self.mark = secrets.token_hex(32)
        self._kept: OrderedDict[Hashable, tuple[float, str]] = OrderedDict()
        self._lock = threading.Lock()

    def page(self, key: Hashable, make: Callable[[], str]) -> str:
        """Give the page that was made for a key, or make it. key: all that it depends on, time and files aside."""
        with self._lock:
            made, text = self._kept.get(key, (0.0, ""))
        now = time.monotonic()
        if text and now < made + FRESH:
            return text
        text = make()
        if len(text) > LARGEST:
            return text
        with self._lock:
            self._kept[key] = now, text
            self._kept.move_to_end(key)
            while len(self._kept) > MOST_KEPT:
                self._kept.popitem(last=False)
        return text
