"""Ids for a sensor's list that has none: which of its rows are one object."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats
from resim.recordings.mapped.matching import nearest

LOST = 0.5
"""Time [s] for which an object that is not on the list is expected again."""
FASTER, HARDEST = 3.0, 10.0
"""By how much [m/s] a measured velocity may change from list to list, and besides that in time [m/s²]: another object
stands in the place of one that was lost."""


def tracked(
    t: Floats,
    places: NDArray[np.complex128],
    velocity: NDArray[np.complex128],
    gate: float,
    ego: NDArray[np.complex128] | None = None,
) -> NDArray[np.str_]:
    """Give ids (K,) "1", "2", ... to the rows of lists.

    From list to list, rows are assigned to the objects seen last, each moved on by its velocity, so that the sum of
    distances is least, none farther than the gate or of another velocity; who is left over is a new object. A row
    without a place is one of its own.

    t: (K,) s; rows of one time are one list. places: x + iy (K,) [m]. velocity: (K,) [m/s], NaN where it is not known:
    then it is that since the object was seen before. gate: m. ego: (K,) m/s, velocity of the EGO, NaN where it is not
    known: an object seen once, whose velocity nobody knows, may stand or drive as the EGO does.
    """
    number = np.full(len(t), -1)
    last: dict[int, int] = {}
    speed: dict[int, complex] = {}
    new: set[int] = set()  # seen once, of unknown velocity
    count = 0
    order = np.argsort(t, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(t[order])) + 1):
        now = t[rows[0]]
        last = {one: row for one, row in last.items() if now - t[row] <= LOST}
        seen = rows[np.isfinite(places[rows])]
        ones = list(last)
        if ones and len(seen):
            there = np.array([places[last[one]] + speed[one] * (now - t[last[one]]) for one in ones])
            apart = np.abs(places[seen][:, None] - there)
            if ego is not None:
                along = [places[last[one]] + ego[last[one]] * (now - t[last[one]]) for one in ones]
                as_ego = np.where([one in new for one in ones], np.array(along), np.nan)
                apart = np.fmin(apart, np.abs(places[seen][:, None] - as_ego))
            dt = np.array([now - t[last[one]] for one in ones])
            changed = np.abs(velocity[seen][:, None] - velocity[[last[one] for one in ones]])
            apart[changed > FASTER + HARDEST * dt] = np.inf  # where one is not known, any will do
            i, j = nearest(apart, gate)
            number[seen[i]] = np.array(ones)[j]
        for row in rows[number[rows] < 0].tolist():
            number[row], count = count, count + 1
        for row in seen.tolist():
            one, moved = int(number[row]), velocity[row]
            if not np.isfinite(moved):
                before = last.get(one)
                moved = 0.0 if before is None else (places[row] - places[before]) / (now - t[before])
                (new.add if before is None else new.discard)(one)
            last[one], speed[one] = row, complex(moved)
    return np.array([str(one + 1) for one in number.tolist()], dtype=str)
