"""Repairs of units and signs: speeds to m/s, headings to radians, y up."""

from __future__ import annotations

import numpy as np

from resim.check.tracks import table_of
from resim.check.units import headings_turn
from resim.core.finding import Finding
from resim.ingest import Tables
from resim.repair.frames import changed, complete, frame_of, rows_of, with_frame
from resim.repair.settings import How


def speed_unit(tables: Tables, finding: Finding, how: How) -> Tables:
    """Give the speeds of the object, or of all, in m/s: divided by the unit's factor."""
    return _scaled(tables, finding, "v")


def heading_unit(tables: Tables, finding: Finding, how: How) -> Tables:
    """Give the headings of the object, or of all, in radians."""
    return _scaled(tables, finding, "heading")


def _scaled(tables: Tables, finding: Finding, column: str) -> Tables:
    frame = frame_of(tables, finding.source)
    values = frame[column].to_numpy(float) / float(finding.details["factor"])
    rows = rows_of(frame, finding.object)
    return with_frame(
        tables, finding.source, changed(frame, rows, finding.code, **{column: values})
    )  # fmt: skip


def mirrored_y(tables: Tables, finding: Finding, how: How) -> Tables:
    """Give the source with y turned; and headings and yaw rates, where the tracks then fit them."""
    frame = frame_of(tables, finding.source)
    whole = table_of(finding.source, frame[complete(frame)], {})
    sign = -1.0 if headings_turn(whole) else 1.0
    values = {"y": -frame["y"].to_numpy(float)}
    values |= {c: sign * frame[c].to_numpy(float) for c in ("heading", "yaw_rate") if c in frame}
    every = np.ones(len(frame), dtype=bool)
    return with_frame(tables, finding.source, changed(frame, every, finding.code, **values))
