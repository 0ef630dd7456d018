"""Repairs of identity: an id of its own for the second object, ids changed back, broken tracks rejoined."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from resim.core.finding import Finding
from resim.core.geometry import Bools
from resim.core.objects import GAP, successions
from resim.core.schema import GT_ID
from resim.core.tracks import Tracks
from resim.recordings import RecordingTables
from resim.recordings.checks.matching import NEAREST, beside
from resim.recordings.repairs.frames import (
    changed,
    complete,
    frame_of,
    marked,
    new_id,
    rows_of,
    table,
    with_frame,
    with_gt_id,
)
from resim.recordings.repairs.settings import RepairOptions


def id_reused(tables: RecordingTables, finding: Finding, how: RepairOptions) -> RecordingTables:
    """Give the object from the end of the hole on an id of its own; in the SD, the GT object on which it lies.

    The last row before the hole is marked, too: that the track ends there, only the repair says.
    """
    tables = with_gt_id(tables)
    frame = frame_of(tables, finding.source)
    later = rows_of(frame, finding.object) & (
        frame["t"].to_numpy(float) > 0.5 * (finding.start + finding.end)
    )
    before = rows_of(frame, finding.object) & ~later
    last = before & (frame["t"].to_numpy(float) == frame.loc[before, "t"].max())
    tables = with_frame(tables, finding.source, marked(frame, last, finding.code))
    name = new_id(tables, finding.object)
    tables = _renamed(tables, finding, later, name)
    if finding.source == "sd":
        frame = frame_of(tables, "sd")
        frame = changed(frame, rows_of(frame, name), finding.code, gt_id=_lies_on(tables, name))
        tables = with_frame(tables, "sd", frame)
    return tables


def ego_detection(tables: RecordingTables, finding: Finding, how: RepairOptions) -> RecordingTables:
    """Give the sensor's object on the EGO the EGO's id as its GT id."""
    tables = with_gt_id(tables)
    frame = frame_of(tables, "sd")
    rows = rows_of(frame, finding.object)
    return with_frame(tables, "sd", changed(frame, rows, finding.code, gt_id=str(finding.details["other"])))


def id_switch(tables: RecordingTables, finding: Finding, how: RepairOptions) -> RecordingTables:
    """Give both objects their ids back from the switch on."""
    tables = with_gt_id(tables)
    other = str(finding.details["other"])
    frame = frame_of(tables, finding.source)
    late = frame["t"].to_numpy(float) > finding.start - 1e-6
    swap = {finding.object: other, other: finding.object}
    names = frame["id"].map(lambda i: swap.get(i, i)).to_numpy()
    rows = late & frame["id"].isin(list(swap)).to_numpy()
    tables = with_frame(tables, finding.source, changed(frame, rows, finding.code, id=names))
    return _one_gt_id(tables, finding.code)


def track_broken(tables: RecordingTables, finding: Finding, how: RepairOptions) -> RecordingTables:
    """Give both parts the first's id, where judging takes them for one, too. What named the other names the whole."""
    first, other = finding.object, str(finding.details["other"])
    given, tables = tables, with_gt_id(tables)
    frame = frame_of(tables, finding.source)
    if not {first, other} <= set(frame["id"]) or _both_known(frame, first, other):
        return given
    if not _one(frame, first, other, tables.settings.ego):
        return given
    tables = _renamed(tables, finding, rows_of(frame, other), first)
    if finding.source == "sd":
        return _one_gt_id(tables, finding.code)
    if tables.sd is None:
        return tables
    named = (tables.sd[GT_ID] == other).to_numpy()
    return replace(
        tables, sd=changed(tables.sd, named, finding.code, gt_id=np.full(len(named), first, object))
    )


def _one(frame: pd.DataFrame, first: str, other: str, ego: str) -> bool:
    """Whether judging takes the one for the other, of all whose tracks begin or end about then; the EGO for nobody."""
    names = frame[GT_ID].mask(frame[GT_ID] == "", frame["id"]) if GT_ID in frame else frame["id"]
    own = frame[complete(frame) & (names != ego).to_numpy()].drop_duplicates(["t", "id"])
    times = own.groupby("id", sort=False)["t"].agg(["min", "max"])
    if not {first, other} <= set(times.index):
        return False
    spans = times.to_numpy(float)
    at = times.index.get_indexer(pd.Index([first, other]))
    about = (spans >= spans[at[0], 1] - GAP) & (spans <= spans[at[1], 0] + GAP)
    near = times.index[about.any(axis=1)]
    tracks = Tracks.from_frame(own[own["id"].isin(near)].sort_values("t", kind="stable"))
    return (first, other) in successions(tracks)


def _renamed(tables: RecordingTables, finding: Finding, rows: Bools, name: str) -> RecordingTables:
    frame = frame_of(tables, finding.source)
    names = np.full(len(frame), name, dtype=object)
    return with_frame(tables, finding.source, changed(frame, rows, finding.code, id=names))


def _both_known(frame: pd.DataFrame, first: str, other: str) -> bool:
    """Whether the ground truth says that they are two."""
    if GT_ID not in frame:
        return False
    a, b = (str(frame.loc[rows_of(frame, name), GT_ID].iloc[0]) for name in (first, other))
    return bool(a and b and a != b)


def _one_gt_id(tables: RecordingTables, code: str) -> RecordingTables:
    """Each SD object with one GT id, the first that its rows have."""
    if tables.sd is None or GT_ID not in tables.sd:
        return tables
    known = tables.sd[tables.sd[GT_ID] != ""].drop_duplicates("id").set_index("id")[GT_ID]
    given = tables.sd["id"].map(known).fillna("").to_numpy(object)
    other = (tables.sd[GT_ID] != given).to_numpy()
    frame = marked(tables.sd.assign(**{GT_ID: given}), other, code)
    return replace(tables, sd=frame)


def _lies_on(tables: RecordingTables, name: str) -> np.ndarray:
    """The GT id (K,) of the object's rows: of the object nearest in the median, "" where none is near."""
    frame = frame_of(tables, "sd")
    best, near = "", NEAREST
    for own in (k for k in table(tables, "sd").tracks if k.id == name):
        for truth in table(tables, "gt").tracks:
            pair = beside(own, truth)
            far = np.inf if pair is None else float(np.median(np.hypot(pair.along, pair.across)))
            if far < near:
                best, near = truth.id, far
    return np.full(len(frame), best, dtype=object)
