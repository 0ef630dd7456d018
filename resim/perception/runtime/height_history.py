"""The heights of the objects in the past: a sensor that is late has the height of the place that it tells."""

from __future__ import annotations

from collections import deque

import numpy as np

from resim.core.geometry import Floats
from resim.simulation.perception import Worlds


class HeightHistory:
    """Heights [m] of all objects at the last times, as far back as `need` [s]."""

    def __init__(self, need: float) -> None:
        self._need = need
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._past: deque[tuple[float, dict[str, float]]] = deque()

    def append(self, worlds: Worlds) -> None:
        """Take in the truth of now; without heights nothing."""
        if worlds.z is None:
            return
        self._past.append((worlds.t, dict(zip(worlds.ids.tolist(), worlds.z.tolist(), strict=True))))
        while len(self._past) > 2 and self._past[1][0] <= worlds.t - self._need:
            self._past.popleft()

    def z(self, worlds: Worlds) -> Floats:
        """Give the heights (N,) [m] that the objects of now had.

        Linear between times; of an object that is new, its first.
        """
        t = np.array([when for when, _ in self._past])
        then = worlds.t - self._need
        out = np.empty(len(worlds.ids))
        for n, name in enumerate(worlds.ids.tolist()):
            known = [k for k, (_, heights) in enumerate(self._past) if name in heights]
            out[n] = np.interp(then, t[known], [self._past[k][1][name] for k in known])
        return out
