"""What the parameters of a perception model depend on: features and occlusion of traffic objects.

Training and runtime both read them off the truth here, so that they mean the same. All arrays have one shape, of
objects, or objects and times; the frame is the EGO's (x forward, y left of its box centre).
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from resim.core.geometry import Floats


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


def occlusion(
    x_ego: ArrayLike, y_ego: ArrayLike, heading_ego: ArrayLike, length: ArrayLike, width: ArrayLike
) -> Floats:
    """Give (N,) the share of each object's angle, seen from the EGO's centre, that nearer objects cover.

    Nearer is whose box centre is; boxes are opaque. All arguments (N,): m and rad in the EGO's frame.
    """
    # compiled: numba is imported where it is used only
    from resim.perception.runtime import kernel

    places = np.asarray(x_ego) + 1j * np.asarray(y_ego)
    heading, length, width = (np.ascontiguousarray(c, dtype=float) for c in (heading_ego, length, width))
    hidden: Floats = kernel.occlusion(places, heading, 0.0, length, width)
    return hidden
