"""The errors of perceived objects as they go on in time."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from resim.perception.model import Objects
from resim.perception.runtime.kernel import ERROR_ROWS, Q
from resim.perception.runtime.tables import ErrorTables

LEAST_SIZE = 0.1
"""m; no perceived box is shorter or narrower, if the model has errors of size."""

Columns = NDArray[np.intp]


class ObjectErrorState:
    """Errors of N objects in B runs; `drift` (B, Q, N) remembers their drifts, in units of their spreads.

    all (S, ERROR_ROWS, Q): the tables of all sets of all runs. least_size (B,) m.
    """

    def __init__(self, sets: Sequence[Sequence[Objects]]) -> None:
        self.tables = [ErrorTables([s.errors for s in own]) for own in sets]
        self.least_size = np.array([LEAST_SIZE if tables.sizes else -math.inf for tables in self.tables])
        self._first = np.cumsum([0, *map(len, sets)]).tolist()
        self.all = np.zeros((self._first[-1], ERROR_ROWS, Q))
        self.clear()

    def clear(self) -> None:
        """Forget all objects."""
        self.drift = np.zeros((len(self.tables), Q, 0))

    def step(self, b: int, dt: float) -> None:
        """Take the tables of a run for steps of dt [s]."""
        self.all[self._first[b] : self._first[b + 1]] = self.tables[b].table(dt)

    def regroup(
        self, kept: Columns, before: Columns, streams: dict[int, list[np.random.Generator]], n: int
    ) -> None:
        """Change to n columns: those `before` go to `kept`; the others are new, with these streams of their errors, one
        a run.
        """
        old, self.drift = self.drift, np.zeros((len(self.tables), Q, n))
        self.drift[:, :, kept] = old[:, :, before]
        for column, of in streams.items():
            for b, stream in enumerate(of):
                self.drift[b, :, column] = self.tables[b].root.dot(stream.standard_normal(Q))
