"""A chain as one file to download: results with all that they came from."""

from __future__ import annotations

import os
import shutil
import tempfile
import threading
from pathlib import Path
from typing import BinaryIO

from resim.core.errors import InputError
from resim.execution.workers import in_fresh_child
from resim.results.entry import CatalogEntry
from resim.supervisor.processes import is_alive, process_name

LARGEST = 1e9
"""Bytes of the files of a crate that is given to a browser."""
_one_at_a_time = threading.Lock()


PREFIX = "resim-crate-"
"""Of temporary folders in which crates are packed; behind it stands which process does."""


def packed_chain(entry: CatalogEntry) -> BinaryIO:
    """Give a zip of the crate of something in the user's catalog, as a file that has no name any more.

    It is packed in a process of its own, which gives back the memory that this takes. What a server that was killed
    left behind is taken away. Raises InputError where it cannot be packed, or another one is packed at this moment.
    """
    if not _one_at_a_time.acquire(blocking=False):
        raise InputError(entry.name, "has to wait: another crate is packed", "Try again in a while.")
    try:
        _remove_left()
        with tempfile.TemporaryDirectory(prefix=f"{PREFIX}{process_name()}-") as folder:
            return in_fresh_child(_pack, (entry, Path(folder))).open("rb")
    finally:
        _one_at_a_time.release()


def _remove_left() -> None:
    """Take away what processes that are gone left behind."""
    for path in Path(tempfile.gettempdir()).glob(f"{PREFIX}*-*"):
        if path.is_dir() and not path.is_symlink() and path.stat().st_uid == os.getuid():
            process = path.name.removeprefix(PREFIX).rpartition("-")[0]
            if "@" in process and not is_alive(process):
                shutil.rmtree(path, ignore_errors=True)


def _pack(task: tuple[CatalogEntry, Path]) -> Path:
    """Write the crate of something into a folder, and a zip of it beside: a task for a child process."""
    from resim.jobs.chain import write_chain
    from resim.jobs.lake import the_catalog

    entry, folder = task
    write_chain(the_catalog(), entry, folder / "crate", LARGEST)
    return Path(shutil.make_archive(str(folder / "chain"), "zip", folder / "crate"))
