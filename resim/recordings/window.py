"""The part of a long recording that one EGO drove."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from resim.core.errors import InputError

_TICK = 1e-6  # s; times closer than this are one


def cut_window(
    frame: pd.DataFrame, source: Path, *, ego: str, start: float | None, end: float | None
) -> tuple[pd.DataFrame, float]:
    """Give the rows from start to end [s], their times shifted to begin at 0, and the original start [s].

    frame: track table. Without start or end the window reaches as far as the EGO is there; the EGO must be
    there in all of it, other objects may be in part. Raises InputError.
    """
    if ego not in frame["id"].to_numpy():
        known = ", ".join(frame["id"].drop_duplicates().head(20))
        raise InputError(source, f"ego {ego!r} was not found; the file has {known}", "Name one of them.")
    own = frame.loc[frame["id"] == ego, "t"].to_numpy()
    first, last = own.min(), own.max()
    start, end = first if start is None else start, last if end is None else end
    if not (first - _TICK <= start < end <= last + _TICK):
        there, asked = f"from {first:g} to {last:g} s", f"{start:g} to {end:g} s"
        problem = f"ego {ego!r} is present {there}, the requested window is {asked}"
        raise InputError(source, problem, "Choose a start and an end within its span.")
    rows = frame[(frame["t"] >= start - _TICK) & (frame["t"] <= end + _TICK)]
    times, seen = np.unique(rows["t"]), rows.loc[rows["id"] == ego, "t"]
    if len(gap := np.setdiff1d(times, seen)):
        problem = f"ego {ego!r} is missing at t {gap[0]:g} s ({len(gap)} of {len(times)} times)"
        raise InputError(source, problem, "Choose a window in which it is always present.")
    origin = float(times[0])
    return rows.assign(t=np.round(rows["t"] - origin, 9)), origin
