"""What the parameters of a perception model depend on: features, maneuver and occlusion of traffic objects.

Training and runtime both read them off the truth here, so that they mean the same. All arrays have one shape, of
objects, or objects and times; the frame is the EGO's (x forward, y left of its box centre).
"""

from __future__ import annotations

import math
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

_FULL = 2.0 * math.pi
_ALONG = [(1, 0, 0, -1), (1, 0, 0, 1), (-1, 0, 0, 1), (-1, 0, 0, -1)]
_ACROSS = [(0, 1, 1, 0), (0, 1, -1, 0), (0, -1, -1, 0), (0, -1, 1, 0)]
_CORNERS = 0.5 * np.array([*_ALONG, *_ACROSS], dtype=float)
"""Corners along and across the line of sight, of length and width each times cosine and sine of the box's turn."""


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
    x, y = np.asarray(x_ego), np.asarray(y_ego)
    n = len(x)
    if n < 2:
        return np.zeros(n)
    distance, middle, half = (
        c.tolist() for c in _arcs(x, y, np.asarray(heading_ego), np.asarray(length), np.asarray(width))
    )
    order = sorted(range(n), key=distance.__getitem__)
    out = [0.0] * n
    nearer: list[tuple[float, float, float]] = []  # who may cover: distance, middle, half
    for who in order:
        far, here, reach = distance[who], middle[who], half[who]
        covering = []
        for near, there, cover in nearer:
            apart = there - here
            if apart > math.pi:
                apart -= _FULL
            elif apart < -math.pi:
                apart += _FULL
            if abs(apart) < reach + cover and near < far:
                covering.append((apart - cover, apart + cover))
        if covering:
            out[who] = _covered(covering, reach)
        nearer.append((far, here, reach if reach < math.pi else _FULL))  # who stands on the EGO covers all
    return np.array(out)


def _covered(intervals: list[tuple[float, float]], half: float) -> float:
    """Give the share of -half..half that the intervals cover together."""
    covered, reached = 0.0, -half
    for low, high in sorted(intervals):
        if high > reached:
            low, reached = max(low, reached), min(high, half)
            covered += max(reached - low, 0.0)
    return min(0.5 * covered / half, 1.0)


def _arcs(
    x: Floats, y: Floats, heading: Floats, length: Floats, width: Floats
) -> tuple[Floats, Floats, Floats]:
    """Give distances [m], and the middle and the half [rad] of the angle that each box takes.

    Half of it is pi where the EGO is inside.
    """
    distance, bearing = np.hypot(x, y), np.arctan2(y, x)
    turn = heading - bearing  # corners against the centre's bearing
    c, s = np.cos(turn), np.sin(turn)
    parts = np.empty((4, len(x)))
    np.multiply(length, c, parts[0])
    np.multiply(length, s, parts[1])
    np.multiply(width, c, parts[2])
    np.multiply(width, s, parts[3])
    corners = _CORNERS.dot(parts)
    corners[:4] += distance
    angle = np.arctan2(corners[4:], corners[:4])
    low, high = np.minimum.reduce(angle), np.maximum.reduce(angle)
    middle, half = bearing + 0.5 * (low + high), 0.5 * (high - low)
    inside = half >= 0.5 * math.pi
    if inside.any():
        middle, half = np.where(inside, bearing, middle), np.where(inside, math.pi, half)
    return distance, middle, half
