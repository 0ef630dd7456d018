"""Repairs of rows: their order, and doubles."""

from __future__ import annotations

import numpy as np

from resim.core.finding import Finding
from resim.core.schema import TOLD
from resim.recordings import RecordingTables
from resim.recordings.repairs.frames import (
    frame_of,
    kept,
    marked,
    rows_of,
    with_frame,
)
from resim.recordings.repairs.settings import RepairOptions


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
