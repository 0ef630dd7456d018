"""What a source says of where an object is: its sightings, under one id or under several, one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from resim.core.geometry import Bools, Floats
from resim.core.tracks import Tracks

MOVES = 1.0
"""Speed [m/s] from which on an object leaves an area, and cannot stay where it was."""
WINDOW = 0.25
"""Time [s] to either side over which positions tell a speed."""
SAME = 1e-6
"""Times [s] this near to each other are one."""


@dataclass(frozen=True, eq=False)
class Sightings:
    """What is known of one object. ids: under which it is seen, in order of time; part: (n,) which of them each is.

    t: (n,) s; state: (n, 5) x, y [m], heading [rad], vx, vy [m/s], heading NaN where unknown. usable: (n,) which rows
    are whole; blind: (b,) s, times of rows that say no place; lacks: what rows lack. size: length, width [m];
    kind: of all ids, "" where they differ. z: (n,) m, heights of the road, NaN where not known; None where none is.
    """

    ids: tuple[str, ...]
    part: NDArray[np.intp]
    t: Floats
    state: Floats
    usable: Bools
    blind: Floats
    lacks: str
    size: tuple[float, float]
    kind: str
    z: Floats | None = None

    @property
    def step(self) -> float:
        """Its usual time [s] from one sample to the next of an id; 0 where no id has two."""
        steps = np.diff(self.t)[np.diff(self.part) == 0]
        return float(np.median(steps)) if len(steps) else 0.0

    def within(self, begin: float, end: float) -> Sightings:
        """Give what is known from `begin` to `end` [s]."""
        keep, blind = (
            (t >= begin - SAME) & (t <= end + SAME) for t in (self.t, self.blind)
        )  # fmt: skip
        return Sightings(
            self.ids, self.part[keep], self.t[keep], self.state[keep], self.usable[keep], self.blind[blind],
            self.lacks, self.size, self.kind, None if self.z is None else self.z[keep],
        )  # fmt: skip

    def id_at(self, t: float) -> str:
        """Give the id under which it is seen last up to t [s], or else first."""
        return (
            self.ids[self.part[max(int(np.searchsorted(self.t, t + SAME)) - 1, 0)]]
            if len(self.t)
            else self.ids[0]
        )


def of_ids(tracks: Tracks, incomplete: pd.DataFrame | None) -> list[Sightings]:
    """Give what is known of each id. incomplete: rows that lack a value (`Recording.incomplete`), None for none."""
    rows = {} if incomplete is None else {str(i): own for i, own in incomplete.groupby("id", sort=False)}
    return [_of_id(tracks, name, rows.get(name)) for name in dict.fromkeys([*tracks.ids.tolist(), *rows])]


def joined(parts: Sequence[Sightings]) -> Sightings:
    """Give the sightings of one object that is seen under several ids, which follow each other; as large as any."""
    ids = tuple(i for k in parts for i in k.ids)
    whose = np.repeat(np.arange(len(parts)), [len(k.t) for k in parts])
    lacks = ", ".join(c for c in ("x", "y", "heading", "v") if any(c in k.lacks.split(", ") for k in parts))
    length, width = np.max([k.size for k in parts], axis=0).tolist()
    t, state, usable = (
        np.concatenate([getattr(k, name) for k in parts]) for name in ("t", "state", "usable")
    )
    blind = np.sort(np.concatenate([k.blind for k in parts]))
    kind = parts[0].kind if len({k.kind for k in parts}) == 1 else ""
    heights = [np.full(len(k.t), np.nan) if k.z is None else k.z for k in parts]
    z = None if all(k.z is None for k in parts) else np.concatenate(heights)
    return Sightings(ids, whose, t, state, usable, blind, lacks, (length, width), kind, z)


def _of_id(tracks: Tracks, name: str, incomplete: pd.DataFrame | None) -> Sightings:
    t, state, blind = np.empty(0), np.empty((0, 5)), np.empty(0)
    size, kind, z = (np.nan, np.nan), "", None
    if name in tracks.ids:
        n = tracks.index(name)
        repeated = _repeated(tracks, n)
        own, blind = tracks.valid[n] & ~repeated, tracks.t[repeated]
        t, heading, v = tracks.t[own], tracks.heading[n, own], tracks.v[n, own]
        state = np.column_stack(
            [tracks.x[n, own], tracks.y[n, own], heading, v * np.cos(heading), v * np.sin(heading)]
        )
        size, kind = (float(tracks.length[n]), float(tracks.width[n])), str(tracks.kind[n])
        z = None if tracks.z is None else tracks.z[n, own]
    lacks, usable = "", np.ones(len(t), dtype=bool)
    if incomplete is not None:
        rows = incomplete.drop_duplicates("t")
        rows = rows[~np.isin(rows["t"], t)]
        placed = np.isfinite(rows[["x", "y"]].to_numpy(float)).all(axis=1)
        placed &= len(t) + placed.sum() > 1  # a place alone tells no speed
        if not np.isfinite(size[0]):
            size = float(rows["length"].median()), float(rows["width"].median())
        lacks = ", ".join(c for c in ("x", "y", "heading", "v") if not np.isfinite(rows[c]).all())
        seen = t
        t, state, usable = _with_places(t, state, rows[placed])
        z = None if z is None else _at(t, seen, z)
        blind = np.union1d(blind, rows["t"].to_numpy(float)[~placed])
    return Sightings((name,), np.zeros(len(t), dtype=np.intp), t, state, usable, blind, lacks, size, kind, z)


def _at(t: Floats, seen: Floats, z: Floats) -> Floats:
    """The heights z (m,) of the times `seen` (m,) at all times t (n,), NaN at the others."""
    out = np.full(len(t), np.nan)
    out[np.searchsorted(t, seen)] = z
    return out


def _repeated(tracks: Tracks, n: int) -> Bools:
    """Which samples (T,) of an object repeat the place of the one before, while its speed says that it moves."""
    out = np.zeros(len(tracks.t), dtype=bool)
    at = np.flatnonzero(tracks.valid[n])
    same = (np.diff(tracks.x[n, at]) == 0.0) & (np.diff(tracks.y[n, at]) == 0.0)
    out[at[1:]] = same & (np.abs(tracks.v[n, at[1:]]) >= MOVES)
    return out


def _with_places(t: Floats, state: Floats, placed: pd.DataFrame) -> tuple[Floats, Floats, Bools]:
    """Sightings with rows that hold a position and not all else; their velocity is that of the positions around."""
    more = placed["t"].to_numpy(float)
    every, usable = np.concatenate([t, more]), np.repeat([True, False], [len(t), len(more)])
    order = np.argsort(every, kind="stable")
    if not len(more):
        return t, state, usable
    place = np.concatenate([state[:, :2], placed[["x", "y"]].to_numpy(float)])[order]
    late, early = (np.clip(more + sign * WINDOW, every.min(), every.max()) for sign in (1.0, -1.0))
    velocity = np.column_stack([
        (np.interp(late, every[order], p) - np.interp(early, every[order], p)) / np.maximum(late - early, SAME)
        for p in place.T
    ])  # fmt: skip
    moves = np.hypot(*velocity.T) > MOVES
    heading = np.where(moves, np.arctan2(velocity[:, 1], velocity[:, 0]), np.nan)
    heading = np.where(np.isfinite(placed["heading"]), placed["heading"], heading)
    added = np.column_stack([placed[["x", "y"]].to_numpy(float), heading, velocity])
    return every[order], np.concatenate([state, added])[order], usable[order]
