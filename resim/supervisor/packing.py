"""A chain as one file to download: results with all that they came from."""

from __future__ import annotations

import shutil
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from resim.core.errors import InputError
from resim.jobs.chain import write_chain
from resim.results.catalog import Catalog
from resim.results.entry import CatalogEntry

_one_at_a_time = threading.Lock()


@contextmanager
def packed_chain(catalog: Catalog, entry: CatalogEntry) -> Iterator[Path]:
    """Give a zip of the crate of something, which is gone afterwards.

    Raises InputError where it cannot be packed, or another one is packed at this moment.
    """
    if not _one_at_a_time.acquire(blocking=False):
        raise InputError(entry.name, "has to wait: another crate is packed", "Try again in a while.")
    try:
        with tempfile.TemporaryDirectory(prefix="resim-crate-") as folder:
            write_chain(catalog, entry, Path(folder) / "crate")
            yield Path(shutil.make_archive(str(Path(folder) / "chain"), "zip", Path(folder) / "crate"))
    finally:
        _one_at_a_time.release()
