"""How much one client may ask for: requests, and open streams."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict

MOST_CLIENTS = 10_000
"""Clients that are remembered; the one that was silent longest is forgotten."""


class RateLimit:
    """At most so many requests of one client: `burst` at once, and `each` a second in the long run."""

    def __init__(self, each: float, burst: float) -> None:
        self._each, self._burst = each, burst
        self._left: OrderedDict[str, tuple[float, float]] = OrderedDict()
        self._lock = threading.Lock()

    def allows(self, client: str) -> bool:
        """Say whether a client may ask once more now, and count that."""
        now = time.monotonic()
        with self._lock:
            left, then = self._left.pop(client, (self._burst, now))
            left = min(self._burst, left + (now - then) * self._each)
            allowed = left >= 1.0
            self._left[client] = (left - allowed, now)
            if len(self._left) > MOST_CLIENTS:
                self._left.popitem(last=False)
        return allowed


class StreamLimit:
    """At most so many open streams: of one client, and of all."""

    def __init__(self, each: int, most: int) -> None:
        self._each, self._most = each, most
        self._open: dict[str, int] = {}
        self._lock = threading.Lock()

    def takes(self, client: str) -> bool:
        """Count a stream of a client, where there is room for it; `leave` counts it out again."""
        with self._lock:
            mine = self._open.get(client, 0)
            if mine >= self._each or sum(self._open.values()) >= self._most:
                return False
            self._open[client] = mine + 1
            return True

    def leave(self, client: str) -> None:
        """Count a stream out."""
        with self._lock:
            left = self._open.get(client, 0) - 1
            if left > 0:
                self._open[client] = left
            else:
                self._open.pop(client, None)
