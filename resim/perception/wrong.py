"""The errors of perceived objects as they go on in time."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats
from resim.perception.model import Objects
from resim.perception.tables import BIAS, CHANCES, CONDITIONS, DRIVE, KEEP, OUTCOMES, SPREADS, ErrorTables, Q
from resim.sim.perception import World

LEAST_SIZE = 0.1
"""m; no perceived box is shorter or narrower, if the model has errors of size."""
TURN, HALF_TURN = np.array(2.0 * math.pi), np.array(math.pi)
"""rad; as arrays, which numpy takes faster than floats."""
_SAME = 1e-9  # s

Columns = NDArray[np.intp]


class Wrong:
    """Errors of N objects; remembers their drifts, in units of their spreads."""

    def __init__(self, sets: Sequence[Objects]) -> None:
        self.tables = ErrorTables([s.errors for s in sets])
        self.any = self.tables.any
        self.clear()

    def clear(self) -> None:
        """Forget all objects."""
        self.drift = np.zeros((Q, 0))

    def regroup(
        self, kept: Columns, before: Columns, streams: dict[int, np.random.Generator], n: int
    ) -> None:
        """Change to n columns: those `before` go to `kept`; the others, with their random streams, are new."""
        old, self.drift = self.drift, np.zeros((Q, n))
        self.drift[:, kept] = old[:, before]
        for column, stream in streams.items():
            self.drift[:, column] = self.tables.root.dot(stream.standard_normal(Q))
        self.cells = np.arange(OUTCOMES * n).reshape(OUTCOMES, n)

    def choose(self, chosen: Columns) -> None:
        """Set which set of parameters each object (N,) has."""
        self.step, self.choice = -math.inf, None
        self.used = tuple(sorted(set(chosen.tolist()))) or (0,)
        if len(self.used) > 1:
            self.choice = self.cells + np.array(self.used).searchsorted(chosen) * self.cells.size

    def hold(self) -> None:
        """Keep the drifts, which stand in the last row of random numbers, before that is filled anew."""
        self.drift = self.drift.copy()

    def add(
        self, row: Floats, step: float, world: World, true: tuple[Floats, Floats, Floats, Floats]
    ) -> Floats:
        """Give (Q, N) x, y, v, heading, length and width with the errors `step` [s] after the last.

        row: conditions and chances; the drifts are left in it. true: x, y [m], v [m/s], and pi less the heading [rad].
        """
        if not abs(step - self.step) < _SAME:
            self.matrix, self.step = self.tables.matrix(step, self.used), step
        outcomes = self.matrix.dot(row[: CONDITIONS + Q])
        if self.choice is not None:
            outcomes = outcomes.take(self.choice)
        drift = np.multiply(outcomes[KEEP], self.drift, row[CONDITIONS : CONDITIONS + Q])
        drift += outcomes[DRIVE]
        self.drift = drift
        errors = np.exp(outcomes[SPREADS])
        errors *= row[CHANCES]
        out = np.empty(drift.shape)
        out[0], out[1], out[2], out[3] = true
        out[4], out[5] = world.length, world.width
        out += outcomes[BIAS]
        out += errors[:Q]
        out += errors[Q:]
        heading = out[3]
        np.mod(heading, TURN, heading)
        np.subtract(HALF_TURN, heading, heading)
        if self.tables.sizes:
            sizes = out[4:]
            np.maximum(sizes, LEAST_SIZE, out=sizes)
        return out
