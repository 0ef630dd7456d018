"""What the parameters of a perception model depend on: features, maneuver and occlusion of traffic objects.

Training and runtime both read them off the truth here, so that they mean the same. All arrays have one shape, of
objects, or objects and times; the frame is the EGO's (x forward, y left of its box centre).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import groupby
from operator import itemgetter
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resim.core.geometry import Floats
from resim.perception.model import MANEUVERS

BRAKING = -1.0
"""Acceleration [m/s²] below which an object brakes."""
LANE_CHANGE = 0.3
"""Speed [m/s] across the EGO's heading above which an object changes lane."""

_FOLLOW, _LEFT, _RIGHT, _BRAKES = (
    MANEUVERS.index(name) for name in ("follow_lane", "lane_change_left", "lane_change_right", "braking")
)


class Moving(Protocol):
    """The EGO, such as an `EgoState`; v: m/s along its heading, a number or an array of the objects' shape."""

    @property
    def v(self) -> Any:
        """Give the speed."""


def features(
    ego: Moving, x_ego: ArrayLike, y_ego: ArrayLike, heading_ego: ArrayLike, v: ArrayLike, a: ArrayLike
) -> Floats:
    """Give (..., 4) range [m], bearing [rad], relative speed [m/s] and acceleration [m/s²] (`FEATURES`).

    x_ego, y_ego [m], heading_ego [rad]: in the EGO's frame. v [m/s], a [m/s²]: over ground, along the object's heading.
    """
    x, y, along = np.asarray(x_ego), np.asarray(y_ego), np.asarray(v) * np.cos(heading_ego)
    out = np.empty((*np.broadcast_shapes(x.shape, y.shape, along.shape, np.shape(a)), 4))
    out[..., 0] = np.hypot(x, y)
    out[..., 1] = np.arctan2(y, x)
    out[..., 2] = along - ego.v
    out[..., 3] = a
    return out


def maneuver(relative_heading: ArrayLike, v: ArrayLike, a: ArrayLike) -> NDArray[np.intp]:
    """Give what objects do, as index into `MANEUVERS`: they brake, else change lane, else follow theirs.

    relative_heading [rad]: against the EGO's. v [m/s], a [m/s²]: as in `features`.
    """
    across = np.asarray(v) * np.sin(relative_heading)
    sideways = np.where(across > LANE_CHANGE, _LEFT, np.where(across < -LANE_CHANGE, _RIGHT, _FOLLOW))
    return np.where(np.asarray(a) < BRAKING, _BRAKES, sideways)


def occlusion(
    x_ego: ArrayLike, y_ego: ArrayLike, heading_ego: ArrayLike, length: ArrayLike, width: ArrayLike
) -> Floats:
    """Give (N,) the share of each object's angle, seen from the EGO's centre, that nearer objects cover.

    Nearer is whose box centre is; boxes are opaque. All arguments (N,): m and rad in the EGO's frame.
    """
    place = np.asarray(x_ego) + 1j * np.asarray(y_ego)
    n = len(place)
    if n < 2:
        return np.zeros(n)
    middle, half = _arcs(place, np.asarray(heading_ego), np.asarray(length), np.asarray(width))
    apart = middle - middle[:, None]  # row: who is covered; column: who may cover
    apart -= 2.0 * math.pi * np.rint(apart / (2.0 * math.pi))
    cover = np.where(half > 0.5 * math.pi, 2.0 * math.pi, half)  # who stands on the EGO covers all
    distance = np.abs(place)
    meets = np.abs(apart) < half[:, None] + cover
    meets &= distance < distance[:, None]
    rows, columns = meets.nonzero()
    out = np.zeros(n)
    if len(rows):
        centre, reach = apart[meets], cover[columns]
        low, high = centre - reach, centre + reach
        for row, covered in _united(rows.tolist(), low.tolist(), high.tolist(), half.tolist()):
            out[row] = covered
    return out


def _united(
    rows: list[int], low: list[float], high: list[float], half: list[float]
) -> Iterator[tuple[int, float]]:
    """Give per row the share of -half..half that its intervals low..high cover together."""
    for row, group in groupby(sorted(zip(rows, low, high, strict=True)), key=itemgetter(0)):
        end = half[row]
        covered, reached = 0.0, -end
        for _, begin, finish in group:
            if finish > reached:
                begin = max(begin, reached)
                reached = min(finish, end)
                covered += max(reached - begin, 0.0)
        yield row, min(0.5 * covered / end, 1.0)


def _arcs(
    place: NDArray[np.complex128], heading: Floats, length: Floats, width: Floats
) -> tuple[Floats, Floats]:
    """Give the middle and the half [rad] of the angle that each box takes; half of it pi where the EGO is inside."""
    distance, bearing = np.abs(place), np.arctan2(place.imag, place.real)
    turn = heading - bearing  # corners against the centre's bearing
    c, s = np.cos(turn), np.sin(turn)
    length, width = 0.5 * length, 0.5 * width
    along, across = np.empty((2, 4, len(place)))
    lc, ls, wc, ws = length * c, length * s, width * c, width * s
    np.subtract(lc, ws, along[0])
    np.add(lc, ws, along[1])
    np.add(ls, wc, across[0])
    np.subtract(ls, wc, across[1])
    np.negative(along[:2], along[2:])
    np.negative(across[:2], across[2:])
    along += distance
    angle = np.arctan2(across, along)
    low, high = np.minimum.reduce(angle), np.maximum.reduce(angle)
    inside = high - low >= math.pi
    if inside.any():
        return bearing + np.where(inside, 0.0, 0.5 * (low + high)), np.where(
            inside, math.pi, 0.5 * (high - low)
        )
    return bearing + 0.5 * (low + high), 0.5 * (high - low)
