"""Bodies: boxes in each other, and sizes that change."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

from resim.check.codes import Found, found
from resim.check.tracks import Table, Track, runs
from resim.core.finding import Source
from resim.core.geometry import boxes_overlap

DEEP = 0.3
"""Depth [m] from which on two boxes are in each other: what measured positions and sizes may miss."""
LONG = 1.0
"""Time [s] after which it is no collision: struck cars part, or stop."""
SIZE = 0.05
"""Change of length or width [m] that is none; a real object keeps its own."""
MUCH = 0.1
"""Part of the size by which it changes when it matters."""


def overlaps(table: Table) -> Iterator[Found]:
    """Give pairs whose boxes are in each other for longer than a collision lasts."""
    tracks = sorted((k for k in table.tracks if len(k) > 1), key=lambda k: k.t[0])
    boxes = [_bounds(k) for k in tracks]
    for n, a in enumerate(tracks):
        for b, (low, high) in zip(tracks[n + 1 :], boxes[n + 1 :], strict=True):
            if b.t[0] > a.t[-1]:
                break
            meets = (low[0] < boxes[n][1][0]) and (low[1] < boxes[n][1][1])
            if not meets or high[0] < boxes[n][0][0] or high[1] < boxes[n][0][1] or a.id == b.id:
                continue
            if (span := _inside(a, b, table.step)) is not None:
                text = f"is in {b.id!r} by more than {DEEP} m from {span[0]:.2f} to {span[1]:.2f} s"
                lasts = span[1] - span[0]
                yield found("OVERLAP", table.source, a.id, span, lasts, "s", text, limit=LONG)


def _bounds(track: Track) -> tuple[tuple[float, float], tuple[float, float]]:
    """Corners of the area that the box sweeps."""
    r = 0.5 * float(np.hypot(track.length, track.width))
    x, y = track.p.real, track.p.imag
    return (x.min() - r, y.min() - r), (x.max() + r, y.max() + r)


def _inside(a: Track, b: Track, step: float) -> tuple[float, float] | None:
    """Start and end [s] of the longest time in which the boxes, DEEP smaller, overlap; None under LONG."""
    common, i, j = np.intersect1d(np.round(a.t, 6), np.round(b.t, 6), return_indices=True)
    if len(common) < 2:
        return None
    reach = 0.5 * (np.hypot(a.length, a.width) + np.hypot(b.length, b.width))
    near = np.abs(a.p[i] - b.p[j]) < reach
    if not near.any():
        return None
    i, j, common = i[near], j[near], common[near]
    p, q = a.p[i], b.p[j]
    hit = boxes_overlap(
        p.real, p.imag, a.heading[i], max(a.length - DEEP, 0.01), max(a.width - DEEP, 0.01),
        q.real, q.imag, b.heading[j], max(b.length - DEEP, 0.01), max(b.width - DEEP, 0.01),
    )  # fmt: skip
    spans = [(float(common[s]), float(common[e])) for s, e in runs(hit)]
    span = max(spans, key=lambda s: s[1] - s[0], default=None)
    return span if span is not None and span[1] - span[0] >= LONG - 0.5 * step else None


def sizes(source: Source, frame: pd.DataFrame) -> Iterator[Found]:
    """Give objects whose length, width or kind is not the same in all rows."""
    by_id = frame.groupby("id", sort=False)
    sides = by_id[["length", "width"]]
    spread = sides.max() - sides.min()
    kinds = by_id["kind"].nunique()
    for name in spread.index[(spread.max(axis=1) > SIZE) | (kinds > 1)]:
        rows = frame[frame["id"] == name]
        other = (rows[["length", "width", "kind"]] != rows[["length", "width", "kind"]].iloc[0]).any(axis=1)
        changes = {c: float(rows[c].max() - rows[c].min()) for c in ("length", "width")}
        parts = [
            f"{c} from {rows[c].min():.2f} to {rows[c].max():.2f} m" for c, by in changes.items() if by > SIZE
        ]
        if kinds[name] > 1:
            parts.append(f"kind among {', '.join(rows['kind'].unique())}")
        share = max(by / float(rows[c].median()) for c, by in changes.items())
        text = f"{'; '.join(parts)}, in {int(other.sum())} of {len(rows)} rows other than in its first"
        t = rows["t"][other]
        yield found(
            "SIZE_CHANGES", source, str(name), (t.min(), t.max()), max(changes.values()), "m", text,
            limit=SIZE, severity="warning" if share > MUCH or kinds[name] > 1 else "note",
        )  # fmt: skip
