"""Whether two boxes on their paths touch: at the grid's times as published, or at any time (swept).

half: (el, ew, tl, tw), half lengths and widths of the EGO's box on path a, and of the object's on path b; see `motion`
for paths. pose: where b is from a, x and y, and cosines and sines of the headings of a and b.
A witness is (step, corner) of a contact: where to look first when the same pair, or one much like it, comes again.
"""

# mypy: ignore-errors
from __future__ import annotations

import math

import numpy as np

from resim.core.compiled import inlined, inner
from resim.metrics.risk.kernel.motion import BULGE, COS, MID_COS, MID_SIN, SIN, TURN, VX, X, Y, norm

FREE = np.inf
NONE = 1 << 30
PARTS = 4
"""In how many a step is looked at where boxes may touch."""
CLEAR = 1e-3
"""How deep an overlap is that is sure without a closer look [m]."""
TINY = 1e-9
"""What an axis that parts boxes may be wrong by [m]."""


@inlined
def _corner_inside(q, pose, half):
    """Whether corner q (0..3) of box a lies in box b."""
    dx, dy, ac, as_, bc, bs = pose
    al, aw, bl, bw = half
    u, w = (al if q & 1 else -al), (aw if q & 2 else -aw)
    x, y = ac * u - as_ * w - dx, as_ * u + ac * w - dy
    return abs(bc * x + bs * y) <= bl and abs(bc * y - bs * x) <= bw


@inlined
def _poses(paths, a, b, j):
    """The pose at time j."""
    return (
        paths[b, X, j] - paths[a, X, j], paths[b, Y, j] - paths[a, Y, j],
        paths[a, COS, j], paths[a, SIN, j], paths[b, COS, j], paths[b, SIN, j],
    )  # fmt: skip


@inlined
def _seen_from_b(pose):
    """Where a is from b."""
    return -pose[0], -pose[1], pose[4], pose[5], pose[2], pose[3]


@inlined
def corner_touches(paths, a, b, j, q, half):
    """Whether at time j corner q lies inside: 0..3 of b in a, 4..7 of a in b."""
    pose = _poses(paths, a, b, j)
    if q < 4:
        return _corner_inside(q, _seen_from_b(pose), (half[2], half[3], half[0], half[1]))
    return _corner_inside(q, pose, half)


@inlined
def _apart(pose, half):
    """How far the axis of either box that parts them best does so; below 0 they overlap [m]."""
    x, y, ac, as_, bc, bs = pose
    el, ew, tl, tw = half
    c, s = abs(ac * bc + as_ * bs), abs(ac * bs - as_ * bc)
    return max(
        max(abs(ac * x + as_ * y) - (el + c * tl + s * tw), abs(ac * y - as_ * x) - (ew + s * tl + c * tw)),
        max(abs(bc * x + bs * y) - (tl + c * el + s * ew), abs(bc * y - bs * x) - (tw + s * el + c * ew)),
    )


@inner
def corner_at(paths, a, b, j, half):
    """A corner that lies inside at time j (Algorithm 4.1), -1 where none does."""
    pose = _poses(paths, a, b, j)
    other, swapped = _seen_from_b(pose), (half[2], half[3], half[0], half[1])
    # a corner inside means overlap: boxes that an axis of either parts need no look at corners
    if _apart(pose, half) > TINY:
        return -1
    for q in range(4):
        if _corner_inside(q, other, swapped):
            return q
        if _corner_inside(q, pose, half):
            return q + 4
    return -1


@inlined
def touch_at_times(paths, a, b, start, half):
    """A witness of contact at one of the times from `start` on, as published; (-1, -1) where there is none."""
    last = paths.shape[2] - 1
    first = NONE  # at which no axis parts the boxes, found without a branch
    for j in range(max(start, 0), last + 1):
        apart = _apart(_poses(paths, a, b, j), half)
        first = min(first, j if apart <= TINY else NONE)
    for j in range(first, last + 1):
        q = corner_at(paths, a, b, j, half)
        if q >= 0:
            return j, q
    return -1, -1


@inlined
def first_at_times(paths, a, b, start, half):
    """The first time from `start` on at which boxes touch, as published, and the corner; (-1, -1) for never."""
    reach = norm(half[0], half[1]) + norm(half[2], half[3])
    for j in range(start, paths.shape[2]):
        dx, dy = paths[b, X, j] - paths[a, X, j], paths[b, Y, j] - paths[a, Y, j]
        if dx * dx + dy * dy <= reach * reach:
            q = corner_at(paths, a, b, j, half)
            if q >= 0:
                return j, q
    return -1, -1


@inlined
def _slab(p0, p1, r, low, high):
    """The part of low..high in which |p0 + s (p1 - p0)| <= r; empty as (1, 0)."""
    d = p1 - p0
    if abs(d) < 1e-12:
        return (low, high) if abs(p0) <= r else (1.0, 0.0)
    s0, s1 = (-r - p0) / d, (r - p0) / d
    if s0 > s1:
        s0, s1 = s1, s0
    return max(low, s0), min(high, s1)


@inner
def _swept(pose, x1, y1, half, slack):
    """Whether boxes of fixed headings touch while b moves relative to a from its pose to (x1, y1)."""
    x0, y0, ac, as_, bc, bs = pose
    el, ew, tl, tw = half
    c, s = abs(ac * bc + as_ * bs), abs(ac * bs - as_ * bc)
    low, high = _slab(ac * x0 + as_ * y0, ac * x1 + as_ * y1, el + c * tl + s * tw + slack, 0.0, 1.0)
    if low > high:
        return False
    low, high = _slab(ac * y0 - as_ * x0, ac * y1 - as_ * x1, ew + s * tl + c * tw + slack, low, high)
    if low > high:
        return False
    low, high = _slab(bc * x0 + bs * y0, bc * x1 + bs * y1, tl + c * el + s * ew + slack, low, high)
    if low > high:
        return False
    low, high = _slab(bc * y0 - bs * x0, bc * y1 - bs * x1, tw + s * el + c * ew + slack, low, high)
    return low <= high


@inlined
def _place(paths, p, row, j, f):
    """Coordinate `row` of path p at share f between times j and j + 1, by cubic Hermite."""
    f2, f3 = f * f, f * f * f
    h00, h10, h01, h11 = 2 * f3 - 3 * f2 + 1, f3 - 2 * f2 + f, 3 * f2 - 2 * f3, f3 - f2
    begin, end = paths[p, row, j], paths[p, row, j + 1]
    return h00 * begin + h10 * paths[p, VX + row, j] + h01 * end + h11 * paths[p, VX + row, j + 1]


@inlined
def turned(paths, p, i, j, f):
    """Cosine and sine between the headings at i and j, which are less than a right angle apart."""
    c0, s0 = paths[p, COS, i], paths[p, SIN, i]
    c, s = c0 + f * (paths[p, COS, j] - c0), s0 + f * (paths[p, SIN, j] - s0)
    n = math.sqrt(c * c + s * s)
    return (c / n, s / n) if n > 0.0 else (c0, s0)


@inner
def _part_that_touches(paths, a, b, j, half):
    """The share of step j at which its first part with contact begins, FREE where there is none."""
    turn, bulge = paths[a, TURN, j] + paths[b, TURN, j], paths[a, BULGE, j] + paths[b, BULGE, j]
    slack = turn / PARTS + bulge / (PARTS * PARTS)
    x0, y0 = paths[b, X, j] - paths[a, X, j], paths[b, Y, j] - paths[a, Y, j]
    for k in range(PARTS):
        f = (k + 1.0) / PARTS
        x1 = _place(paths, b, X, j, f) - _place(paths, a, X, j, f)
        y1 = _place(paths, b, Y, j, f) - _place(paths, a, Y, j, f)
        ac, as_ = turned(paths, a, j, j + 1, (k + 0.5) / PARTS)
        bc, bs = turned(paths, b, j, j + 1, (k + 0.5) / PARTS)
        if _swept((x0, y0, ac, as_, bc, bs), x1, y1, half, slack):
            return k / PARTS
        x0, y0 = x1, y1
    return FREE


@inlined
def _mid_poses(paths, a, b, j):
    """The pose at time j, with the mean headings of the step that begins there, and what both turn in it [m]."""
    return (
        paths[b, X, j] - paths[a, X, j], paths[b, Y, j] - paths[a, Y, j],
        paths[a, MID_COS, j], paths[a, MID_SIN, j], paths[b, MID_COS, j], paths[b, MID_SIN, j],
    ), paths[a, TURN, j] + paths[b, TURN, j]  # fmt: skip


@inlined
def surely_touch(paths, a, b, j, half):
    """Whether boxes overlap at time j, whatever they turn in the step that begins there."""
    pose, turn = _mid_poses(paths, a, b, j)
    return _apart(pose, half) + turn <= -CLEAR


@inlined
def _beyond(p0, p1):
    """How far from 0 an offset stays that goes from p0 to p1; below 0 where it passes 0."""
    return max(min(p0, p1), -max(p0, p1))


@inlined
def never_touch(paths, a, b, j, half):
    """Whether an axis of either box parts them for all of step j."""
    (x, y, ac, as_, bc, bs), turn = _mid_poses(paths, a, b, j)
    el, ew, tl, tw = half
    x1, y1 = paths[b, X, j + 1] - paths[a, X, j + 1], paths[b, Y, j + 1] - paths[a, Y, j + 1]
    # the mean of two headings is a little shorter than 1: offsets shrink, no contact is lost
    c, s = abs(ac * bc + as_ * bs), abs(ac * bs - as_ * bc)
    ahead = _beyond(ac * x + as_ * y, ac * x1 + as_ * y1) - (el + c * tl + s * tw)
    beside = _beyond(ac * y - as_ * x, ac * y1 - as_ * x1) - (ew + s * tl + c * tw)
    ahead_of_b = _beyond(bc * x + bs * y, bc * x1 + bs * y1) - (tl + c * el + s * ew)
    beside_b = _beyond(bc * y - bs * x, bc * y1 - bs * x1) - (tw + s * el + c * ew)
    return max(max(ahead, beside), max(ahead_of_b, beside_b)) > turn + paths[a, BULGE, j] + paths[b, BULGE, j]


@inlined
def touch_swept(paths, a, b, start, half):
    """A step from `start` on in which boxes touch, -1 where there is none; one that is sure goes before the first."""
    last = paths.shape[2] - 1
    maybe = surely = NONE  # found without a branch
    for j in range(max(start, 0), last):
        maybe = min(maybe, NONE if never_touch(paths, a, b, j, half) else j)
        surely = min(surely, j if surely_touch(paths, a, b, j, half) else NONE)
    if surely < NONE:
        return surely
    for j in range(maybe, last):
        if not never_touch(paths, a, b, j, half) and _part_that_touches(paths, a, b, j, half) < 1.0:
            return j
    return -1


@inlined
def first_swept(paths, a, b, start, half):
    """When boxes first touch, in steps, from step `start` on; -1 where they never do. Contact is never missed.

    Headings stand still within a part of a step, and the boxes grow by what they turn there.
    """
    for j in range(start, paths.shape[2] - 1):
        if surely_touch(paths, a, b, j, half):
            return float(j)
        if not never_touch(paths, a, b, j, half):
            f = _part_that_touches(paths, a, b, j, half)
            if f < 1.0:
                return j + f
    return -1.0
