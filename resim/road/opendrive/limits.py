"""The speed limit along a lane: the lane's own record, else the sign in force, else the road's type."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from resim.core.geometry import Floats
from resim.road.opendrive.model import Road, SpeedSign


def limits(road: Road, section: int, lane: int, s: Floats) -> Floats:
    """Give the limit [m/s] that holds from each s (K,) [m] on for the lane of the section, NaN for none.

    s: every place in the section at which a record or a sign begins, among others. A lane record wins over
    a sign, a sign over the road's type; one that says "no limit" wins as well. A sign holds in the direction
    it faces for the lanes it names, by their number, up to the next sign for them or to the road's end.
    """
    here = road.sections[section]
    found = here.lanes.get(lane)
    own = _held([(here.start + at, speed) for at, speed in (found.speeds if found else ())], s)
    sign = _signed(road, lane, road.along(lane, section), s)
    value = np.where(np.isnan(sign), _held([(kind.s, kind.speed) for kind in road.types], s), sign)
    value = np.where(np.isnan(own), value, own)
    return np.where(np.isfinite(value), value, np.nan)


def signs_for(road: Road, lane: int, along: bool) -> list[SpeedSign]:
    """Give the signs with a speed, inf for one that ends a limit, for a lane driven along s or against it, by s."""
    way = "+" if along else "-"
    return [
        sign for sign in sorted(road.signs, key=lambda sign: sign.s)
        if sign.orientation in (way, "none") and not np.isnan(sign.speed)
        and (not sign.lanes or any(low <= lane <= high for low, high in sign.lanes))
    ]  # fmt: skip


def _signed(road: Road, lane: int, along: bool, s: Floats) -> Floats:
    """The limit (K,) of the sign in force, NaN where there is none or its end was signed."""
    signs = [(sign.s, sign.speed) for sign in signs_for(road, lane, along)]
    if not signs:
        return np.full(len(s), np.nan)
    if along:
        held = _held(signs, s)
    else:
        table = np.array([*signs, (np.inf, np.nan)])
        held = table[np.searchsorted(table[:, 0], s, side="right"), 1]
    return np.where(np.isfinite(held), held, np.nan)


def _held(records: Iterable[tuple[float, float]], s: Floats) -> Floats:
    """The value of the last record at or before s, NaN before the first."""
    table = np.array([(-np.inf, np.nan), *records])
    return np.asarray(table[np.searchsorted(table[:, 0], s, side="right") - 1, 1])
