"""The pool of a cluster's workers: Dask, by the address of its scheduler (Slurm, Kubernetes, or processes by hand)."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass

from resim.core.errors import InputError


@dataclass(frozen=True)
class Cluster:
    """A pool of so many threads, each of which supervises a child of its own; and the page that shows it at work."""

    pool: Executor
    threads: int
    dashboard: str


@contextmanager
def cluster(address: str) -> Iterator[Cluster]:
    """Give the cluster whose scheduler answers at an address, such as tcp://head:8786.

    Its workers need this project and its files at the same paths. Raises InputError where none answers, or it has no
    workers.
    """
    try:
        from distributed import Client
    except ImportError as e:
        raise InputError(
            "--scheduler", "needs Dask", "In resim's own folder: pip install '.[cluster]'"
        ) from e
    for name in ("distributed", "distributed.client", "distributed.utils"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # a scheduler that is gone is told of once, by us
    try:
        client = Client(address, timeout=10)
    except (OSError, ValueError) as e:
        raise InputError(
            "--scheduler", f"{address}: no scheduler answers ({e})", "Start one, or correct it."
        ) from e
    with client:
        threads = sum(client.nthreads().values())
        if not threads:
            raise InputError("--scheduler", f"{address} has no workers", "Start some.")
        yield Cluster(client.get_executor(pure=False), threads, str(client.dashboard_link))
