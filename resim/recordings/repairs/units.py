"""Repairs of units and signs: speeds to m/s, headings to radians, y up."""

from __future__ import annotations

import numpy as np

from resim.core.finding import Finding
from resim.core.geometry import wrap_angle
from resim.recordings import RecordingTables
from resim.recordings.checks.tracks import table_of
from resim.recordings.checks.units import headings_turn
from resim.recordings.repairs.frames import changed, complete, frame_of, rows_of, with_frame
from resim.recordings.repairs.settings import RepairOptions


def speed_unit(tables: RecordingTables, finding: Finding, how: RepairOptions) -> RecordingTables:
    """Give the speeds of the object, or of all, in m/s: divided by the unit's factor."""
    frame = frame_of(tables, finding.source)
    values = frame["v"].to_numpy(float) / float(finding.details["factor"])
    rows = rows_of(frame, finding.object)
    return with_frame(tables, finding.source, changed(frame, rows, finding.code, v=values))


def heading(tables: RecordingTables, finding: Finding, how: RepairOptions) -> RecordingTables:
    """Give the headings of the object, or of all, in radians, anticlockwise from +x."""
    frame, d = frame_of(tables, finding.source), finding.details
    values = float(d["sign"]) * frame["heading"].to_numpy(float) / float(d["factor"]) + float(d["offset"])
    rows = rows_of(frame, finding.object)
    if finding.code != "HEADING_UNIT":
        values = wrap_angle(values)
    return with_frame(tables, finding.source, changed(frame, rows, finding.code, heading=values))


def mirrored_y(tables: RecordingTables, finding: Finding, how: RepairOptions) -> RecordingTables:
    """Give the source with y turned; and headings and yaw rates, where the tracks then fit them."""
    frame = frame_of(tables, finding.source)
    whole = table_of(finding.source, frame[complete(frame)], {})
    sign = -1.0 if headings_turn(whole) else 1.0
    values = {"y": -frame["y"].to_numpy(float)}
    values |= {c: sign * frame[c].to_numpy(float) for c in ("heading", "yaw_rate") if c in frame}
    every = np.ones(len(frame), dtype=bool)
    return with_frame(tables, finding.source, changed(frame, every, finding.code, **values))
