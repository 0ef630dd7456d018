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
    reach = half[:, None]
    apart = middle - middle[:, None]  # row: who is covered; column: who may cover
    apart -= 2.0 * math.pi * np.round(apart / (2.0 * math.pi))
    cover = np.where(half > 0.5 * math.pi, 2.0 * math.pi, half)  # who stands on the EGO covers all
    distance = np.abs(place)
    meets = (np.abs(apart) < reach + cover) & (distance < distance[:, None])
    if not meets.any():
        return np.zeros(n)
    low = np.where(meets, np.maximum(apart - cover, -reach), math.inf)
    high = np.where(meets, np.minimum(apart + cover, reach), -math.inf)
    order = np.argsort(low, axis=1)
    low, high = np.take_along_axis(low, order, axis=1), np.take_along_axis(high, order, axis=1)
    before = np.maximum.accumulate(high, axis=1)[:, :-1]  # how far those further right cover already
    low[:, 1:] = np.maximum(low[:, 1:], before)
    covered = np.where(low < high, high - low, 0.0).sum(axis=1)
    return np.asarray(np.minimum(covered / (2.0 * half), 1.0))


def _arcs(
    place: NDArray[np.complex128], heading: Floats, length: Floats, width: Floats
) -> tuple[Floats, Floats]:
    """Give the middle and the half [rad] of the angle that each box takes; half of it pi where the EGO is inside."""
    turn = np.exp(1j * heading) * place.conj()  # corners against the centre's bearing
    along, across = 0.5 * length * turn, 0.5j * width * turn
    corners = np.abs(place) ** 2 + np.stack(
        [along + across, along - across, -along + across, -along - across]
    )
    angle = np.arctan2(corners.imag, corners.real)
    low, high = angle.min(axis=0), angle.max(axis=0)
    inside = high - low >= math.pi
    middle = np.arctan2(place.imag, place.real) + np.where(inside, 0.0, 0.5 * (low + high))
    return middle, np.where(inside, math.pi, 0.5 * (high - low))
