"""The innermost work of `resim.road.path`, compiled by numba: AD functions ask for it several times a step.

What is compiled is kept on disk by the source of this module alone, so it takes nothing from others that may change.
"""

# mypy: ignore-errors
from __future__ import annotations

import math

import numpy as np
from numba import boolean, float64, int64, types

from resim.core.compiled import entry, inner

TRIES, TINY = 12, 1e-9
TABLE = types.Array(float64, 2, "C", readonly=True)
SEEN = types.Array(float64, 2, "A", readonly=True)
SEEN_ROW = types.Array(float64, 1, "A", readonly=True)


@entry((TABLE, int64, float64, float64))
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


@inner
def _nearest(score, x, y):
    """The segment whose middle is nearest, whence the right one is a step or none away."""
    best, least = 0, math.inf
    for k in range(len(score)):
        far = score[k, 0] * x + score[k, 1] * y + score[k, 2]
        if far < least:
            best, least = k, far
    return best


@entry((TABLE, TABLE, SEEN_ROW, SEEN_ROW))
def project(table, score, x, y):
    """Give (2, N) s and d of points x, y (N,); table and score: as in `track`."""
    out = np.empty((2, x.size))
    for n in range(x.size):
        out[0, n], out[1, n], _, _, _, _ = foot(table, _nearest(score, x[n], y[n]), x[n], y[n])
    return out


@entry((TABLE, TABLE, int64, float64, float64))
def track(table, score, i, x, y):
    """Give s, d, the heading [rad] and the segment of a moving point; i: the segment that it had before, or -1.

    table: as in `foot`. score (K + 1, 3): gives of (x, y, 1) the squared distance to the segments' middles, less a
    constant.
    """
    if i < 0:
        i = _nearest(score, x, y)
    s, d, tx, ty, i, found = foot(table, i, x, y)
    if not found:
        s, d, tx, ty, i, found = foot(table, _nearest(score, x, y), x, y)
    return s, d, math.atan2(ty, tx), i


@entry((TABLE, TABLE, int64[:, ::1], int64[::1], TABLE, float64[:, ::1]))
def track_all(tables, scores, spans, segments, places, out):
    """Fill out (3, B) with s, d and heading of B points, each by its own table: the rows of spans (B, 2) of the tables.

    places (B, 2 or more): x, y first. segments (B,): those that they had before, or -1; they get the new ones.
    """
    for b in range(len(places)):
        x, y = places[b, 0], places[b, 1]
        own = slice(spans[b, 0], spans[b, 1])
        out[0, b], out[1, b], out[2, b], segments[b] = track(tables[own], scores[own], segments[b], x, y)


@entry((
    TABLE, TABLE, int64[:, ::1], int64[:, ::1], TABLE, types.Array(int64, 1, "A", readonly=True),
    types.Array(int64, 2, "A", readonly=True), SEEN, SEEN, SEEN, SEEN, SEEN, SEEN, SEEN, float64, float64, float64,
    float64, float64[::1], float64[:, :, ::1], int64[:, ::1],
))  # fmt: skip
def along(tables, scores, spans, segments, ego, count, key, x_ego, y_ego, turn, v, length, width, z_ego,
          above, rise, behind, near, s, out, keys):  # fmt: skip
    """Find the objects of B lists along B paths: fill out (6, B, M) with s from the EGO's, d [m] on the path, speeds
    along and across it [m/s], half length and half width [m], and keys (B, M), rearmost first in the EGO's frame; what
    is behind the last is NaN and -1.

    tables, scores, spans: as in `track_all`. segments (B, C): those that objects had before, or -1, by their keys. ego
    (B, 6): x, y [m], heading [rad] first. count (B,), key, x_ego, y_ego [m], turn [rad], v [m/s], length, width, z_ego
    [m] (B, M): the lists. above, rise: who is higher or lower than so much [m], and so much [m per m] on the way, is
    left out; behind, near: so is who is farther behind, ahead or to a side than this [m]. s (B,) m: of the EGOs.
    """
    order = np.empty(key.shape[1], np.int64)
    for b in range(count.size):
        rows, n = slice(spans[b, 0], spans[b, 1]), 0
        table, score = tables[rows], scores[rows]
        for k in range(count[b]):
            far, aside = x_ego[b, k], y_ego[b, k]
            if far < -behind or far > near or abs(aside) > near:
                continue
            if abs(z_ego[b, k]) > above + rise * math.hypot(far, aside):
                continue
            at = n
            while at > 0 and x_ego[b, order[at - 1]] > far:
                order[at] = order[at - 1]
                at -= 1
            order[at] = k
            n += 1
        keys[b, n:], out[:, b, n:] = -1, np.nan
        cosine, sine = math.cos(ego[b, 2]), math.sin(ego[b, 2])
        for k in range(n):
            one = order[k]
            far, aside, own = x_ego[b, one], y_ego[b, one], key[b, one]
            x, y = ego[b, 0] + cosine * far - sine * aside, ego[b, 1] + sine * far + cosine * aside
            there, d, heading, segments[b, own] = track(table, score, segments[b, own], x, y)
            course = turn[b, one] + ego[b, 2] - heading
            out[0, b, k], out[1, b, k], keys[b, k] = there - s[b], d, own
            out[2, b, k], out[3, b, k] = v[b, one] * math.cos(course), v[b, one] * math.sin(course)
            out[4, b, k], out[5, b, k] = 0.5 * length[b, one], 0.5 * width[b, one]


@entry((
    boolean[:, ::1], float64[:, ::1], float64[::1], float64, float64, boolean[:, ::1],
))  # fmt: skip
def taken(there, between, went, corner, sample, known):
    """Fill known (S, K) with the steps of a route that a drive can be on at each sample; give the first sample at which
    there is none, K where there always is (`resim.road.driven_route`).

    there (S, K): the steps that it goes along. between (S, S): m, from the end of a step to the start of another. went
    (K,) m: its way by then. corner: how much longer the way may be than the drive's; sample [m]: what one may miss.
    """
    steps, count = there.shape
    at, before, latest, begun = np.zeros(steps, np.bool_), np.zeros(steps, np.bool_), 0.0, False
    for k in range(count):
        some = False
        for step in range(steps):
            some = some or there[step, k]
        if some and not begun:
            for step in range(steps):
                if there[step, k]:
                    at[step] = True
                    break
            begun, latest = True, went[k]
        elif some:
            begun = False
            for step in range(steps):
                before[step] = at[step]
            for step in range(steps):
                at[step] = False
                for other in range(steps):
                    if there[step, k] and before[other]:
                        at[step] = at[step] or between[other, step] <= corner * (went[k] - latest) + sample
                begun = begun or at[step]
            latest = went[k]
            if not begun:
                return k
        for step in range(steps - 1):  # where one lies on the next, it is on both
            if there[step + 1, k] and at[step]:
                at[step + 1] = True
        for step in range(steps):
            known[step, k] = at[step]
    return count


@entry((TABLE, float64[::1], float64[::1]))
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
