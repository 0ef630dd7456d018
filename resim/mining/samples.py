"""The samples of tracks that there are, one after the other: an hour of traffic has room for no (N, T) arrays."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats
from resim.core.tracks import Strings, Tracks

Ints = NDArray[np.intp]
GAP = 0.5
"""Longest time [s] without a sample over which an object is followed (our choice); beyond it nothing is judged."""
STEPS = 2.5
"""... or so many of its usual steps, where these are longer."""
VEHICLES = frozenset({"car", "van", "truck", "bus", "trailer", "motorcycle", "bicycle", "unknown"})
"""Kinds of objects that drive on lanes."""
MOTOR = VEHICLES - {"bicycle"}
"""Kinds that maneuvers are found of, if nothing else is said."""


@dataclass(frozen=True, eq=False)
class Samples:
    """K samples of N objects, object by object, in order of time; (N, T) arrays without what is not there.

    Attributes:
        tracks: What they are taken from.
        owner: (K,) row of its object in the tracks.
        step: (K,) place in the tracks' times.
        first: (N + 1,) where each object's samples begin.
        piece: (P + 1,) where pieces begin: an object's samples without a gap that is longer than may be followed.
        t: (K,) s, as recorded.
        x: (K,) m.
        y: (K,) m.
        heading: (K,) rad.
        v: (K,) m/s.
    """

    tracks: Tracks
    owner: Ints
    step: Ints
    first: Ints
    piece: Ints
    t: Floats
    x: Floats
    y: Floats
    heading: Floats
    v: Floats

    def __len__(self) -> int:
        return len(self.t)

    @cached_property
    def piece_of(self) -> Ints:
        """The piece (K,) of each sample."""
        return np.repeat(np.arange(len(self.piece) - 1), np.diff(self.piece))

    @cached_property
    def by_step(self) -> tuple[Ints, Ints]:
        """The samples (K,) in order of time, those of step i from first[i] to first[i + 1], and first (T + 1,)."""
        order = np.argsort(self.step, kind="stable")
        return order, np.searchsorted(self.step[order], np.arange(len(self.tracks.t) + 1))

    @cached_property
    def rank(self) -> Ints:
        """The place (N,) of each id in their order: of numbers if all are, else of texts."""
        ids = self.tracks.ids
        numbers = all(name.isascii() and name.isdigit() for name in ids.tolist())
        order = np.argsort([int(name) for name in ids.tolist()] if numbers else ids, kind="stable")
        out = np.empty(len(ids), dtype=np.intp)
        out[order] = np.arange(len(ids))
        return out

    def kinds(self, wanted: frozenset[str]) -> NDArray[np.bool_]:
        """Say which samples (K,) are of objects of these kinds."""
        return np.isin(self.tracks.kind, list(wanted))[self.owner]

    def at(self, row: int, step: int) -> int:
        """Give the sample of an object (row of the tracks) at a step, -1 where there is none."""
        low, high = self.first[row], self.first[row + 1]
        found = low + int(np.searchsorted(self.step[low:high], step))
        return found if found < high and self.step[found] == step else -1

    def spread(self, values: NDArray[np.generic], none: object) -> NDArray[np.generic]:
        """Give values (K,) as (N, T), `none` where there is no sample."""
        out = np.full((len(self.tracks), len(self.tracks.t)), none, dtype=values.dtype)
        out[self.owner, self.step] = values
        return out


def samples_of(tracks: Tracks) -> Samples:
    """Give the samples of tracks."""
    row, step = np.nonzero(tracks.valid)
    t = tracks.t[step]
    first = np.searchsorted(row, np.arange(len(tracks) + 1))
    later = np.diff(t)
    later[first[1:-1][(first[1:-1] > 0) & (first[1:-1] < len(t))] - 1] = np.inf
    usual = float(np.median(later[np.isfinite(later)])) if np.isfinite(later).any() else 0.0
    breaks = np.flatnonzero(later > max(GAP, STEPS * usual) + 1e-9) + 1
    piece = np.concatenate([[0], breaks, [len(t)]]) if len(t) else np.zeros(1, np.intp)
    columns: tuple[Strings | Floats, ...] = (tracks.x, tracks.y, tracks.heading, tracks.v)
    x, y, heading, v = (column[row, step] for column in columns)
    return Samples(tracks, row, step, first, piece, t, x, y, heading, v)  # type: ignore[arg-type]
