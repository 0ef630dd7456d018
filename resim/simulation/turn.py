"""Whose turn it is to drive: one thread after the other, as what surrounds a function is the process's."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Iterator

from resim.core.errors import ResimError


class _Turn:
    """Who drives."""

    def __init__(self) -> None:
        self.lock, self.thread = threading.Lock(), 0


_TURN = _Turn()
os.register_at_fork(after_in_child=_TURN.__init__)  # type: ignore[misc]


@contextlib.contextmanager
def turn() -> Iterator[None]:
    """Let this thread drive alone, once those are done that came before.

    Raises ResimError within a drive of this thread: code under test cannot drive another one meanwhile.
    """
    if _TURN.thread == threading.get_ident():
        raise ResimError(
            "a drive is being simulated in this thread: wait for its end, or use another process"
        )
    with _TURN.lock:
        _TURN.thread = threading.get_ident()
        try:
            yield
        finally:
            _TURN.thread = 0
