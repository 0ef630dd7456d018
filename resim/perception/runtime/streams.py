"""Random streams by name: a part, or an object, more or less changes no number that others draw."""

from __future__ import annotations

import hashlib

import numpy as np


class Streams:
    """Makes the random streams of one run."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.root = rng.integers(0, 2**32, size=4).tolist()
        self.times: dict[str, int] = {}

    def of(self, part: str, name: str = "") -> np.random.Generator:
        """Give a part's stream of this name; a further one each time that it is asked for."""
        key = f"{part}/{name}"
        times = self.times[key] = self.times.get(key, 0) + 1
        digest = hashlib.blake2b(key.encode(), digest_size=16).digest()
        seed = [*self.root, *np.frombuffer(digest, "<u4").tolist(), times]
        return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed)))


class PartStreams:
    """The random streams of one part in one run, which no other part draws from."""

    def __init__(self, streams: Streams, part: str) -> None:
        self._streams, self._part = streams, part

    def of(self, name: str = "") -> np.random.Generator:
        """Give the part's stream of this name, such as an object's; a further one each time that it is asked for."""
        return self._streams.of(self._part, name)
