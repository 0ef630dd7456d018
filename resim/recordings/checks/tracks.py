"""What the checks look at: each object's complete samples in order of time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from resim.core.finding import Source
from resim.core.geometry import Bools, Floats

Complex = NDArray[np.complex128]
Ints = NDArray[np.intp]
Values = NDArray[np.floating[Any]] | NDArray[np.complexfloating[Any, Any]]

PEDESTRIAN = "pedestrian"
LONE = 1.0
"""Time step [s] of a table in which no object has two samples: there is nothing that it could decide."""

FINEST = 1e-4
"""Least time step [s] by which windows are laid: samples closer to each other are no measurement."""


@dataclass(frozen=True, eq=False)
class Track:
    """One object (or one piece of it) at K times: t (K,) s, p (K,) x + iy m, heading (K,) rad, v (K,).

    z: (K,) m, height of the road, NaN where it is not known; None where no row has any.
    """

    id: str
    kind: str
    length: float
    width: float
    t: Floats
    p: Complex
    heading: Floats
    v: Floats
    z: Floats | None = None

    def __len__(self) -> int:
        return len(self.t)

    def at(self, keep: Bools | Ints | slice) -> Track:
        """Give the samples chosen."""
        z = None if self.z is None else self.z[keep]
        return replace(self, t=self.t[keep], p=self.p[keep], heading=self.heading[keep], v=self.v[keep], z=z)

    def split(self, after: list[int]) -> list[Track]:
        """Give the pieces between the samples after which it is cut."""
        ends = [0, *(k + 1 for k in after), len(self)]
        return [self.at(slice(a, b)) for a, b in pairwise(ends) if b > a]

    def velocity(self) -> Complex:
        """Give the velocity (K,) [m/s] that heading and speed tell."""
        return np.asarray(self.v * np.exp(1j * self.heading))


@dataclass(frozen=True, eq=False)
class CheckedTable:
    """One source: its tracks, its usual time step [s], and for the SD the GT id of each object."""

    source: Source
    step: float
    tracks: tuple[Track, ...]
    gt_id: dict[str, str]

    def replaced(self, tracks: list[Track]) -> CheckedTable:
        """Give the table with other tracks."""
        return replace(self, tracks=tuple(tracks))

    def shaped(self, **change: Any) -> CheckedTable:
        """Give the table with every track changed: each value is a function of the track."""
        return self.replaced([replace(k, **{n: f(k) for n, f in change.items()}) for k in self.tracks])

    @property
    def span(self) -> tuple[float, float]:
        """First and last time [s]."""
        times = [(k.t[0], k.t[-1]) for k in self.tracks if len(k)]
        return (min(a for a, _ in times), max(b for _, b in times)) if times else (np.nan, np.nan)

    def span_of(self, name: str) -> tuple[float, float]:
        """Give the first and last time [s] of an object, or of the table where it has no such object."""
        own = [k for k in self.tracks if k.id == name]
        return (own[0].t[0], own[-1].t[-1]) if own else self.span


def table_of(
    source: Source, frame: pd.DataFrame, gt_id: dict[str, str], *, incomplete: bool = False
) -> CheckedTable:
    """Give the complete rows, or all, by object and time; of rows at one time the first."""
    whole = frame
    if not incomplete:
        whole = frame[np.isfinite(frame[["x", "y", "heading", "v"]].to_numpy(float)).all(axis=1)]
    whole = whole.drop_duplicates(["t", "id"]).sort_values("t", kind="stable")
    tracks = [_track(str(name), rows) for name, rows in whole.groupby("id", sort=False)]
    steps = np.concatenate([np.zeros(0), *(np.diff(k.t) for k in tracks)])
    return CheckedTable(
        source, max(float(np.median(steps)), FINEST) if len(steps) else LONE, tuple(tracks), gt_id
    )


def _track(name: str, rows: pd.DataFrame) -> Track:
    t, x, y, heading, v = (rows[c].to_numpy(float) for c in ("t", "x", "y", "heading", "v"))
    return Track(
        id=name, kind=str(rows["kind"].iloc[0]), length=float(rows["length"].median()),
        width=float(rows["width"].median()), t=t, p=x + 1j * y, heading=heading, v=v,
        z=rows["z"].to_numpy(float) if "z" in rows else None,
    )  # fmt: skip


def medians(around: Values, inside: Bools) -> Values:
    """Give the median of those inside of each row (K, W), NaN of none; complex values (x + iy) have it by part."""
    one = _medians(np.where(inside, around.real, np.nan))
    return one + 1j * _medians(np.where(inside, around.imag, np.nan)) if np.iscomplexobj(around) else one


def _medians(values: Floats) -> Floats:
    """As `nanmedian` by row, of many short rows much quicker."""
    ordered, known = np.sort(values, axis=1), (~np.isnan(values)).sum(axis=1)
    row = np.arange(len(values))
    return np.asarray(0.5 * (ordered[row, np.maximum(known - 1, 0) // 2] + ordered[row, known // 2]))


def runs(mask: Bools) -> list[tuple[int, int]]:
    """Give first and last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def longest_run(mask: Bools, t: Floats) -> tuple[float, float] | None:
    """Give start and end [s] of the longest run of True, None where there is none."""
    spans = [(float(t[a]), float(t[b])) for a, b in runs(mask)]
    return max(spans, key=lambda s: s[1] - s[0]) if spans else None
