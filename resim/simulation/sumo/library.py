"""SUMO as a library, and nothing that it prints when it is loaded.

A process that forks others loads it before: it takes half a second, and starts no thread.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Send what libsumo's Arrow prints on standard output at import to nowhere."""
    sys.stdout.flush()
    keep = os.dup(1)
    try:
        with Path(os.devnull).open("w") as nowhere:
            os.dup2(nowhere.fileno(), 1)
            yield
    finally:
        os.dup2(keep, 1)
        os.close(keep)


with _quiet():
    import libsumo as libsumo
