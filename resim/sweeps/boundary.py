"""What an adaptive sweep found: where its outcome changes, and on which side it is good.

Its points lie where the outcome changes, so that no share, index or mean over them says anything of the ranges: what is
told is of points that were tried, and of the cells between them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
import pandas as pd

from resim.core.errors import InputError
from resim.core.geometry import Bools, Floats
from resim.sweeps.file import SweepBoundary
from resim.sweeps.outcomes.registry import column_of
from resim.sweeps.plans.adaptive import Lattice, Places
from resim.sweeps.points import SweepOutcome, SweepPoints
from resim.sweeps.result import RESUME, SweepResult, limits

ISLANDS = (0.05, 0.1, 0.2)
"""Sizes of islands, as shares of each range, whose probability to be missed is told."""
Span = tuple[int, int]
"""An interval of one parameter, in finest steps of the lattice."""


Ends = tuple[float, float]
"""Low and high of an interval of a parameter, in its unit."""


@dataclass(frozen=True)
class TriedPoint:
    """A point, by the parameters' values, and how many of its seeds are good."""

    at: tuple[float, ...]
    good_seeds: int


@dataclass(frozen=True)
class GoodRange:
    """From an end of a parameter on to a value, or over its whole range (None), all points that were tried are good."""

    parameter: str
    side: Literal["whole", "under", "over"]
    value: float | None
    points: int


@dataclass(frozen=True)
class IslandChance:
    """How likely an island of this size, as a share of each range, is missed."""

    size: float
    missed: float


@dataclass(frozen=True)
class StripChange:
    """Where the outcome changes along the first parameter; below, above: whether it is good there, None at an end."""

    between: Ends
    below: bool | None
    above: bool | None


@dataclass(frozen=True)
class BoundaryStrip:
    """An interval of the second parameter; good: whether the outcome is, where it does not change."""

    at: Ends
    changes: tuple[StripChange, ...]
    good: bool | None


@dataclass(frozen=True)
class BoundaryReport:
    """What is known of the boundary of one recording and build.

    limit: what the outcome's criterion asks for. share: of the seeds of a good point; needed: how many those are. most:
    points there may be. known: whether the cells are as small as asked for. widths: asked for, None for any; finest,
    widest: of the lattice and of the cells, by parameter. cells: ends by parameter. changes: intervals of each
    parameter in which the outcome changes. strips: of two parameters, None of others.
    """

    name: str
    label: str
    limit: str | None
    share: float
    seeds: int
    needed: int
    points: int
    good: int
    most: int
    known: bool
    widths: Mapping[str, float | None]
    finest: Mapping[str, float]
    widest: Mapping[str, float] | None
    cells: tuple[tuple[Ends, ...], ...]
    tried: tuple[TriedPoint, ...]
    changes: Mapping[str, tuple[Ends, ...]]
    ranges: tuple[GoodRange, ...]
    islands: tuple[IslandChance, ...]
    strips: tuple[BoundaryStrip, ...] | None


@dataclass(frozen=True, eq=False)
class _BoundaryCells:
    """Points (K, P) that were tried, which (K,) are good, and the cells (C, P) in which that changes; on a lattice."""

    lattice: Lattice
    names: tuple[str, ...]
    places: Places
    good: Bools
    low: Places
    high: Places

    def span(self, i: int, ends: Span) -> Ends:
        """Give an interval of the i-th parameter in its unit."""
        places = np.zeros((2, len(self.names)), dtype=np.intp)
        places[:, i] = ends
        low, high = _exact(self.lattice.values(places)[:, i])
        return low, high


def boundary(
    swept: SweepResult, rows: pd.DataFrame, points: SweepPoints, outcomes: Sequence[SweepOutcome]
) -> BoundaryReport:
    """Give what is known of the boundary for one recording and build: of its rows, points (K, P), and outcomes.

    Raises InputError where the manifest does not tell of it.
    """
    asked, lattice = swept.file.adaptive, Lattice.over(swept.parameters)
    column, _ = column_of(asked.outcome)
    outcome = next(o for o in outcomes if o.name == column)
    told, names = _boundary_entry(swept, rows), tuple(p.name for p in swept.parameters)
    cells = np.array(told.cells, dtype=float).reshape(-1, len(names), 2)
    places, low, high = (_places(lattice, x) for x in (points.x, cells[:, :, 0], cells[:, :, 1]))
    good_seeds, seeds = outcome.y.sum(axis=1).astype(int), outcome.y.shape[1]
    needed = next(n for n in range(1, seeds + 1) if n / seeds >= asked.share)
    f = _BoundaryCells(lattice, names, places, good_seeds >= needed, low, high)
    finest = (np.array(lattice.high) - np.array(lattice.low)) / lattice.counts
    widest = dict(zip(names, _exact((high - low).max(axis=0) * finest), strict=True)) if len(low) else None
    tried = zip(points.x, good_seeds.tolist(), strict=True)
    return BoundaryReport(
        name=outcome.name, label=outcome.label, limit=limits(swept).get(column.removeprefix("kpi ")),
        share=asked.share, seeds=seeds, needed=needed,
        points=len(places), good=int(f.good.sum()), most=swept.file.points, known=told.known,
        widths={p.name: p.width for p in swept.parameters},
        finest=dict(zip(names, _exact(finest), strict=True)),
        widest=widest,
        cells=tuple(tuple((low, high) for low, high in map(_exact, ends)) for ends in cells),
        tried=tuple(TriedPoint(_exact(x), n) for x, n in tried),
        changes={n: tuple(f.span(i, s) for s in _joined(low[:, i], high[:, i])) for i, n in enumerate(names)},
        ranges=tuple(_ranges(f)),
        islands=tuple(IslandChance(size, lattice.missed(size)) for size in ISLANDS),
        strips=_strips(f) if len(names) == 2 else None,
    )  # fmt: skip


def _boundary_entry(swept: SweepResult, rows: pd.DataFrame) -> SweepBoundary:
    """What the manifest says of the boundary of these rows."""
    pair = (rows["recording"].iloc[0], rows["build"].iloc[0])
    for told in swept.manifest.found():
        if (told.recording, told.build) == pair:
            return told
    problem = f"has no boundary for recording {pair[0]!r} and build {pair[1]!r}"
    raise InputError(swept.folder / "manifest.json", problem, RESUME.format(folder=swept.folder))


def _places(lattice: Lattice, x: Floats) -> Places:
    """Where values (R, P) are on the lattice."""
    low, high = np.array(lattice.low), np.array(lattice.high)
    return np.asarray(np.rint((x - low) / (high - low) * lattice.counts), dtype=np.intp)


def _joined(low: Places, high: Places) -> list[Span]:
    """Intervals (C,) from low to high, those that touch or overlap made one."""
    out: list[Span] = []
    for a, b in sorted(zip(low.tolist(), high.tolist(), strict=True)):
        if out and a <= out[-1][1]:
            out[-1] = (out[-1][0], max(b, out[-1][1]))
        else:
            out.append((a, b))
    return out


def _ranges(f: _BoundaryCells) -> Iterator[GoodRange]:
    """From each end of each parameter, the largest range in which every point that was tried is good; wider than 0."""
    for i, name in enumerate(f.names):
        at, bad, last = f.places[:, i], f.places[~f.good, i], int(f.lattice.counts[i])
        if not len(bad):
            yield GoodRange(name, "whole", None, len(at))
            continue
        sides: tuple[tuple[Literal["under", "over"], Bools, int], ...] = (
            ("under", at < bad.min(), 0), ("over", at > bad.max(), last),
        )  # fmt: skip
        for side, inside, end in sides:
            if not inside.any():
                continue
            limit = int(at[inside].max() if side == "under" else at[inside].min())
            if limit != end:
                value = f.span(i, (limit, limit))[0]
                yield GoodRange(name, side, value, int(inside.sum()))


def _strips(f: _BoundaryCells) -> tuple[BoundaryStrip, ...]:
    """Of two parameters, by intervals of the second: where along the first the outcome changes, and what is beside."""
    cuts = sorted({0, int(f.lattice.counts[1]), *f.low[:, 1].tolist(), *f.high[:, 1].tolist()})
    strips: list[tuple[Span, tuple[StripChange, ...]]] = []
    for b in pairwise(cuts):
        found = _across(f, b)
        if strips and strips[-1][1] == found:
            strips[-1] = ((strips[-1][0][0], b[1]), found)
        else:
            strips.append((b, found))
    return tuple(
        BoundaryStrip(f.span(1, b), found, None if found else _good(f, f.places[:, 1], b))
        for b, found in strips
    )


def _across(f: _BoundaryCells, b: Span) -> tuple[StripChange, ...]:
    """Where along the first parameter the outcome changes, for an interval of the second."""
    there = (f.low[:, 1] <= b[0]) & (f.high[:, 1] >= b[1])
    low, high = f.low[there], f.high[there]

    def beside(a: int, end: int, cells: Bools) -> bool | None:
        """What comes of the points on the side of cells (C,) at place a, that all have the cell beyond in common."""
        if a == end:
            return None
        span = (int(low[cells, 1].min()), int(high[cells, 1].max()))
        return _good(f, np.where(f.places[:, 0] == a, f.places[:, 1], -1), span)

    return tuple(
        StripChange(
            between=f.span(0, (first, last)),
            below=beside(first, 0, low[:, 0] == first),
            above=beside(last, int(f.lattice.counts[0]), high[:, 0] == last),
        )
        for first, last in _joined(low[:, 0], high[:, 0])
    )


def _good(f: _BoundaryCells, at: Places, span: Span) -> bool:
    """Say whether all points (K,) that are in this interval, its ends with it, are good."""
    return bool(f.good[(at >= span[0]) & (at <= span[1])].all())


def _exact(values: Floats) -> tuple[float, ...]:
    """Give numbers (N,) with twelve digits."""
    return tuple(float(f"{v:.12g}") + 0.0 for v in values.tolist())
