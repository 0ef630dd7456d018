"""What code under test finds in its process, beside its own modules: the same for every run."""

from __future__ import annotations

import locale
import os
import random
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

_SEEDS = 1 << 32
"""How many seeds numpy's global generator takes."""


@contextmanager
def same_surroundings(seed: int) -> Iterator[None]:
    """Context in which `random` and `numpy.random` draw by the seed, and which puts back what the code changes.

    That is: these generators, environment variables, search path, recursion limit, locale, filters of warnings, and
    what numpy does about floating-point errors.
    """
    environment, path, limit = dict(os.environ), sys.path[:], sys.getrecursionlimit()
    language, drawn = locale.setlocale(locale.LC_ALL), random.getstate()
    drawn_by_numpy = np.random.get_state()  # noqa: NPY002
    random.seed(seed)
    np.random.seed(seed % _SEEDS)  # noqa: NPY002
    try:
        with warnings.catch_warnings(), np.errstate():
            yield
    finally:
        random.setstate(drawn)
        np.random.set_state(drawn_by_numpy)  # noqa: NPY002
        sys.setrecursionlimit(limit)
        sys.path[:] = path
        if locale.setlocale(locale.LC_ALL) != language:
            locale.setlocale(locale.LC_ALL, language)
        if dict(os.environ) != environment:
            os.environ.clear()
            os.environ.update(environment)
