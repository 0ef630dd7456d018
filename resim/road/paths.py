"""The paths of several runs, asked together; what each gives is what its `Path` alone gives, to the bit."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats, constant
from resim.road.path import Path

Integers = NDArray[np.intp]


class Along(NamedTuple):
    """Objects of B lists along their runs' paths, (B, M), rearmost in the EGO's frame first; behind the last NaN.

    key: whose they are, -1 for none. s, d: m, of the centres along the path from the EGO's and left of the path. v_s,
    v_d: m/s along the path and to its left. half_length, half_width: m.
    """

    key: Integers
    s: Floats
    d: Floats
    v_s: Floats
    v_d: Floats
    half_length: Floats
    half_width: Floats

    def of(self, b: int) -> Along:
        """Give those of one run, (1, M)."""
        return Along(self.key[b : b + 1], *(column[b : b + 1] for column in self[1:]))


class Paths:
    """The paths of B runs, and the segments of them on which the EGOs and the objects are."""

    def __init__(self, paths: Sequence[Path]) -> None:
        self.paths = [*paths]
        self._egos = np.full(len(paths), -1)
        self._objects = np.full((len(paths), 1), -1)

    def change(self, b: int, path: Path) -> None:
        """Put another path in a run's place."""
        self.paths[b] = path
        self._egos[b] = self._objects[b] = -1
        for kept in ("_stacked", "_each"):
            self.__dict__.pop(kept, None)

    def place(self, ego: Floats) -> tuple[Floats, Floats, Floats]:
        """Give s, d [m] and the paths' headings [rad] (B,) where the EGOs are; ego: (B, 6) x, y [m] first."""
        # compiled: numba is imported where it is used only
        from resim.road import kernel

        out = np.empty((3, len(self.paths)))
        kernel.track_all(*self._stacked, self._egos, ego, out)
        self._s = out[0]
        return out[0], out[1], out[2]

    def along(
        self,
        ego: Floats,
        count: Integers,
        key: Integers,
        lists: Sequence[Floats],
        *,
        levels: tuple[float, float],
        behind: float,
        near: float,
    ) -> Along:
        """Find the objects of B lists of up to M up to `near` ahead and to the sides, and `behind` [m] of the EGOs,
        which were placed before.

        ego: (B, 6) x, y [m], heading [rad] first. count: (B,) how many are on each list. key: (B, M) a whole number for
        each object of a run. lists: x, y [m], heading [rad] in the EGO's frame, v [m/s], length, width [m], and height
        [m] above the EGO, each (B, M). levels: who is higher or lower than so much [m], and so much [m per m] on the
        way, is left out.
        """
        # compiled: numba is imported where it is used only
        from resim.road import kernel

        self._make_room(key)
        keys, out = np.empty(key.shape, np.intp), np.empty((6, *key.shape))
        kernel.along(
            *self._stacked, self._objects, ego, count, key, *lists, *levels, behind, near, self._s, out, keys
        )
        return Along(keys, *out)

    @property
    def room(self) -> int:
        """One more than the largest key that an object can have, as far as it is known."""
        return self._objects.shape[1]

    def _make_room(self, key: Integers) -> None:
        """Have a place for the segment of each object."""
        room, most = self._objects.shape[1], int(key.max()) + 1 if key.size else 0
        if most > room:
            more = np.full((len(self.paths), 2 * most - room), -1)
            self._objects = np.concatenate([self._objects, more], axis=1)

    def xy(self, s: Floats, d: Floats) -> tuple[Floats, Floats]:
        """Give the map positions (B, K) [m] at s (B, K), d (B, K) metres to the left."""
        x, y = np.empty(s.shape), np.empty(s.shape)
        for path, rows in self._each:
            x[rows], y[rows] = path.xy(s[rows], d[rows])
        return x, y

    def curvature_at(self, s: Floats) -> Floats:
        """Give the curvatures (B,) [1/m] at s (B,) [m]."""
        out = np.empty(len(s))
        for path, rows in self._each:
            out[rows] = path.curvature_at(s[rows])
        return out

    def speed_limit_at(self, s: Floats) -> Floats:
        """Give the speed limits (B,) [m/s] at s (B,) [m], NaN where there is none."""
        out = np.empty(len(s))
        for path, rows in self._each:
            out[rows] = path.speed_limit_at(s[rows])
        return out

    @cached_property
    def _each(self) -> list[tuple[Path, slice | list[int]]]:
        """Each path that there is, and which runs are on it."""
        first = self.paths[0]
        if all(path is first for path in self.paths):
            return [(first, slice(None))]
        which = {id(path): path for path in self.paths}.values()
        return [(path, [b for b, own in enumerate(self.paths) if own is path]) for path in which]

    @cached_property
    def _stacked(self) -> tuple[Floats, Floats, Integers]:
        """Tables and scores of the paths that there are, one after the other, and which rows are each run's (B, 2)."""
        which = {id(path): path for path in self.paths}
        tables = [path.search_table for path in which.values()]
        ends = np.cumsum([0, *(len(table) for table, _ in tables)])
        spans = {name: ends[k : k + 2] for k, name in enumerate(which)}
        rows, scores = (constant(np.concatenate(parts)) for parts in zip(*tables, strict=True))
        return rows, scores, np.array([spans[id(path)] for path in self.paths])
