"""Random numbers, one stream per object: one object more or less changes nothing for the others."""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from resim.core.geometry import Floats
from resim.perception.runtime.kernel import IDENTITY, SIGHT, WIDTH

BLOCK = 64


class Streams:
    """Makes the random streams of one run."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.root = rng.integers(0, 2**32, size=4).tolist()
        self.times: dict[str, int] = {}

    def of(self, kind: str, name: str = "") -> np.random.Generator:
        """Give the stream of this name; a further one each time that it is asked for."""
        key = f"{kind}/{name}"
        times = self.times[key] = self.times.get(key, 0) + 1
        digest = hashlib.blake2b(key.encode(), digest_size=16).digest()
        seed = [*self.root, *np.frombuffer(digest, "<u4").tolist(), times]
        return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed)))


class RandomRows:
    """Random numbers of N objects, BLOCK cycles ahead: rows (WIDTH, N) as the kernel takes them."""

    def __init__(self) -> None:
        self.streams: list[np.random.Generator] = []
        self.rows, self.next = np.empty((BLOCK, WIDTH, 0)), 0

    def regroup(
        self,
        streams: list[np.random.Generator],
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

    def least(self) -> float:
        """Give the least of the last row's numbers for id switches."""
        return self._least[self.next - 1]

    def _draw(self, columns: list[int] | range, first: int) -> None:
        for n in columns:
            draws = self.streams[n].standard_normal((BLOCK - first, WIDTH))
            draws[:, SIGHT:] = ndtr(draws[:, SIGHT:])
            self.rows[first:, :, n] = draws
        self._least: list[float] = self.rows[:, IDENTITY].min(axis=1, initial=1.0).tolist()
