"""A chain as one file to download: results with all that they came from."""

from __future__ import annotations

import shutil
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path

from resim.core.errors import InputError
from resim.execution.workers import in_fresh_child
from resim.results.entry import CatalogEntry

LARGEST = 1e9
"""Bytes of the files of a crate that is given to a browser."""
_one_at_a_time = threading.Lock()


def packed_chain(entry: CatalogEntry) -> tuple[Path, Callable[[], None]]:
    """Give a zip of the crate of something in the user's catalog, and what takes it away again.

    It is packed in a process of its own, which gives back the memory that this takes. Raises InputError where it cannot
    be packed, or another one is packed at this moment.
    """
    if not _one_at_a_time.acquire(blocking=False):
        raise InputError(entry.name, "has to wait: another crate is packed", "Try again in a while.")
    folder = tempfile.TemporaryDirectory(prefix="resim-crate-")
    try:
        return in_fresh_child(_pack, (entry, Path(folder.name))), folder.cleanup
    except BaseException:
        folder.cleanup()
        raise
    finally:
        _one_at_a_time.release()


def _pack(task: tuple[CatalogEntry, Path]) -> Path:
    """Write the crate of something into a folder, and a zip of it beside: a task for a child process."""
    from resim.jobs.chain import write_chain
    from resim.jobs.lake import the_catalog

    entry, folder = task
    write_chain(the_catalog(), entry, folder / "crate", LARGEST)
    return Path(shutil.make_archive(str(folder / "chain"), "zip", folder / "crate"))
