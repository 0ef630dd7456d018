"""Motions that know the road: constant turn rate and acceleration in the straightened frame of a lane."""

# mypy: ignore-errors
from __future__ import annotations

import math

from resim.core.compiled import inlined, inner
from resim.metrics.risk.kernel.motion import COS, SIN, VX, VY, X, Y

STEP = 1.0  # as in `ways`
TIGHTEST = 0.2
"""Share of its length on the centre line that a way beside it keeps at least, in bends however tight."""


@inlined
def at_way(points, begin, end, s):
    """Where a way is at s [m] (x, y, cos, sin), its curvature [1/m] and its room [m]; straight on beyond its ends."""
    last = end - begin - 2
    i = min(max(int(s / STEP), 0), last)
    f = s / STEP - i
    g = min(max(f, 0.0), 1.0)
    p, q = begin + i, begin + i + 1
    x = points[p, 0] + g * (points[q, 0] - points[p, 0])
    y = points[p, 1] + g * (points[q, 1] - points[p, 1])
    c = points[p, 2] + g * (points[q, 2] - points[p, 2])
    n = points[p, 3] + g * (points[q, 3] - points[p, 3])
    norm = math.sqrt(c * c + n * n)
    c, n = c / norm, n / norm
    left = points[p, 5] + g * (points[q, 5] - points[p, 5])
    right = points[p, 6] + g * (points[q, 6] - points[p, 6])
    bend = points[p, 4] + g * (points[q, 4] - points[p, 4]) if f == g else 0.0
    return x + (f - g) * STEP * c, y + (f - g) * STEP * n, c, n, bend, left, right


@inner
def bend_samples(road, who, half, samples, out):
    """Lay samples (SAMPLED, M + 1, N), driven along +x of a straight road from 0, on the ways of an object.

    road: see `work.Road`. who: scene and column of the object; half: its half width [m]. The first samples drive the
    first way, and so on: each block of a Sobol sequence is spread evenly for itself.
    """
    points, begin = road.points, road.begin
    first, count, s0, d0 = road.first[who], road.count[who], road.s[who], road.d[who]
    for i in range(samples):
        way = first + i * count // samples
        p, q = begin[way], begin[way + 1]
        s, d, px, py = s0, d0, 0.0, 0.0
        x, y, c, n, bend, left, right = at_way(points, p, q, s)
        for j in range(out.shape[1]):
            dx, dy = out[X, j, i] - px, out[Y, j, i] - py
            px, py = out[X, j, i], out[Y, j, i]
            s += dx / max(1.0 - bend * d, TIGHTEST)
            x, y, c, n, bend, left, right = at_way(points, p, q, s)
            # who begins beyond the edge may stay as far out
            most, least = max(left - half, d0), min(half - right, d0)
            d += dy
            held = d > most or d < least
            d = min(max(d, least), most)
            u, w, vx, vy = out[COS, j, i], out[SIN, j, i], out[VX, j, i], out[VY, j, i]
            if held:
                u, w, vx, vy = 1.0, 0.0, math.copysign(math.sqrt(vx * vx + vy * vy), vx), 0.0
            out[X, j, i], out[Y, j, i] = x - n * d, y + c * d
            out[COS, j, i], out[SIN, j, i] = c * u - n * w, n * u + c * w
            out[VX, j, i], out[VY, j, i] = c * vx - n * vy, n * vx + c * vy
