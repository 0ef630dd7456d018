"""Columns that may be times or ids by their numbers, where no name tells them; each with its reason."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

from resim.core.errors import InputError
from resim.core.geometry import Floats
from resim.core.spelling import counted
from resim.recordings.mapped.rows import SourceTable, calendar_seconds

EVEN = 0.5
"""Part of the usual step by which most steps of a clock differ from it at most."""
REPEATED = 3
"""Rows an object has at least, in the mean."""
Candidate = tuple[str, str]
"""A column, and why it fits."""


def time_like(rows: SourceTable, taken: set[str], ids: pd.Series | None) -> list[Candidate]:
    """Give columns that run like a clock, down the table or of each object (ids), the evenest steps first."""
    found = []
    for column in _others(rows.frame, taken):
        values = _numbers(rows, column)
        if values is None:
            continue
        groups = [("down the table", pd.Series(0, index=range(len(values))))]
        if ids is not None:
            groups.append(("of each object", ids.reset_index(drop=True)))
        for where, of in groups:
            steps = pd.Series(values).groupby(of.to_numpy(), sort=False).diff().to_numpy(float)
            if (steps < 0.0).any() or not (steps > 0.0).any():
                continue
            steps = steps[steps > 0.0]
            usual = float(np.median(steps))
            even = float((np.abs(steps - usual) <= EVEN * usual).mean())
            if even > 0.8:
                found.append((even, column, f"it never falls {where}, and its steps are {usual:g}"))
                break
    return [(column, why) for _, column, why in sorted(found, key=lambda one: -one[0])]


def id_like(rows: SourceTable, taken: set[str], t: Floats | None) -> list[Candidate]:
    """Give columns of whole numbers or words that recur, none twice at a time t (K,) where that is known."""
    found = []
    for column in _others(rows.frame, taken):
        values = rows.words(column)
        own = values[values != ""]
        count = own.nunique()
        if not count or len(own) < REPEATED * count or not _are_names(rows, column):
            continue
        if t is not None and pd.DataFrame({"t": t, "id": values}).loc[own.index].duplicated().any():
            continue
        once = "" if t is None else ", none twice at a time"
        found.append((count, column, f"{counted(count, 'value')} in {len(own)} rows{once}"))
    return [(column, why) for _, column, why in sorted(found, key=lambda one: -one[0])]


def _others(frame: pd.DataFrame, taken: set[str]) -> Iterator[str]:
    return (str(column) for column in frame.columns if str(column) not in taken)


def _numbers(rows: SourceTable, column: str) -> Floats | None:
    """The column as numbers, or as seconds of a calendar; None where it is neither, or not whole."""
    try:
        values = rows.plain_numbers(column)
    except InputError:
        values = calendar_seconds(rows.frame[column])
    return values if len(values) > 1 and np.isfinite(values).all() else None


def _are_names(rows: SourceTable, column: str) -> bool:
    """Whether the values can be names: words, or whole numbers."""
    try:
        values = rows.plain_numbers(column)
    except InputError:
        return True
    known = values[np.isfinite(values)]
    return bool((known == np.round(known)).all())
