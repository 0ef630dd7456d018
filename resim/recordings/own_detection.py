"""Whether what a sensor sees is the EGO itself, or a road user at its place.

A sensor's own detection of the EGO has the EGO's kind and about its size, and is with the EGO for all the time that it
is seen: its box never leaves the EGO's, and it stays where it is on it. Who comes near and goes, who is of another kind
or size, or is seen for less than LEAST, is somebody else, or nobody can tell. Mcity's sensor has the EGO (a car of
4.9 x 1.9 m) as 4.7 to 5.5 x 2.2 to 2.4 m, in the median up to 0.4 m aside and 1.5 m behind, 0.9 m from one third
of the time to another; and pedestrians up to 0.5 m aside and 1.6 m behind.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from resim.core.geometry import Floats
from resim.core.objects import ALIKE, UNKNOWN
from resim.core.schema import GT_ID, TOLD

PARTLY = 2.0
"""Factor by which a side may differ of what somebody has named as the EGO: a sensor may see half of it."""
ASIDE, BEHIND = 0.9, 1.7
"""Errors [m] across and along the EGO's heading that are usual also of those who are smaller."""
DRIFT = 1.2
"""Distance [m] by which the middle of its place on the EGO may change from one third of its time to another."""
LEAST = 1.0
"""Time [s] for which it has to be seen beside the EGO."""
CLASSES = {"motorcycle": "two wheels", "bicycle": "two wheels", "pedestrian": "on foot"}
"""What no sensor takes for each other; all other kinds are vehicles of four wheels and more."""


def other_shape(rows: pd.DataFrame, ego: pd.DataFrame, *, named: bool = False) -> str:
    """Give why rows of an SD object cannot be the EGO's own detection, by kind and size; "" where they can.

    rows, ego: kind, length, width [m] of all their rows. named: whether somebody has named it as the EGO, which also
    another kind of four wheels, and a part of the EGO, may be.
    """
    kinds = {k for k in rows["kind"].unique().tolist() if k not in UNKNOWN}
    own = {k for k in ego["kind"].unique().tolist() if k not in UNKNOWN}
    differ = {CLASSES.get(k) for k in kinds} - {CLASSES.get(k) for k in own} if named else kinds - own
    least, largest, told = *_sides(rows), ego[["length", "width"]].median().to_numpy(float)
    told = np.sort(told)[::-1]
    most = PARTLY if named else ALIKE
    if not (own and differ) and (largest <= most * told).all() and (told <= most * least).all():
        return ""
    what = "/".join(sorted(kinds)) or "object of unknown kind"
    ranges = [
        f"{a:.2g}" if b - a < 0.05 else f"{a:.2g} to {b:.2g}" for a, b in zip(least, largest, strict=True)
    ]
    whose = "/".join(sorted(own)) or "object of unknown kind"
    return f"a {what} of {ranges[0]} x {ranges[1]} m, the EGO a {whose} of {told[0]:.2g} x {told[1]:.2g} m"


def elsewhere(
    t: Floats, off: NDArray[np.complex128], size: tuple[float, float], ego_size: tuple[float, float]
) -> str:
    """Give why an SD object is not with the EGO for all its time; "" where it is.

    t: (K,) s, at which both are there. off: (K,) m, its place less the EGO's, x + iy ahead and to the left. size,
    ego_size: length, width [m], the largest told.
    """
    if len(t) < 3 or t[-1] - t[0] < LEAST:
        return f"seen beside the EGO for less than {LEAST:g} s"
    reach = [max(0.5 * (a + b), usual) for a, b, usual in zip(size, ego_size, (BEHIND, ASIDE), strict=True)]
    out = (np.abs(off.real) > reach[0]) | (np.abs(off.imag) > reach[1])
    if out.any():
        k = int(out.argmax())
        return f"at {t[k]:.2f} s {abs(off[k]):.1f} m from the EGO's centre"
    middle = [max(0.5 * side, ASIDE) for side in ego_size]
    if abs(np.median(off.real)) > middle[0] or abs(np.median(off.imag)) > middle[1]:
        return (
            f"in the median {abs(np.median(off.real) + 1j * np.median(off.imag)):.1f} m from the EGO's centre"
        )
    thirds = [np.median(part.real) + 1j * np.median(part.imag) for part in np.array_split(off, 3)]
    if (far := max(abs(a - b) for a in thirds for b in thirds)) > DRIFT:
        return f"moves by {far:.1f} m on the EGO"
    return ""


def misnamed_egos(sd: pd.DataFrame, gt: pd.DataFrame, ego: str) -> dict[str, str]:
    """Give the SD ids that are named as the EGO and cannot be it, by kind or size, each with the reason.

    sd, gt: rows of track tables; an SD without gt_id names its objects as the GT does.
    """
    own = gt[gt["id"] == ego]
    names = sd[GT_ID] if GT_ID in sd else sd["id"]
    suspects = sd["id"].isin(sd.loc[names == ego, "id"])
    if own.empty or not suspects.any():
        return {}
    found = {
        str(name): other_shape(rows, own, named=True) for name, rows in sd[suspects].groupby("id", sort=False)
    }
    return {name: why for name, why in found.items() if why}


def without_names(
    sd: pd.DataFrame, strangers: Collection[str] | Mapping[str, str], known: set[str]
) -> pd.DataFrame:
    """Give the SD rows in which these ids are named after nobody; known: the ids of GT."""
    if not strangers:
        return sd
    names = sd[GT_ID] if GT_ID in sd else sd["id"].where(sd["id"].isin(known), "")
    return sd.assign(**{GT_ID: names.mask(sd["id"].isin(list(strangers)), "")})


def _sides(rows: pd.DataFrame) -> tuple[Floats, Floats]:
    """The least and the largest longer and shorter side [m] that rows tell, or told before a repair."""
    now = rows[list(TOLD)].to_numpy(float)
    sides = [now]
    if set(TOLD.values()) <= set(rows.columns):
        told = rows[list(TOLD.values())].to_numpy(float)
        sides.append(np.where(np.isfinite(told), told, now))
    every = np.sort(np.concatenate(sides), axis=1)[:, ::-1]
    return every.min(axis=0), every.max(axis=0)
