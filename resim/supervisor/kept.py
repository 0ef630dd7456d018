"""Pages that many ask for are made once a second at most, and anew after every change."""

from __future__ import annotations

import secrets
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Hashable
from weakref import WeakValueDictionary

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
        self._kept: OrderedDict[Hashable, tuple[float, float, str]] = OrderedDict()
        self._making: WeakValueDictionary[Hashable, threading.Lock] = (
            WeakValueDictionary()
        )  # while one is held
        self._lock = threading.Lock()

    def page(self, key: Hashable, make: Callable[[], str]) -> str:
        """Give the page that was made for a key, or make it, once for all who ask meanwhile.

        key: all that it depends on, time and files aside.
        """
        asked = time.monotonic()
        with self._lock:
            making = self._making.setdefault(key, threading.Lock())
        with making:
            return self._known(key, asked) or self._made(key, make)

    def _known(self, key: Hashable, asked: float) -> str:
        """The page if it is fresh, or was made while somebody waited who asked then; else ""."""
        with self._lock:
            begun, ended, text = self._kept.get(key, (0.0, 0.0, ""))
        return text if time.monotonic() < begun + FRESH or asked <= ended else ""

    def _made(self, key: Hashable, make: Callable[[], str]) -> str:
        begun, text = time.monotonic(), make()
        if len(text) > LARGEST:
            return text
        with self._lock:
            self._kept[key] = begun, time.monotonic(), text
            self._kept.move_to_end(key)
            while len(self._kept) > MOST_KEPT:
                self._kept.popitem(last=False)
        return text
