"""How things move: constant turn rate and acceleration, one path or all samples of an object at a time.

All paths of a scene are one array (P, ROWS, M + 1): the rows are named here, the columns are the times 0, h, ..., M h.
The samples of an object are (SAMPLED, M + 1, N), the first rows of N paths, so that one step of all of them is one
vector operation. Loops are bare and fill one row each, and arrays are handed on whole, with the number of the path:
that is what the compiler makes vector operations of, and a view of an array costs more than what is done with it.
start: where somebody is, the cosine and sine of his heading, and how fast he is: (x, y [m], cos, sin, v [m/s]).
w: see `work.Work`.
"""

# mypy: ignore-errors
from __future__ import annotations

import math

from resim.core.compiled import inlined, inner

X, Y, COS, SIN = 0, 1, 2, 3
VX, VY = 4, 5
"""Velocity times h: what a step would cover [m]."""
SAMPLED = 6
MID_COS, MID_SIN = 6, 7
"""The mean of the headings at both ends of the step that begins here."""
TURN, BULGE = 8, 9
"""Of the step that begins here [m]: how far a corner swings off the mean heading, how far the centre off its chord."""
ROWS = 10

SLOW = 0.05
"""Speed [m/s] up to which somebody stands, which way ever noise has him roll."""

ACCELERATING = 1.0
"""How long somebody walking changes speed and direction [s]."""


@inlined
def norm(x, y):
    """Length of a vector."""
    return math.sqrt(x * x + y * y)


@inner
def turning(rate, h):
    """Turn of one step and integrals over it: cos, sin of rate h, ∫ e^(i rate s) ds, ∫ s e^(i rate s) ds (re, im)."""
    u = rate * h
    q = u * u
    if q < 0.25:
        # (1 - cos u) / u^2 and (u - sin u) / u^3 by their series: what is left out is under 1e-16
        b = 0.5 * (
            1 - q * (1 / 12) * (1 - q * (1 / 30) * (1 - q * (1 / 56) * (1 - q * (1 / 90) * (1 - q / 132))))
        )
        d = (
            1 - q * (1 / 20) * (1 - q * (1 / 42) * (1 - q * (1 / 72) * (1 - q * (1 / 110) * (1 - q / 156))))
        ) / 6
        r = 1.0 - q * d
        return 1.0 - q * b, u * r, r * h, u * b * h, (r - b) * h * h, u * (b - d) * h * h
    c, s = math.cos(u), math.sin(u)
    r0, i0 = s / rate, (1.0 - c) / rate
    return c, s, r0, i0, h * r0 - i0 / rate, (r0 - h * c) / rate


@inlined
def halt(v, a, h, last):
    """The step 0..last in which speed v comes to 0 at acceleration a, and when within it [s]; last + 1 if in none.

    Who stands, or seems to roll back a little, stays at a < 0 and drives off ahead at a > 0.
    """
    if -SLOW <= v <= 0.0:
        return (0 if a < 0.0 else last + 1), 0.0
    if v * a >= 0.0:
        return last + 1, 0.0
    at = -v / a
    if at >= (last + 1) * h:
        return last + 1, 0.0
    step = int(at / h)
    return step, max(at - step * h, 0.0)


@inner
def ctra(start, inputs, h, stops, paths, p):
    """Fill rows X to VY of path p with constant turn rate and acceleration (Eq. 4.1).

    inputs: acceleration [m/s²] and turn rate [rad/s]. stops: who brakes stays where he stops.
    """
    x, y, cos, sin, v = start
    a, rate = inputs
    c, s, r0, i0, r1, i1 = turning(rate, h)
    last = paths.shape[2] - 1
    stop, part = halt(v, a, h, last) if stops else (last + 1, 0.0)
    for j in range(last + 1):
        paths[p, X, j], paths[p, Y, j], paths[p, COS, j], paths[p, SIN, j] = x, y, cos, sin
        paths[p, VX, j], paths[p, VY, j] = v * cos * h, v * sin * h
        if j > stop:
            continue
        if j == stop:
            c, s, r0, i0, r1, i1 = turning(rate, part)
        f, g = v * r0 + a * r1, v * i0 + a * i1
        x, y = x + cos * f - sin * g, y + sin * f + cos * g
        cos, sin = cos * c - sin * s, sin * c + cos * s
        v = v + a * h if j < stop else 0.0


@inner
def ctra_samples(start, w, count):
    """Fill w.samples with `count` motions of accelerations w.a and turn rates w.b.

    Swept, a braking object stays where it stops; else it goes on backwards, as Eq. 4.1 has it.
    """
    x, y, cos, sin, v = start
    a, rate, h, work, out = w.a, w.b, w.h, w.scratch, w.samples
    last = out.shape[1] - 1
    for i in range(count):
        c, s, r0, i0, r1, i1 = turning(rate[i], h)
        work[0, i], work[1, i] = c, s
        work[2, i], work[3, i] = v * r0 + a[i] * r1, v * i0 + a[i] * i1
        work[4, i], work[5, i] = a[i] * r0 * h, a[i] * i0 * h
        out[X, 0, i], out[Y, 0, i], out[COS, 0, i], out[SIN, 0, i] = x, y, cos, sin
    for j in range(last):
        for i in range(count):
            out[COS, j + 1, i] = out[COS, j, i] * work[0, i] - out[SIN, j, i] * work[1, i]
        for i in range(count):
            out[SIN, j + 1, i] = out[SIN, j, i] * work[0, i] + out[COS, j, i] * work[1, i]
        for i in range(count):
            f, g = work[2, i] + j * work[4, i], work[3, i] + j * work[5, i]
            out[X, j + 1, i] = out[X, j, i] + out[COS, j, i] * f - out[SIN, j, i] * g
        for i in range(count):
            f, g = work[2, i] + j * work[4, i], work[3, i] + j * work[5, i]
            out[Y, j + 1, i] = out[Y, j, i] + out[SIN, j, i] * f + out[COS, j, i] * g
    if not w.swept:
        return
    for j in range(last + 1):
        for i in range(count):
            out[VX, j, i] = out[COS, j, i] * ((v + a[i] * (j * h)) * h)
        for i in range(count):
            out[VY, j, i] = out[SIN, j, i] * ((v + a[i] * (j * h)) * h)
    for i in range(count):
        _stop(v, a[i], rate[i], h, out, i)


@inlined
def _stop(v, a, rate, h, out, i):
    """Let sample i stay where it comes to a stop."""
    last = out.shape[1] - 1
    stop, part = halt(v, a, h, last)
    if stop >= last:
        return
    c, s, r0, i0, r1, i1 = turning(rate, part)
    at, cos, sin = v + a * h * stop, out[COS, stop, i], out[SIN, stop, i]
    f, g = at * r0 + a * r1, at * i0 + a * i1
    x, y = out[X, stop, i] + cos * f - sin * g, out[Y, stop, i] + sin * f + cos * g
    cos, sin = cos * c - sin * s, sin * c + cos * s
    for j in range(stop + 1, last + 1):
        out[X, j, i], out[Y, j, i], out[COS, j, i], out[SIN, j, i] = x, y, cos, sin
        out[VX, j, i], out[VY, j, i] = 0.0, 0.0


@inner
def walk_samples(start, w, count):
    """Fill w.samples with `count` walks: accelerations w.a along and w.b across the heading for ACCELERATING s.

    After that the velocity is kept. The box keeps its heading.
    """
    x, y, cos, sin, v = start
    along, across, h, out = w.a, w.b, w.h, w.samples
    for j in range(out.shape[1]):
        t = min(j * h, ACCELERATING)
        moved = t * (j * h - 0.5 * t)
        for i in range(count):
            u, w = v * (j * h) + moved * along[i], moved * across[i]
            out[X, j, i], out[Y, j, i] = x + u * cos - w * sin, y + u * sin + w * cos
            out[COS, j, i], out[SIN, j, i] = cos, sin
            u, w = (v + t * along[i]) * h, t * across[i] * h
            out[VX, j, i], out[VY, j, i] = u * cos - w * sin, u * sin + w * cos


@inner
def finish(paths, p, first, radius):
    """Fill the rows of path p from MID_COS on, of the steps from `first` on; radius of the box [m]."""
    last = paths.shape[2] - 1
    for row in range(2):
        for j in range(max(first, 0), last):
            paths[p, MID_COS + row, j] = 0.5 * (paths[p, COS + row, j] + paths[p, COS + row, j + 1])
    for j in range(max(first, 0), last):
        dc, ds = paths[p, COS, j + 1] - paths[p, COS, j], paths[p, SIN, j + 1] - paths[p, SIN, j]
        paths[p, TURN, j] = 0.55 * radius * math.sqrt(dc * dc + ds * ds)
    for j in range(max(first, 0), last):
        dx, dy = paths[p, VX, j + 1] - paths[p, VX, j], paths[p, VY, j + 1] - paths[p, VY, j]
        paths[p, BULGE, j] = 0.125 * math.sqrt(dx * dx + dy * dy)
