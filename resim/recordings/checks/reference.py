"""Reference points: offsets between SD and GT that are those of a bumper or a corner."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from resim.recordings.checks.codes import RankedFinding, found
from resim.recordings.checks.matching import MatchedTrack

CONSTANT = 1.5
"""Constant position error of a sensor [m] that is usual."""
POINT = 0.35
"""Distance [m] by which an offset misses the half length or width and still is it."""
FIXED = 0.35
"""Spread [m] (scaled median deviation) of an offset that is a point of the vehicle."""
SIDE = 0.6
"""Offset [m] across the box from which on a corner is asked for: a car's half width less the noise."""
SMALL = 0.7
"""Half length [m] below which the points of a box are no farther apart than usual errors: pedestrians."""
CLEAR = 1.0
"""Offset [m] along the box from which on a reference point is asked for: Mcity's sensor is 1.1 m off at most."""


def reference_points(known: list[MatchedTrack], explained: set[str], ego: str) -> Iterator[RankedFinding]:
    """Give SD objects that lie by a constant offset of half a box off their GT; either may be the wrong one."""
    for pair in known:
        if pair.sd.id in explained or not is_point(pair, _peers(pair, known, ego)):
            continue
        along, across = float(np.median(pair.along)), float(np.median(pair.across))
        corner = abs(abs(across) - 0.5 * pair.gt.width) < abs(across)
        ends = ("front", "rear") if along > 0.0 else ("rear", "front")
        what, late = "corner" if corner else "bumper", -along / max(float(np.median(pair.v)), 0.1)
        text = (
            f"SD is {abs(along):.2f} m {'ahead' if along > 0.0 else 'behind'} and {abs(across):.2f} m "
            f"{'left' if across > 0.0 else 'right'} of GT throughout, half the box is "
            f"{0.5 * pair.gt.length:.2f} x {0.5 * pair.gt.width:.2f} m: SD names its {ends[0]} {what}, or GT "
            f"its {ends[1]} {what}, or SD is {abs(late):.2f} s {'late' if late > 0.0 else 'early'}"
        )
        yield found(
            "REFERENCE_POINT", "recording", pair.sd.id, (float(pair.t[0]), float(pair.t[-1])),
            abs(complex(along, across)), "m", text, limit=0.5 * pair.gt.length,
            details={"along": along, "across": across},
        )  # fmt: skip


def is_point(pair: MatchedTrack, peers: float = 0.0) -> bool:
    """Whether the offset is constant, and at a front, a rear or a corner of the box.

    peers: offset ahead [m] that other objects of the sensor have as well.
    """
    along, across = float(np.median(pair.along)), float(np.median(pair.across))
    for values, middle in ((pair.along, along), (pair.across, across)):
        if 1.4826 * float(np.median(np.abs(values - middle))) > FIXED:
            return False
    half, side = 0.5 * pair.gt.length, abs(abs(across) - 0.5 * pair.gt.width)
    if half < SMALL:
        return False
    if abs(abs(along - peers) - half) < POINT and peers != 0.0 and min(abs(across), side) < POINT:
        return True
    if (
        max(half - POINT, CLEAR) < abs(along) < half + CONSTANT + 2.0 * POINT
        and min(abs(across), side) < POINT
    ):
        return True
    at_side = side < POINT and abs(across) > SIDE
    return at_side and abs(abs(along) - half) < CONSTANT + POINT


def _peers(pair: MatchedTrack, known: list[MatchedTrack], ego: str) -> float:
    """Offset ahead [m] that other objects of the sensor share, 0 where that is not known."""
    others = [float(np.median(p.along)) for p in known if p is not pair and p.gt.id != ego]
    if len(others) < 2 or pair.gt.id == ego or np.ptp(others) > 2.0 * POINT:
        return 0.0
    return float(np.median(others))
