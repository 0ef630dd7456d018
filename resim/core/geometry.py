"""Plane geometry on arrays: angles, frames and boxes.

Map frame: x east, y north, heading anticlockwise from +x (ISO 8855), radians and metres.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Owner = TypeVar("Owner")


def constant(array: NDArray[Any]) -> NDArray[Any]:
    """Give a copy that nobody can change, nor make writable again."""
    return np.frombuffer(array.tobytes(), array.dtype).reshape(array.shape)


def sealed(owner: Owner) -> Owner:
    """Give an object back, its arrays made `constant`: whoever writes into one that others share gets a ValueError."""
    for name, value in vars(owner).items():
        if isinstance(value, np.ndarray):
            object.__setattr__(owner, name, constant(value))
    return owner


def wrap_angle(angle: ArrayLike) -> Floats:
    """Give the angle [rad] in (-pi, pi], element by element."""
    return np.pi - np.mod(np.pi - np.asarray(angle, dtype=float), 2.0 * np.pi)


def unwrap_angle(angle: ArrayLike) -> Floats:
    """Take the 2 pi jumps out of the angles [rad] along the last axis, across NaN as well."""
    out = np.array(angle, dtype=float)
    for row in out.reshape(-1, out.shape[-1]):
        known = np.isfinite(row)
        row[known] = np.unwrap(row[known])
    return out


def to_frame(
    x: ArrayLike, y: ArrayLike, x0: ArrayLike, y0: ArrayLike, heading0: ArrayLike
) -> tuple[Floats, Floats]:
    """Turn map positions [m] into the frame at (x0, y0) whose x axis points along heading0 [rad]."""
    dx, dy = np.asarray(x) - x0, np.asarray(y) - y0
    c, s = np.cos(heading0), np.sin(heading0)
    return c * dx + s * dy, c * dy - s * dx


def from_frame(
    x: ArrayLike, y: ArrayLike, x0: ArrayLike, y0: ArrayLike, heading0: ArrayLike
) -> tuple[Floats, Floats]:
    """Turn positions [m] in the frame at (x0, y0, heading0) into map positions; inverse of `to_frame`."""
    x, y = np.asarray(x), np.asarray(y)
    c, s = np.cos(heading0), np.sin(heading0)
    return x0 + c * x - s * y, y0 + s * x + c * y


def box_corners(
    x: ArrayLike, y: ArrayLike, heading: ArrayLike, length: ArrayLike, width: ArrayLike
) -> Floats:
    """Give the corners (..., 4, 2) [m] of boxes by centre, anticlockwise from the front left."""
    x, y, heading, length, width = np.broadcast_arrays(x, y, heading, length, width)
    along = 0.5 * length[..., None] * np.array([1.0, -1.0, -1.0, 1.0])
    across = 0.5 * width[..., None] * np.array([1.0, 1.0, -1.0, -1.0])
    c, s = np.cos(heading)[..., None], np.sin(heading)[..., None]
    return np.stack([x[..., None] + c * along - s * across, y[..., None] + s * along + c * across], axis=-1)


class Boxes(NamedTuple):
    """Boxes by centre [m], heading [rad], length and width [m]: numbers, or arrays that go together."""

    x: ArrayLike
    y: ArrayLike
    heading: ArrayLike
    length: ArrayLike
    width: ArrayLike


def smooth_step(u: Floats) -> tuple[Floats, Floats, Floats]:
    """Give 10 u³ - 15 u⁴ + 6 u⁵, from 0 to 1 while u (K,) does, and its first and second derivatives by u.

    The polynomial of least jerk (Flash and Hogan 1985): at rest, and without acceleration, at either end and beyond.
    """
    u = np.clip(u, 0.0, 1.0)
    f = u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
    return f, 30.0 * u**2 * (1.0 - u) ** 2, 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u)


def boxes_overlap(one: Boxes, two: Boxes) -> Bools:
    """Say, element by element, whether two boxes overlap or touch (separating axes; NaN never overlaps)."""
    x, y, heading, length, width = one
    x2, y2, heading2, length2, width2 = two
    dx, dy = np.asarray(x2) - x, np.asarray(y2) - y
    turn = np.asarray(heading2) - heading
    c, s = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    a, b, a2, b2 = (0.5 * np.asarray(e) for e in (length, width, length2, width2))
    inside = np.ones(np.broadcast(dx, dy, turn, a, b, a2, b2).shape, dtype=bool)
    for axis, along, across, along2, across2 in ((heading, a, b, a2, b2), (heading2, a2, b2, a, b)):
        ca, sa = np.cos(axis), np.sin(axis)
        inside &= np.abs(ca * dx + sa * dy) <= along + c * along2 + s * across2
        inside &= np.abs(ca * dy - sa * dx) <= across + s * along2 + c * across2
    return inside
