"""When the lists of perceived objects are due."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from resim.core.clock import TICK
from resim.perception.model import Update
from resim.perception.runtime.lists import HeldList
from resim.simulation.function.batch import PerceivedBatch


class Clock:
    """When the lists of some runs are due, which are those with the same period; one with jitter has a run alone.

    rows (R,): which runs. last: when [s] the last list was made, -inf before the first; exactly: how long [s] the one
    before was ago then, 0 for the first; since: the same, as long as it is up to rounding. count: lists so far.
    """

    def __init__(self, rows: list[int], update: Update, rng: np.random.Generator) -> None:
        self.rows: NDArray[np.intp] = np.array(rows, dtype=np.intp)
        self._period, self._jitter, self._rng = update.period, update.jitter, rng
        self._due = self.last = -math.inf
        self.since, self.exactly, self.count = math.nan, 0.0, 0
        self._made: PerceivedBatch | None = None
        self._held: dict[int, HeldList] = {}

    def is_due(self, t: float) -> bool:
        """Say whether there is a list at t [s]."""
        return self._period == 0.0 or not t < self._due - TICK

    def tick(self, t: float) -> bool:
        """Take note of a list at t [s]; say whether it comes after another time than the one before."""
        since = self.exactly = t - self.last if self.last > -math.inf else 0.0
        self.last, self.count = t, self.count + 1
        if self._period > 0.0:
            self._set(t)
        if abs(since - self.since) <= TICK:
            return False
        self.since = since
        return True

    def _set(self, t: float) -> None:
        """Set when the next list is due."""
        due = max(self._due, t - self._period) if self._due > -math.inf else t
        while due <= t + TICK:
            jitter = self._jitter * self._rng.standard_normal() if self._jitter > 0.0 else 0.0
            due += max(self._period + jitter, 1e-3)
        self._due = due

    def hold(self, made: PerceivedBatch) -> None:
        """Keep lists that were made, to be shown until the next."""
        if self._period > 0.0:
            self._made = made
            self._held.clear()

    def held(self, b: int) -> HeldList:
        """Give the last list of a run."""
        if b not in self._held and self._made is not None:
            self._held[b] = HeldList(self._made.of(b))
        return self._held[b]


def clocks(updates: list[Update], rngs: list[np.random.Generator]) -> list[Clock]:
    """Give the clocks of runs, with the generators of their jitter."""
    alike: dict[object, list[int]] = {}
    for b, update in enumerate(updates):
        alike.setdefault(b if update.jitter > 0.0 else (update.period,), []).append(b)
    return [Clock(rows, updates[rows[0]], rngs[rows[0]]) for rows in alike.values()]
