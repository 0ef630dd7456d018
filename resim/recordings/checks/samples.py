"""Samples: values that miss, rows that repeat or contradict, holes, values that stand still."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

import numpy as np
import pandas as pd

from resim.core.clock import TICK
from resim.core.finding import Severity, Source
from resim.core.geometry import Floats
from resim.recordings.checks.codes import RankedFinding, found
from resim.recordings.checks.tracks import CheckedTable, Track, runs

VALUES = ("x", "y", "heading", "v")
HOLE = 1.5
"""Usual steps without a sample from which on one is missing; jitter of a sensor stays below."""
SHORT = 0.3
"""Hole [s] that is still interpolated (`Tracks.at`); a longer one is a gap."""
ANOTHER = 1.0
"""Gap [s] after which the pipeline takes the object for another one."""
OFTEN = 0.05
"""Share of an object's samples that may miss before its track is qualified by it."""
WALKING = 1.0
"""Speed [m/s] from which on an object surely moves; what stands has noisy speeds."""
FROZEN_WAY = 0.1
"""Way [m] that the speed claims while the position stays the same to the last digit: data rounded to
centimetres repeat a position by chance only below."""


def missing_values(source: Source, frame: pd.DataFrame) -> Iterator[RankedFinding]:
    """Give, per object, rows in which x, y, heading or v is missing."""
    missing = ~np.isfinite(frame[list(VALUES)].to_numpy(float))
    for name, rows in frame[missing.any(axis=1)].groupby("id", sort=False):
        total = int((frame["id"] == name).sum())
        which = [c for c in VALUES if not np.isfinite(rows[c]).all()]
        text = f"{len(rows)} of {total} rows lack {', '.join(which)}"
        severity: Severity = "warning" if len(rows) > OFTEN * total else "note"
        yield found(
            "MISSING_VALUES", source, str(name), (rows["t"].min(), rows["t"].max()), len(rows), "rows", text,
            limit=max(1.0, OFTEN * total), severity=severity,
        )  # fmt: skip


def duplicates(source: Source, frame: pd.DataFrame) -> Iterator[RankedFinding]:
    """Give, per object, times that stand more than once: the same row, or rows that contradict each other."""
    twice = frame[frame.duplicated(["t", "id"], keep=False)]
    for name, rows in twice.groupby("id", sort=False):
        extra = int(rows.duplicated("t").sum())
        by_time = rows.groupby("t")[list(VALUES)]
        spread = (by_time.max() - by_time.min()).max()  # of those that are there
        differ = [c for c in VALUES if spread[c] > 0.0]
        text = f"{extra} rows are repeated"
        if differ:
            text += f" with other values ({', '.join(f'{c} by up to {spread[c]:.3g}' for c in differ)})"
        repair = "" if differ else None
        yield found(
            "DUPLICATE_SAMPLES", source, str(name), (rows["t"].min(), rows["t"].max()), extra, "rows", text,
            limit=1.0, severity="error" if differ else "warning", repair=repair,
        )  # fmt: skip


def holes(table: CheckedTable, ego: str) -> Iterator[RankedFinding]:
    """Give missing samples and gaps; those that every object there has are the table's."""
    wide: dict[tuple[float, float], list[str]] = defaultdict(list)
    for track in table.tracks:
        for k in np.flatnonzero(np.diff(track.t) > HOLE * table.step):
            wide[round(float(track.t[k]), 6), round(float(track.t[k + 1]), 6)].append(track.id)
    by_object: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for (start, end), names in wide.items():
        there = [k.id for k in table.tracks if k.t[0] < end and k.t[-1] > start]
        for name in [""] if len(names) == len(there) > 1 else names:
            by_object[name].append((start, end))
    samples = {k.id: len(k) for k in table.tracks}
    for name, spans in by_object.items():
        every = samples.get(name, round((table.span[1] - table.span[0]) / table.step))
        yield from _holes(table, name, spans, every, is_ego=name in ("", ego))


def _holes(
    table: CheckedTable, name: str, spans: list[tuple[float, float]], samples: int, *, is_ego: bool
) -> Iterator[RankedFinding]:
    """The gaps of one object one by one, its short holes together."""
    who = "no object has a sample" if not name else "no sample"
    short = [(a, b) for a, b in spans if b - a <= SHORT + 0.5 * table.step]
    for a, b in spans:
        if (a, b) not in short:
            grave = is_ego and b - a > ANOTHER + TICK
            yield found(
                "GAP", table.source, name, (a, b), b - a, "s", f"{who} from {a:.2f} to {b:.2f} s ({b - a:.2f} s)",
                limit=SHORT, severity="error" if grave else "warning",
            )  # fmt: skip
    if short:
        lost = sum(max(round((b - a) / table.step) - 1, 1) for a, b in short)
        text = f"{lost} samples missing in {len(short)} places, the longest hole {max(b - a for a, b in short):.2f} s"
        yield found(
            "MISSING_SAMPLES", table.source, name, (short[0][0], short[-1][1]), lost, "samples", text,
            limit=max(1.0, OFTEN * samples), severity="warning" if lost > OFTEN * samples else "note",
        )  # fmt: skip


def repeated(table: CheckedTable) -> tuple[CheckedTable, list[RankedFinding]]:
    """Give positions that stand still to the last digit while the speed says otherwise; and the table without."""
    out, tracks = [], []
    for track in table.tracks:
        way = _way(track)
        frozen = frozen_runs(track)
        keep = np.ones(len(track), dtype=bool)
        for a, b in frozen:
            keep[a + 1 : b + 2] = False
        tracks.append(track.at(keep))
        if frozen:
            out.append(_frozen(table, track, frozen, way))
    return table.replaced(tracks), out


def frozen_runs(track: Track) -> list[tuple[int, int]]:
    """Give first and last step of each run in which the position stands still and the speed says otherwise."""
    way = _way(track)
    same = (np.diff(track.p) == 0.0) & (way > WALKING * np.diff(track.t))
    return [(a, b) for a, b in runs(same) if way[a : b + 1].sum() > FROZEN_WAY]


def _way(track: Track) -> Floats:
    """Way [m] of each step by its speeds."""
    return np.asarray(0.5 * np.abs(track.v[1:] + track.v[:-1]) * np.diff(track.t))


def _frozen(table: CheckedTable, track: Track, frozen: list[tuple[int, int]], way: Floats) -> RankedFinding:
    count = sum(b - a + 1 for a, b in frozen)
    longest = max(frozen, key=lambda run: float(way[run[0] : run[1] + 1].sum()))
    lost = float(way[longest[0] : longest[1] + 1].sum())
    text = (
        f"{count} samples repeat the previous position although the speed says that it moves; the longest stands "
        f"{track.t[longest[1] + 1] - track.t[longest[0]]:.2f} s, {lost:.2f} m at its speed"
    )
    span = (track.t[frozen[0][0]], track.t[frozen[-1][1] + 1])
    return found("REPEATED_SAMPLES", table.source, track.id, span, count, "samples", text, limit=1.0)
