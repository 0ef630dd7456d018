"""The part of a long recording that one EGO drove, and what is there beyond it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from resim.core.clock import TICK
from resim.core.errors import InputError
from resim.core.geometry import Floats


def window_of(
    own: Floats, source: Path, *, ego: str, start: float | None, end: float | None
) -> tuple[float, float]:
    """Give the window [s]: as far as the EGO is there, where no start or end is given. own: its times.

    Raises InputError for a window that is not within them.
    """
    first, last = float(own.min()), float(own.max())
    begin, until = first if start is None else start, last if end is None else end
    if not first - TICK <= begin < until <= last + TICK:
        there, asked = f"from {first:g} to {last:g} s", f"{begin:g} to {until:g} s"
        problem = f"ego {ego!r} is present {there}, the requested window is {asked}"
        raise InputError(source, problem, "Choose a start and an end within its span.")
    return begin, until


def rows_beyond(own: Floats, *frames: pd.DataFrame) -> int:
    """Give how many rows of track tables lie before the first or after the last of the EGO's own times (K,) [s]."""
    first, last = own.min() - TICK, own.max() + TICK
    return sum(int((~frame["t"].between(first, last)).sum()) for frame in frames)


def beyond_ego(own: Floats, *frames: pd.DataFrame) -> str:
    """Say what `rows_beyond` counts; "" for none."""
    if not (count := rows_beyond(own, *frames)):
        return ""
    first, last = own.min(), own.max()
    return (
        f"{count} rows before {first:g} s or after {last:g} s, where the EGO has none: kept, as they show that the "
        "drive lasted longer; --start and --end cut it"
    )


def times_of(frame: pd.DataFrame, source: Path, ego: str) -> Floats:
    """Give the EGO's times [s] in a track table. Raises InputError where it has none."""
    own = frame.loc[frame["id"] == ego, "t"].to_numpy(float)
    if not len(own):
        known = ", ".join(frame["id"].drop_duplicates().head(20))
        raise InputError(source, f"ego {ego!r} was not found; the file has {known}", "Name one of them.")
    return own


def limits(start: float | None, end: float | None) -> tuple[float, float]:
    """Give the times [s] from which and up to which rows are taken, infinite where nobody cuts."""
    return -np.inf if start is None else start - TICK, np.inf if end is None else end + TICK


def asked_window(
    frame: pd.DataFrame, source: Path, *, ego: str, start: float | None, end: float | None
) -> tuple[float, float]:
    """Give the `limits` within which a track table is to be taken.

    Raises InputError where a start or end is not within the EGO's times.
    """
    window = window_of(times_of(frame, source, ego), source, ego=ego, start=start, end=end)
    low, high = limits(start, end)
    if not frame.loc[frame["id"] == ego, "t"].between(low, high).any():
        raise _between_samples(source, ego, window)
    return low, high


def _between_samples(source: Path, ego: str, window: tuple[float, float]) -> InputError:
    problem = f"ego {ego!r} has no sample from {window[0]:g} to {window[1]:g} s: the window lies between two"
    return InputError(source, problem, "Choose a start and an end that are further apart.")


def cut_window(
    frame: pd.DataFrame, source: Path, *, ego: str, start: float | None, end: float | None
) -> tuple[pd.DataFrame, dict[str, str]]:
    """Give the rows from start to end [s], their times shifted to begin at 0, and what the provenance says of that.

    frame: track table of traffic of which anybody may be the EGO. Without start or end the window reaches as far as the
    EGO is there; the EGO must be there in all of it, other objects may be in part. Raises InputError.
    """
    own = times_of(frame, source, ego)
    start, end = window_of(own, source, ego=ego, start=start, end=end)
    rows = frame[(frame["t"] >= start - TICK) & (frame["t"] <= end + TICK)]
    times, seen = np.unique(rows["t"]), rows.loc[rows["id"] == ego, "t"]
    if not len(seen):
        raise _between_samples(source, ego, (start, end))
    if len(gap := np.setdiff1d(times, seen)):
        problem = f"ego {ego!r} is missing at t {gap[0]:g} s ({len(gap)} of {len(times)} times)"
        raise InputError(source, problem, "Choose a window in which it is always present.")
    origin = float(times[0])
    told = {"original_start": f"{origin:.9g} s"}
    if len(rows) < len(frame):
        told["window"] = (
            f"{len(rows)} of {len(frame)} rows, from {start:g} to {end:g} s, in which the EGO is there"
        )
    return rows.assign(t=np.round(rows["t"] - origin, 9)), told
