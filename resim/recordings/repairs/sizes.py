"""Repairs of sizes: those that change, and length and width that are swapped."""

from __future__ import annotations

import numpy as np
import pandas as pd

from resim.core.finding import Finding
from resim.recordings import RecordingTables
from resim.recordings.checks.bodies import SHAPELESS
from resim.recordings.repairs.frames import (
    changed,
    frame_of,
    resized,
    rows_of,
    with_frame,
)
from resim.recordings.repairs.settings import RepairOptions


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
