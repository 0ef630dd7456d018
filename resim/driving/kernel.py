"""Car following, steering to a path and planning for the EGOs of B runs, compiled by numba.

What is compiled is kept on disk by the source of this module alone, so it takes nothing from others that may change.
"""

# mypy: ignore-errors
from __future__ import annotations

import math

from numba import boolean, float64, int64, types

from resim.core.compiled import entry, inner

VECTOR = types.Array(float64, 1, "A", readonly=True)
TABLE = types.Array(float64, 2, "A", readonly=True)
KEYS = types.Array(int64, 2, "A", readonly=True)
FLAGS = types.Array(boolean, 1, "A", readonly=True)
NO_LEAD = math.inf
"""m; the gap to none."""


@inner
def time_to_collision(gap, closing, lead_a):
    """Give the time [s] until the gap [m] is gone, at this closing speed [m/s] and the lead's braking [m/s²]."""
    braking = max(-lead_a, 0.0)
    if braking < 0.1:
        return gap / closing if closing > 0.0 else math.inf
    return (-closing + math.sqrt(closing * closing + 2.0 * braking * gap)) / braking


@inner
def _remembered(known, v, t, last, cycle, smoothing):
    """The acceleration [m/s²] of an object from the speeds seen: known (3,) goes on (`mind`)."""
    t0, v0, a0 = t - cycle, v, 0.0
    if known[0] == last:
        t0, v0, a0 = last, known[1], known[2]
    a = a0 + smoothing * ((v - v0) / max(t - t0, 1e-3) - a0)
    known[0], known[1], known[2] = t, v, a
    return a


@entry((
    KEYS, TABLE, TABLE, TABLE, TABLE, TABLE, TABLE, VECTOR, VECTOR, types.UniTuple(float64, 5), float64[:, :, ::1],
    types.UniTuple(float64, 2), float64[:, ::1],
))  # fmt: skip
def mind(key, s, d, v_s, v_d, half_length, half_width, v, offset, how, known, when, out):
    """Fill out (4, B) of the vehicle to mind: the gap to it [m], NO_LEAD without one, its speed [m/s] and acceleration
    [m/s²], and how soon [s] the gap is gone.

    That is the nearest one ahead that reaches into the corridor about `offset` (B,) [m], or will by its drift.

    key, s, d, ...: (B, M) as `resim.road.paths.Along`. v (B,) m/s: of the EGOs. how: half width of the corridor [m];
    time [s] of drift; from the EGO's centre to its front [m]; cycle [s]; share of the new in smoothed accelerations.
    known (B, C, 3): when [s] each key was seen last, how fast [m/s], and its acceleration then; it goes on. when: now,
    and when the list before was [s]; who was not on it begins anew, seen a cycle ago.
    """
    width, horizon, front, cycle, smoothing = how
    for b in range(key.shape[0]):
        out[0, b], out[1, b], out[2, b], out[3, b] = NO_LEAD, 0.0, 0.0, math.inf
        least = math.inf
        for m in range(key.shape[1]):
            if key[b, m] < 0:
                break
            a = _remembered(known[b, key[b, m]], v_s[b, m], when[0], when[1], cycle, smoothing)
            if s[b, m] <= 0.0 or s[b, m] >= least:
                continue
            reach, drifted = width + half_width[b, m], d[b, m] + horizon * v_d[b, m]
            if abs(d[b, m] - offset[b]) < reach or abs(drifted - offset[b]) < reach:
                least = s[b, m]
                out[0, b], out[1, b], out[2, b] = max(least - half_length[b, m] - front, 0.1), v_s[b, m], a
        if least < math.inf:
            out[3, b] = time_to_collision(out[0, b], v[b] - out[1, b], out[2, b])


@entry((VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, FLAGS, types.UniTuple(float64, 4), float64[::1]))
def follow(v, desired, gap, lead_v, lead_a, hard, limits, out):
    """Fill out (B,) with accelerations [m/s²]: towards the desired speed, bounded by the gap ahead.

    v, desired, lead_v [m/s], gap [m], lead_a [m/s²] (B,). hard (B,): who brakes as hard as it takes. limits: standstill
    gap [m], time gap [s], comfortable and hardest braking [m/s²].
    """
    standstill_gap, time_gap, comfort, hardest = limits
    for b in range(v.size):
        free = min(max(0.6 * (desired[b] - v[b]), -comfort), 1.5)
        out[b] = free
        if gap[b] == NO_LEAD:
            continue
        closing = v[b] - lead_v[b]
        keep = 0.25 * (gap[b] - (standstill_gap + time_gap * v[b])) - 0.9 * closing
        if closing < 0.0:  # the gap opens: no need to brake for it
            keep = max(keep, -0.3)
        out[b] = min(free, max(keep, -comfort))
        if hard[b]:
            room, towards = max(gap[b] - standstill_gap, 0.5), max(closing, 0.0)
            needed = max(-lead_a[b], 0.0) + towards * towards / (2.0 * room)
            out[b] = max(min(out[b], -1.1 * needed), -hardest)


@entry((VECTOR, VECTOR, VECTOR, VECTOR, TABLE, float64[::1]))
def steer(v, d, turn, bend, aim, out):
    """Fill out (B,) with the curvatures [1/m] that bring EGOs back, critically damped at 0.8 rad/s at any speed.

    v (B,) m/s. d (B,) m, turn (B,) rad: where they are left of the path and how they stand against it. bend (B,) 1/m:
    the path's curvature. aim (3, B): where to be left of the path [m], and its first and second derivative.
    """
    omega = 0.8
    for b in range(v.size):
        fast = max(v[b], 3.0)
        off, slant = d[b] - aim[0, b], fast * math.sin(turn[b]) - aim[1, b]
        out[b] = bend[b] + (aim[2, b] - omega * omega * off - 2.0 * omega * slant) / (fast * fast)


@entry((float64, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, float64[:, :, ::1], float64[:, :, ::1]))
def plan(t, v, a, s, d, ahead, left, out, places):
    """Fill in times [s] and speeds [m/s] of plans out (B, K, 4), and places (2, B, K): s and d [m] on the paths by
    then.

    t: now [s]. v [m/s], a [m/s²] (B,): braking ends at standstill. s, d (B,): now. ahead (K,): s from now; left (K,):
    what is left of d by then.
    """
    for b in range(v.size):
        begin = max(v[b], 0.0)
        for k in range(ahead.size):
            driving = min(ahead[k], begin / -a[b]) if a[b] < 0.0 else ahead[k]  # until it stands
            speed = max(begin + a[b] * driving, 0.0)  # a rounding below 0 would be reversing
            out[b, k, 0], out[b, k, 3] = t + ahead[k], speed
            places[0, b, k], places[1, b, k] = s[b] + 0.5 * (begin + speed) * driving, d[b] * left[k]
