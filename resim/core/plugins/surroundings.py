"""What code under test finds in its process, beside its own modules: the same for every run."""

from __future__ import annotations

import random
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from resim.core.plugins import process

_SEEDS = 1 << 32
"""How many seeds numpy's global generator takes."""


@contextmanager
def same_surroundings(seed: int) -> Iterator[None]:
    """Context in which `random` and `numpy.random` draw by the seed, and which puts back what the code changes.

    That is: these generators, the search path, and what `process.state` gives.
    """
    before, path = process.state(), sys.path[:]
    drawn, drawn_by_numpy = random.getstate(), np.random.get_state()  # noqa: NPY002
    random.seed(seed)
    np.random.seed(seed % _SEEDS)  # noqa: NPY002
    try:
        yield
    finally:
        random.setstate(drawn)
        np.random.set_state(drawn_by_numpy)  # noqa: NPY002
        sys.path[:] = path
        process.put_back(before)
