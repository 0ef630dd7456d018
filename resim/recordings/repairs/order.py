"""Repairs of rows: their order, doubles, and sizes that change."""

from __future__ import annotations

import numpy as np
import pandas as pd

from resim.core.finding import Finding
from resim.recordings import RecordingTables
from resim.recordings.checks.bodies import SHAPELESS
from resim.recordings.repairs.frames import (
    changed,
    frame_of,
    kept,
    marked,
    resized,
    rows_of,
    with_frame,
)
from resim.recordings.repairs.settings import RepairOptions
from resim.recordings.tables import TOLD


def time_backwards(tables: RecordingTables, finding: Finding, how: RepairOptions) -> RecordingTables:
    """Give the object's rows, or everyone's, in order of time, in the places of the file that they have."""
    frame = frame_of(tables, finding.source)
    place = np.arange(len(frame))
    names = [finding.object] if finding.object else list(dict.fromkeys(frame["id"]))
    t = frame["t"].to_numpy(float)
    for name in names:
        own = np.flatnonzero(rows_of(frame, name))
        place[own] = own[np.argsort(t[own], kind="stable")]
    frame = frame.iloc[place]
    if not finding.object:  # the file was in order of time before it was in none
        frame = frame.sort_values("t", kind="stable")
    return with_frame(tables, finding.source, frame)


def duplicate_samples(tables: RecordingTables, finding: Finding, how: RepairOptions) -> RecordingTables:
    """Give the first of the object's rows at each time; it is marked, and keeps the sizes that the others told."""
    frame = frame_of(tables, finding.source)
    own = rows_of(frame, finding.object)
    twice = own & frame.duplicated(["t", "id"], keep=False).to_numpy()
    again = own & frame.duplicated(["t", "id"]).to_numpy()
    sides = frame[list(TOLD)]
    largest = sides.groupby([frame["t"], frame["id"]], sort=False).transform("max")
    larger = twice & (largest > sides).any(axis=1).to_numpy()
    frame = kept(marked(frame, twice, finding.code), larger, largest)
    return with_frame(tables, finding.source, frame[~again])


def size_changes(tables: RecordingTables, finding: Finding, how: RepairOptions) -> RecordingTables:
    """Give all rows of the object its median length and width and its most frequent kind; what they told is kept."""
    frame = frame_of(tables, finding.source)
    own = rows_of(frame, finding.object)
    values = {c: np.where(own, _middle(frame.loc[own, c]), frame[c]) for c in ("length", "width")}
    kind = frame.loc[own, "kind"].value_counts(sort=True).index[0]
    values["kind"] = np.where(own, kind, frame["kind"])
    return with_frame(tables, finding.source, resized(frame, own, finding.code, **values))


def size_swapped(tables: RecordingTables, finding: Finding, how: RepairOptions) -> RecordingTables:
    """Give the object, or every object that is wider than long, its width for its length.

    Where most are, length and width are surely swapped; of a single object what was told is kept.
    """
    frame = frame_of(tables, finding.source)
    wide = (frame["width"] > frame["length"]).to_numpy() & ~frame["kind"].isin(SHAPELESS).to_numpy()
    rows = rows_of(frame, finding.object) & wide
    values = {"length": frame["width"].to_numpy(), "width": frame["length"].to_numpy()}
    swap = resized if finding.object else changed
    return with_frame(tables, finding.source, swap(frame, rows, finding.code, **values))


def _middle(values: pd.Series) -> float:
    """The median that is one of the values: half a row more of one size makes no third one."""
    return float(np.quantile(values.to_numpy(float), 0.5, method="lower"))
