"""When, and how near, two moving boxes come to each other: swept separating axes, exact distance.

Motions a, b: (P, N, 4) x, y, heading, v at N common times, h (P,) s apart; sizes (P, 2) length, width [m].
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Bools, Floats, boxes_overlap, wrap_angle

Rows = NDArray[np.intp]

PARTS = 16
BULGE = 4.0 / 27.0  # the most that a cubic Hermite strays from its chord, per metre of tangent error


class _Steps:
    """The relative motion of chosen steps: row i is step `j[i]` of pair `p[i]`."""

    def __init__(self, a: Floats, b: Floats, h: Floats, p: Rows, j: Rows) -> None:
        a0, a1, b0, b1 = a[p, j], a[p, j + 1], b[p, j], b[p, j + 1]
        self.start, end = b0[:, :2] - a0[:, :2], b1[:, :2] - a1[:, :2]
        self.chord = end - self.start
        self.first = _velocity(b0, a0) * h[p, None] - self.chord
        self.second = _velocity(b1, a1) * h[p, None] - self.chord
        self.heading_a, self.heading_b = a0[:, 2], b0[:, 2]
        self.turn_a, self.turn_b = wrap_angle(a1[:, 2] - a0[:, 2]), wrap_angle(b1[:, 2] - b0[:, 2])
        self.bulge = BULGE * (np.hypot(*self.first.T) + np.hypot(*self.second.T))

    def offset(self, f: Floats) -> tuple[Floats, Floats]:
        """Give where b is from a, at shares f of the step, broadcast."""
        m0, m1 = f * (1.0 - f) ** 2, f * f * (f - 1.0)
        x, y = (
            self.start[:, i, None]
            + f * self.chord[:, i, None]
            + m0 * self.first[:, i, None]
            + m1 * self.second[:, i, None]
            for i in (0, 1)
        )
        return x, y


def _velocity(b: Floats, a: Floats) -> Floats:
    return np.asarray(
        b[:, 3:4] * np.stack([np.cos(b[:, 2]), np.sin(b[:, 2])], axis=1)
        - a[:, 3:4] * np.stack([np.cos(a[:, 2]), np.sin(a[:, 2])], axis=1)
    )


def _entry(x0: Floats, y0: Floats, x1: Floats, y1: Floats, heading_a: Floats, heading_b: Floats,
           size_a: Floats, size_b: Floats, slack: Floats) -> Floats:  # fmt: skip
    """Share at which boxes of fixed headings first touch while b goes straight, as seen from a; inf: never."""
    turn = heading_b - heading_a
    c, s = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    low, high = np.zeros_like(x0), np.ones_like(x0)
    for axis, own, other in ((heading_a, size_a, size_b), (heading_b, size_b, size_a)):
        ca, sa = np.cos(axis), np.sin(axis)
        half, wide, half2, wide2 = 0.5 * own[0], 0.5 * own[1], 0.5 * other[0], 0.5 * other[1]
        for p0, p1, r in (
            (ca * x0 + sa * y0, ca * x1 + sa * y1, half + c * half2 + s * wide2 + slack),
            (ca * y0 - sa * x0, ca * y1 - sa * x1, wide + s * half2 + c * wide2 + slack),
        ):
            d = p1 - p0
            still = np.abs(d) < 1e-12
            safe = np.where(still, 1.0, d)
            one, two = (-r - p0) / safe, (r - p0) / safe
            outside = np.abs(p0) > r
            low = np.maximum(low, np.where(still, np.where(outside, np.inf, 0.0), np.minimum(one, two)))
            high = np.minimum(high, np.where(still, 1.0, np.maximum(one, two)))
    return np.where(low <= high, low, np.inf)


def first_contact(a: Floats, b: Floats, h: Floats, size_a: Floats, size_b: Floats) -> Floats:
    """Give the time (P,) [s] from the start at which boxes first touch, 0 where they do at once, inf where never.

    Within a step positions are cubic Hermite, headings turn evenly. Steps that boxes, grown by what both can stray
    and turn, may touch in are cut into PARTS straight parts and looked at again, grown by what is left: contact is
    never missed and found early by less than step curvature / PARTS² (10 um) and turned corner / (2 PARTS) (3 mm
    at 0.7 rad/s and 0.1 s).
    """
    pairs, steps = a.shape[0], a.shape[1] - 1
    at = np.full(pairs, np.inf)
    near = _near(a, b, h, 0.5 * (np.hypot(*size_a.T) + np.hypot(*size_b.T)))
    now = np.zeros(a.shape[:2], dtype=bool)
    now[:, :-1] |= near
    now[:, 1:] |= near
    p, k = np.nonzero(now)  # elsewhere the boxes are apart
    now[p, k] = boxes_overlap(
        a[p, k, 0], a[p, k, 1], a[p, k, 2], size_a[p, 0], size_a[p, 1],
        b[p, k, 0], b[p, k, 1], b[p, k, 2], size_b[p, 0], size_b[p, 1],
    )  # fmt: skip
    met = np.where(now.any(axis=1), now.argmax(axis=1), steps)
    at[now[:, 0]] = 0.0
    p, j = np.nonzero(near & (np.arange(steps) < np.maximum(met, 1)[:, None]))
    some = ~now[p, 0]
    p, j = p[some], j[some]
    entry = _of_steps(_Steps(a, b, h, p, j), size_a[p].T, size_b[p].T)
    np.minimum.at(at, p, (j + entry) * h[p])
    return at


def _near(a: Floats, b: Floats, h: Floats, reach: Floats) -> Bools:
    """Steps (P, N - 1) in which the circles around both boxes may touch."""
    x, y = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
    dx, dy = x[:, 1:] - x[:, :-1], y[:, 1:] - y[:, :-1]
    d, chord = np.sqrt(x * x + y * y), np.sqrt(dx * dx + dy * dy)
    pace = (BULGE * h)[:, None] * (np.abs(a[..., 3]) + np.abs(b[..., 3]))
    gap = 0.5 * (d[:, :-1] + d[:, 1:]) - (0.5 + 2.0 * BULGE) * chord
    return np.asarray(gap <= reach[:, None] + (pace[:, :-1] + pace[:, 1:]))


def _of_steps(steps: _Steps, size_a: Floats, size_b: Floats) -> Floats:
    """Share of each step at which contact begins; inf: none."""
    out = np.full(len(steps.turn_a), np.inf)
    ra, rb = 0.5 * np.hypot(*size_a), 0.5 * np.hypot(*size_b)
    turned = 0.5 * (ra * np.abs(steps.turn_a) + rb * np.abs(steps.turn_b))
    end = steps.start + steps.chord
    may = np.isfinite(
        _entry(
            steps.start[:, 0], steps.start[:, 1], end[:, 0], end[:, 1],
            steps.heading_a + 0.5 * steps.turn_a, steps.heading_b + 0.5 * steps.turn_b,
            size_a, size_b, turned + steps.bulge,
        )
    )  # fmt: skip
    if not may.any():
        return out
    node = np.linspace(0.0, 1.0, PARTS + 1)
    x, y = (o[may] for o in steps.offset(node))
    middle = 0.5 * (node[1:] + node[:-1])
    entry = _entry(
        x[:, :-1], y[:, :-1], x[:, 1:], y[:, 1:],
        steps.heading_a[may, None] + middle * steps.turn_a[may, None],
        steps.heading_b[may, None] + middle * steps.turn_b[may, None],
        size_a[:, may, None], size_b[:, may, None],
        (turned / PARTS + steps.bulge / PARTS**2)[may, None],
    )  # fmt: skip
    out[may] = ((np.arange(PARTS) + entry) / PARTS).min(axis=1)
    return out


def distance(a: Floats, b: Floats, size_a: Floats, size_b: Floats) -> Floats:
    """Give the distance [m] between boxes, 0 where they touch: a, b (..., >= 3) x, y, heading; sizes (..., 2).

    Exact: the nearest points of two boxes apart are a corner of one and a point of the other.
    """
    best = np.full(np.broadcast_shapes(a.shape[:-1], b.shape[:-1]), np.inf)
    for one, two, size_1, size_2 in ((a, b, size_a, size_b), (b, a, size_b, size_a)):
        c, s = np.cos(two[..., 2]), np.sin(two[..., 2])
        dx, dy = one[..., 0] - two[..., 0], one[..., 1] - two[..., 1]
        px, py = c * dx + s * dy, c * dy - s * dx
        turn = one[..., 2] - two[..., 2]
        ct, st = np.cos(turn), np.sin(turn)
        for i, k in ((0.5, 0.5), (0.5, -0.5), (-0.5, 0.5), (-0.5, -0.5)):
            ahead, left = i * size_1[..., 0], k * size_1[..., 1]
            ox = np.maximum(np.abs(px + ct * ahead - st * left) - 0.5 * size_2[..., 0], 0.0)
            oy = np.maximum(np.abs(py + st * ahead + ct * left) - 0.5 * size_2[..., 1], 0.0)
            best = np.minimum(best, np.hypot(ox, oy))
    touch = boxes_overlap(
        a[..., 0], a[..., 1], a[..., 2], size_a[..., 0], size_a[..., 1],
        b[..., 0], b[..., 1], b[..., 2], size_b[..., 0], size_b[..., 1],
    )  # fmt: skip
    return np.where(touch, 0.0, best)
