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
    the next one (B,) of each run.
    """

    def __init__(self, runs: int) -> None:
        self.streams: list[list[ObjectStreams]] = []  # of each object, one a run
        self.rows, self.next = np.empty((BLOCK, runs, WIDTH, 0)), np.zeros(runs, dtype=np.intp)

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

    def take(self, listed: NDArray[np.bool_]) -> NDArray[np.intp]:
        """Give which row (B,) is the next of each run that makes a list; new ones are drawn when all were taken."""
        if self.next.max() == BLOCK:
            for b in np.flatnonzero(listed & (self.next == BLOCK)).tolist():
                self._draw(b, range(len(self.streams)), 0)
                self.next[b] = 0
        taken = self.next.copy()
        self.next += listed
        return taken

    def _draw(self, b: int, columns: list[int] | range, first: int) -> None:
        for n in columns:
            errors, detection = self.streams[n][b]
            self.rows[first:, b, :SIGHT, n] = errors.standard_normal((BLOCK - first, SIGHT))
            self.rows[first:, b, SIGHT, n] = detection.random(BLOCK - first)
