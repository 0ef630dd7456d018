"""The random numbers that the kernel takes, drawn ahead."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats
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
    """Random numbers of N objects, BLOCK cycles ahead: rows (WIDTH, N) as the kernel takes them."""

    def __init__(self) -> None:
        self.streams: list[ObjectStreams] = []
        self.rows, self.next = np.empty((BLOCK, WIDTH, 0)), 0

    def regroup(
        self,
        streams: list[ObjectStreams],
        kept: NDArray[np.intp],
        before: NDArray[np.intp],
        new: NDArray[np.intp],
    ) -> None:
        """Change the columns: those `before` go to `kept`, and `new` ones begin."""
        old, self.streams = self.rows, streams
        self.rows = np.empty((BLOCK, WIDTH, len(streams)))
        self.rows[:, :, kept] = old[:, :, before]
        self._draw(new.tolist(), self.next)

    def take(self) -> Floats:
        """Give the next row; new ones when all were taken."""
        if self.next == BLOCK:
            self._draw(range(len(self.streams)), 0)
            self.next = 0
        self.next += 1
        row: Floats = self.rows[self.next - 1]
        return row

    def _draw(self, columns: list[int] | range, first: int) -> None:
        for n in columns:
            errors, detection = self.streams[n]
            self.rows[first:, :SIGHT, n] = errors.standard_normal((BLOCK - first, SIGHT))
            self.rows[first:, SIGHT, n] = detection.random(BLOCK - first)
