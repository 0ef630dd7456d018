"""Bodies: boxes in each other, and sizes that change."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

from resim.core.finding import Source
from resim.core.geometry import Boxes, boxes_overlap
from resim.core.levels import over
from resim.recordings.checks.codes import RankedFinding, found
from resim.recordings.checks.tracks import CheckedTable, Track, runs

DEEP = 0.3
"""Depth [m] from which on two boxes are in each other: what measured positions and sizes may miss."""
LONG = 1.0
"""Time [s] after which it is no collision: struck cars part, or stop."""
MANY, SHARE = 3, 0.1
"""Pairs in each other, and share of the objects in them, from which on nothing of the recording can be judged."""
SIZE = 0.05
"""Change of length or width [m] that is none; a real object keeps its own."""
WIDER = 1.05
"""Times its length that a vehicle is wide when the two are swapped; no vehicle is."""
SHAPELESS = ("pedestrian", "unknown")
"""Kinds that may be wider than long."""
LEAST_LARGEST = {
    "car": ((2.0, 1.0), (26.0, 3.2)),
    "van": ((2.0, 1.0), (26.0, 3.2)),
    "truck": ((2.5, 1.2), (60.0, 4.5)),
    "bus": ((4.0, 1.5), (35.0, 3.2)),
    "trailer": ((0.8, 0.6), (30.0, 4.5)),
    "motorcycle": ((1.0, 0.3), (4.5, 2.2)),
    "bicycle": ((0.8, 0.2), (4.5, 1.8)),
    "pedestrian": ((0.2, 0.15), (3.0, 3.0)),
    "unknown": ((0.1, 0.1), (60.0, 6.0)),
}
"""Longer and shorter side [m] of the least and the largest of each kind, generous. Least: Renault Twizy, 2.34 x 1.24 m
(manufacturer's data); largest: 25.25 x 2.6 m of European combinations (directive 96/53/EC), also of cars and vans, as
recordings call trucks so (NGSIM: cars of 19.8 m), 53.5 m of Australian road trains (National Heavy Vehicle Regulator),
abnormal loads 4.5 m; motorcycles with side-car, cargo bicycles; people with arms and a pram."""
SEEN = 0.5
"""Part of the least sides that a sensor may see."""
MUCH = 0.1
"""Part of the size by which it changes when it matters."""


def overlaps(table: CheckedTable) -> Iterator[RankedFinding]:
    """Give pairs whose boxes are in each other for longer than a collision lasts; where they are many, the table."""
    pairs = list(_pairs_inside(table))
    concerned = {name for one in pairs for name in (one.finding.object, one.other)}
    yield from pairs
    if len(pairs) >= MANY and len(concerned) > SHARE * len({k.id for k in table.tracks}):
        span = min(f.finding.start for f in pairs), max(f.finding.end for f in pairs)
        text = (
            f"{len(pairs)} pairs of boxes overlap, of {len(concerned)} objects: tracks that do not belong "
            "to one time or one frame, or wrong sizes"
        )
        yield found(
            "OVERLAP", table.source, "", span, len(pairs), "pairs", text, limit=MANY, severity="error"
        )


def _pairs_inside(table: CheckedTable) -> Iterator[RankedFinding]:
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
                yield found("OVERLAP", table.source, a.id, span, lasts, "s", text, limit=LONG, other=b.id)


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
        Boxes(p.real, p.imag, a.heading[i], max(a.length - DEEP, 0.01), max(a.width - DEEP, 0.01)),
        Boxes(q.real, q.imag, b.heading[j], max(b.length - DEEP, 0.01), max(b.width - DEEP, 0.01)),
    )
    if a.z is not None and b.z is not None:
        hit &= ~over(a.z[i], b.z[j])
    spans = [(float(common[s]), float(common[e])) for s, e in runs(hit)]
    span = max(spans, key=lambda s: s[1] - s[0], default=None)
    return span if span is not None and span[1] - span[0] >= LONG - 0.5 * step else None


def swapped(source: Source, frame: pd.DataFrame) -> tuple[pd.DataFrame, list[RankedFinding]]:
    """Give vehicles that are wider than long, where most are as one finding of the table; and the table put right.

    One alone may be seen from behind by a sensor: of the SD it is a note, and stays.
    """
    sides = frame[~frame["kind"].isin(SHAPELESS)].groupby("id", sort=False)[["length", "width"]].median()
    wide = sides[sides["width"] > WIDER * sides["length"]]
    if wide.empty:
        return frame, []
    excess = float((wide["width"] / wide["length"]).max())
    span = (float(frame["t"].min()), float(frame["t"].max()))
    most = len(wide) > max(0.5 * len(sides), 1)
    if most:
        text = f"{len(wide)} of {len(sides)} vehicles are wider than long, up to {excess:.1f} times"
        out = [found("SIZE_SWAPPED", source, "", span, excess, "1", text, limit=WIDER)]
    else:
        out = [_wide(source, str(name), frame[frame["id"] == name]) for name in wide.index]
    if most or source == "gt":
        rows = frame["id"].isin(wide.index)
        sides = frame[["length", "width"]]
        frame = frame.assign(
            length=sides["length"].mask(rows, sides["width"]),
            width=sides["width"].mask(rows, sides["length"]),
        )
    return frame, out


def impossible(source: Source, frame: pd.DataFrame) -> list[RankedFinding]:
    """Give objects that are smaller or larger than any of their kind, whichever side is called length; where they are
    many, the table."""
    by_id = frame.groupby("id", sort=False)
    sides = np.sort(by_id[["length", "width"]].median().to_numpy(float), axis=1)[:, ::-1]
    first = by_id["kind"].first()
    names, kinds = first.index.tolist(), first.tolist()
    bounds = np.array([LEAST_LARGEST.get(kind, LEAST_LARGEST["unknown"]) for kind in kinds]).reshape(-1, 2, 2)
    least = bounds[:, 0] * (SEEN if source == "sd" else 1.0)
    times = np.maximum(least / np.maximum(sides, 1e-9), sides / bounds[:, 1]).max(axis=1)
    wrong = np.flatnonzero(times > 1.0).tolist()
    words = [f"{kinds[k]} of {sides[k, 0]:.3g} x {sides[k, 1]:.3g} m" for k in wrong]
    if len(wrong) > MANY:
        span, worst = (float(frame["t"].min()), float(frame["t"].max())), int(times[wrong].argmax())
        text = (
            f"{len(wrong)} of {len(sides)} objects have a size that none of their kind has; "
            f"{names[wrong[worst]]!r} worst, a {words[worst]}"
        )
        return [_impossible(source, "", span, float(times[wrong].max()), text)]
    out = []
    for k, what in zip(wrong, words, strict=True):
        t = frame["t"][frame["id"] == names[k]]
        text = f"is a {what} of impossible size"
        out.append(_impossible(source, str(names[k]), (t.min(), t.max()), float(times[k]), text))
    return out


def _impossible(
    source: Source, name: str, span: tuple[float, float], times: float, text: str
) -> RankedFinding:
    return found("SIZE_IMPOSSIBLE", source, name, span, times, "1", text, limit=1.0)


def _wide(source: Source, name: str, rows: pd.DataFrame) -> RankedFinding:
    length, width = rows["length"].median(), rows["width"].median()
    return found(
        "SIZE_SWAPPED", source, name, (rows["t"].min(), rows["t"].max()), width / length, "1",
        f"is {length:.2f} m long and {width:.2f} m wide", limit=WIDER,
        severity="warning" if source == "gt" else "note", repair=None if source == "gt" else "",
    )  # fmt: skip


def sizes(source: Source, frame: pd.DataFrame) -> Iterator[RankedFinding]:
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
