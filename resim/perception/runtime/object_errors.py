"""The errors of perceived objects as they go on in time."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from resim.perception.model import Objects
from resim.perception.runtime.kernel import Q
from resim.perception.runtime.tables import ErrorTables

LEAST_SIZE = 0.1
"""m; no perceived box is shorter or narrower, if the model has errors of size."""

Columns = NDArray[np.intp]


class ObjectErrorState:
    """Errors of N objects; `drift` (Q, N) remembers their drifts, in units of their spreads."""

    def __init__(self, sets: Sequence[Objects]) -> None:
        self.tables = ErrorTables([s.errors for s in sets])
        self.least_size = LEAST_SIZE if self.tables.sizes else -math.inf
        self.clear()

    def clear(self) -> None:
        """Forget all objects."""
        self.drift = np.zeros((Q, 0))

    def regroup(
        self, kept: Columns, before: Columns, streams: dict[int, np.random.Generator], n: int
    ) -> None:
        """Change to n columns: those `before` go to `kept`; the others, with these streams of their errors, are new."""
        old, self.drift = self.drift, np.zeros((Q, n))
        self.drift[:, kept] = old[:, before]
        for column, stream in streams.items():
            self.drift[:, column] = self.tables.root.dot(stream.standard_normal(Q))
