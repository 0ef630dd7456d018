"""The innermost work of `resim.road.path`, compiled by numba: AD functions ask for it several times a step.

What is compiled is kept on disk by the source of this module alone, so it takes nothing from others that may change.
"""

# mypy: ignore-errors
from __future__ import annotations

import math

import numpy as np
from numba import float64, int64, njit, types

TRIES, TINY = 12, 1e-9
TABLE = types.Array(float64, 2, "C", readonly=True)


def entry(*arguments):
    """Compile for these arguments at import, which is before any function's time limit runs."""
    return njit(arguments, cache=True, error_model="numpy")


@entry(TABLE, int64, float64, float64)
def foot(table, i, x, y):
    """Give s, d, the tangent tx, ty, the segment, and whether it is the right one, of a point sought from segment i.

    table (K + 1, 10): per segment s, P, T, its length, and what P and T gain over it. With a = p - P from the segment's
    start P, chord e, tangents T and T + dT:
    (a - f e) · (T + f dT) = 0, quadratic in f, and d = (T + f dT) x (a - f e) / |T + f dT|.
    """
    top, found = table.shape[0] - 1, False
    s = ax = ay = tx = ty = step = ex = ey = dtx = dty = f = 0.0
    for _ in range(TRIES):
        s, px, py, tx, ty, step, ex, ey, dtx, dty = table[i]
        ax, ay = x - px, y - py
        c0, c1 = ax * tx + ay * ty, ax * dtx + ay * dty - ex * tx - ey * ty
        square = c1 * c1 + 4.0 * c0 * (ex * dtx + ey * dty)
        below = (math.sqrt(square) if square > 0.0 else 0.0) - c1
        f = 2.0 * c0 / (below if below > TINY else TINY)
        if f < -TINY and i > 0:
            i -= 1
        elif f > 1.0 + TINY and i < top:
            i += 1
        else:
            found = True
            break
    tx, ty = tx + f * dtx, ty + f * dty
    d = (tx * (ay - f * ey) - ty * (ax - f * ex)) / math.sqrt(tx * tx + ty * ty)
    return s + f * step, d, tx, ty, i, found


@entry(TABLE, float64[::1], float64[::1])
def positions(table, s, d):
    """Give (2, N) the map positions x, y [m] at s (N,), d (N,) metres to the left; table: as in `foot`."""
    out = np.empty((2, s.size))
    for n in range(s.size):
        i = max(np.searchsorted(table[:, 0], s[n], side="right") - 1, 0)
        s0, px, py, tx, ty, step, ex, ey, dtx, dty = table[i]
        f = (s[n] - s0) / step
        tx, ty = tx + f * dtx, ty + f * dty
        across = d[n] / math.hypot(tx, ty)
        out[0, n], out[1, n] = px + f * ex - across * ty, py + f * ey + across * tx
    return out
