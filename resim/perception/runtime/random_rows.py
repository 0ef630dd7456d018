"""The random numbers that the kernel takes, drawn ahead."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resim.perception.runtime.kernel import SIGHT, WIDTH
from resim.perception.runtime.streams import Streams

BLOCK = 64


class ObjectStreams(NamedTuple):
    """The random streams of an object: of its errors, and of its detection."""

    errors: np.random.Generator
    detection: np.random.Generator

    @classmethod
    def of(cls, streams: Streams, name: str) -> ObjectStreams:
        """Give the streams of an object that comes."""
        return cls(streams.of("errors", name), streams.of("detection", name))


class RandomRows:
    """Random numbers of N objects in B runs, BLOCK lists ahead: rows (BLOCK, B, WIDTH, N) as the kernel takes them, and
    which one (B,) each run has now, and which is the next.
    """

    def __init__(self, runs: int) -> None:
        self.streams: list[list[ObjectStreams]] = []  # of each object, one a run
        self.rows, self.next = np.empty((BLOCK, runs, WIDTH, 0)), np.zeros(runs, dtype=np.intp)
        self.row = self.next.copy()

    def regroup(
        self,
        streams: list[list[ObjectStreams]],
        kept: NDArray[np.intp],
        before: NDArray[np.intp],
        new: NDArray[np.intp],
    ) -> None:
        """Change the columns: those `before` go to `kept`, and `new` ones begin."""
        old, self.streams = self.rows, streams
        self.rows = np.empty((*old.shape[:-1], len(streams)))
        self.rows[..., kept] = old[..., before]
        for b, first in enumerate(self.next.tolist()):
            self._draw(b, new.tolist(), first)

    def take(self, runs: NDArray[np.intp], count: int) -> None:
        """Set the row of runs that make their count-th list; new ones are drawn when all were taken."""
        row = count % BLOCK
        if count and row == 0:
            for b in runs.tolist():
                self._draw(b, range(len(self.streams)), 0)
        self.row[runs], self.next[runs] = row, row + 1

    def _draw(self, b: int, columns: list[int] | range, first: int) -> None:
        for n in columns:
            errors, detection = self.streams[n][b]
            self.rows[first:, b, :SIGHT, n] = errors.standard_normal((BLOCK - first, SIGHT))
            self.rows[first:, b, SIGHT, n] = detection.random(BLOCK - first)
