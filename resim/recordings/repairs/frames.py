"""Track tables while they are repaired: rows keep their label, changed ones are marked, and changes are counted."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from resim.core.finding import Source
from resim.core.geometry import Bools, unwrap_angle
from resim.core.schema import GT_ID, REPAIRED, TOLD
from resim.recordings import RecordingTables
from resim.recordings.checks.tracks import CheckedTable, Track, table_of
from resim.recordings.tables import VALUES

SOURCES: tuple[Source, ...] = ("gt", "sd")


@dataclass(frozen=True)
class Count:
    """Rows that a repair changed, added and removed."""

    changed: int = 0
    added: int = 0
    removed: int = 0

    def __add__(self, other: Count) -> Count:
        return Count(
            self.changed + other.changed, self.added + other.added, self.removed + other.removed
        )  # fmt: skip

    @property
    def samples(self) -> int:
        """All of them."""
        return self.changed + self.added + self.removed


def frame_of(tables: RecordingTables, source: Source) -> pd.DataFrame:
    """Give the table of the source."""
    frame = tables.gt if source == "gt" else tables.sd
    if frame is None:
        raise ValueError("the recording has no sensor data")
    return frame


def with_frame(tables: RecordingTables, source: Source, frame: pd.DataFrame) -> RecordingTables:
    """Give the tables with another one for the source."""
    return replace(tables, gt=frame) if source == "gt" else replace(tables, sd=frame)


def numbered(tables: RecordingTables, start: int) -> RecordingTables:
    """Give the tables with their rows numbered from start on, and a column for the marks."""
    out = tables
    for source in SOURCES:
        if source == "gt" or tables.sd is not None:
            frame = frame_of(tables, source)
            frame = frame.set_axis(pd.RangeIndex(start, start + len(frame)), axis=0)
            out = with_frame(out, source, frame if REPAIRED in frame else frame.assign(**{REPAIRED: ""}))
    return out


def marked(frame: pd.DataFrame, rows: ArrayLike, code: str) -> pd.DataFrame:
    """Give the table with the code in the marks of these rows (K,), after those that they have."""
    marks = frame[REPAIRED].to_numpy(object).copy()
    for k in np.flatnonzero(rows):
        if code not in marks[k].split():
            marks[k] = f"{marks[k]} {code}".strip()
    return frame.assign(**{REPAIRED: marks})


def changed(frame: pd.DataFrame, rows: Bools, code: str, **values: ArrayLike) -> pd.DataFrame:
    """Give the table with other values (K,) in these rows, marked where one really is another."""
    rows, out = np.asarray(rows), {}
    other = np.zeros(len(frame), dtype=bool)
    for column, new in values.items():
        old = frame[column].to_numpy()
        out[column] = np.where(rows, new, old)
        same = (out[column] == old) | (pd.isna(out[column]) & pd.isna(old))
        other |= ~same
    return marked(frame.assign(**out), other, code)


def resized(frame: pd.DataFrame, rows: Bools, code: str, **values: ArrayLike) -> pd.DataFrame:
    """Give the table with other sizes (K,) in these rows, as `changed`, and those that they had kept as told."""
    after = changed(frame, rows, code, **values)
    return kept(after, (after[list(TOLD)] != frame[list(TOLD)]).any(axis=1).to_numpy(), frame[list(TOLD)])


def kept(frame: pd.DataFrame, rows: Bools, sides: pd.DataFrame) -> pd.DataFrame:
    """Give the table with these sizes (K, 2) kept as told in these rows (K,), where none larger is."""
    if not rows.any():
        return frame
    before = {name: frame[name].to_numpy(float) if name in frame else np.nan for name in TOLD.values()}
    told = {name: np.fmax(before[name], np.where(rows, sides[side], np.nan)) for side, name in TOLD.items()}
    return frame.assign(**told)


def inserted(frame: pd.DataFrame, rows: pd.DataFrame, after: Iterable[int]) -> pd.DataFrame:
    """Give the table with more rows; a table in order of time stays so, else each stands after the row with that
    label."""
    if not len(rows):
        return frame
    by_time = bool((np.diff(frame["t"].to_numpy(float)) >= 0.0).all())
    place = pd.Series(np.arange(len(frame), dtype=float), index=frame.index)
    new = rows.set_axis(pd.RangeIndex(frame.index.max() + 1, frame.index.max() + 1 + len(rows)), axis=0)
    order = np.concatenate([place.to_numpy(), place.loc[list(after)].to_numpy() + 0.5])
    out = pd.concat([frame, new]).iloc[np.argsort(order, kind="stable")]
    return out.sort_values("t", kind="stable") if by_time else out


def counted(before: RecordingTables, after: RecordingTables) -> Count:
    """Give the rows that changed: their marks, or where nothing else did, their place in the file."""
    out = Count()
    for source in SOURCES:
        if source == "sd" and before.sd is None:
            continue
        old, new = frame_of(before, source), frame_of(after, source)
        both = old.index.intersection(new.index)
        count = Count(
            int((old.loc[both, REPAIRED] != new.loc[both, REPAIRED]).sum()),
            len(new.index.difference(old.index)), len(old.index.difference(new.index)),
        )  # fmt: skip
        if not count.samples:
            count = Count(changed=int((old.index.to_numpy() != new.index.to_numpy()).sum()))
        out += count
    return out


def rows_of(frame: pd.DataFrame, name: str) -> Bools:
    """Say which rows (K,) are the object's, all where the name is empty."""
    if not name:
        return np.ones(len(frame), dtype=bool)
    return (frame["id"] == name).to_numpy()


def complete(frame: pd.DataFrame) -> Bools:
    """Say which rows (K,) have every value."""
    return np.asarray(np.isfinite(frame[list(VALUES)].to_numpy(float)).all(axis=1))


def table(tables: RecordingTables, source: Source) -> CheckedTable:
    """Give the source as the checks look at it, headings unwrapped."""
    frame = frame_of(tables, source)
    gt_id = frame.groupby("id", sort=False)[GT_ID].first().to_dict() if GT_ID in frame else {}
    whole = table_of(source, frame, {str(k): str(v) for k, v in gt_id.items()})
    return whole.shaped(heading=lambda k: unwrap_angle(k.heading))


def track(frame: pd.DataFrame, rows: Bools) -> tuple[Track, pd.Index] | None:
    """Give the complete ones of one object's rows (K,) in order of time, headings unwrapped, and their labels.

    A time that is a duplicate counts once. None where there is no such row.
    """
    own = frame[rows & complete(frame)].drop_duplicates("t").sort_values("t", kind="stable")
    if not len(own):
        return None
    (one,) = table_of("gt", own, {}).tracks
    return replace(one, heading=unwrap_angle(one.heading)), own.index


def new_id(tables: RecordingTables, name: str) -> str:
    """Give an id that no object has, made of this one."""
    known = {str(i) for source in SOURCES for i in _ids(tables, source)}
    return next(free for k in range(2, len(known) + 3) if (free := f"{name}_{k}") not in known)


def _ids(tables: RecordingTables, source: Source) -> Iterable[str]:
    return [] if source == "sd" and tables.sd is None else frame_of(tables, source)["id"].unique()


def with_gt_id(tables: RecordingTables) -> RecordingTables:
    """Give the tables with `gt_id` in the SD: written out before ids of the GT change."""
    if tables.sd is None or GT_ID in tables.sd:
        return tables
    known = tables.sd["id"].isin(tables.gt["id"])
    return replace(tables, sd=tables.sd.assign(**{GT_ID: tables.sd["id"].where(known, "")}))
