"""The search of `resim.scenario.fit`, compiled by numba: natural splines, and damped Gauss-Newton steps.

A natural spline over knots (K,) is linear in its values there. What one of them moves fades by a factor of about four
from knot to knot: beyond REACH knots nothing is left of it, so that all that is done here grows with a trace's length,
but for pairs of columns of the normal equations.

What is compiled is kept on disk by the source of this module alone, so it takes nothing from others that may change,
and is one file, however long.
"""

# mypy: ignore-errors
from __future__ import annotations

import math
from collections import namedtuple

import numpy as np

from resim.core.compiled import entry, inner

REACH = 16
"""Knots to both sides of one beyond which its spline is 0: 0.27 to the power of 16."""
WINDOW = 256
"""Samples whose part of the normal equations is summed up at once."""

STEP = 0.02
"""Width [s] of the trapezoids (`resim.scenario.trace.STEP`)."""

MIN_SEGMENT = 0.1
"""Least time [s] between two knots (Eq. 5.5)."""
PIECE = 30.0
"""Length [s] of trace for each segment that is halved at a time."""
HEADING_OFF = 0.5
"""rad; how far off a measured heading may be, a priori: it speaks where positions say nothing."""
BEND_V, BEND_HEADING = 10.0, 0.5
"""m/s³, rad/s²; how much second derivatives of what drives are, a priori."""


Measured = namedtuple("Measured", "t place heading v nodes grid before own half")
"""The samples (T,): times, positions x + iy, headings, speeds; the rule of `resim.scenario.trace.Quadrature`.

What is called from outside takes it as a tuple: numba's cache would look for the class before it looks at the version.
"""

Candidate = namedtuple(
    "Candidate",
    "v p_v heading p_heading start weights direction motion off mean heading_off v_bend heading_bend cost",
)
"""Knots and values of both splines, the start [m], and what follows (`_evaluated`); vectors in the map are x + iy."""

Spline = namedtuple("Spline", "knots values bend weights grid between")
"""A spline: knots, values, second derivatives (K,). At the nodes: weights (4, T) of the values and second derivatives
at the segment's ends. The first node in each segment, of the grid and of those between (K,)."""


@inner
def _widths(knots):
    """Give the differences (K - 1,): numpy's own takes five seconds to compile."""
    out = np.empty(len(knots) - 1)
    for k in range(len(out)):
        out[k] = knots[k + 1] - knots[k]
    return out


@inner
def _first(values, least):
    """Give the first place in values (N,), which rise, with least or more: numpy's takes three seconds to compile."""
    low, high = 0, len(values)
    while low < high:
        middle = (low + high) // 2
        if values[middle] < least:
            low = middle + 1
        else:
            high = middle
    return low


@inner
def _solve(h, low, high, m):
    """Solve in place for second derivatives m of the inner knots low <= k <= high; those around them are 0."""
    above = np.empty(high - low + 1)
    before = 0.0
    for k in range(low, high + 1):
        below = 2.0 * (h[k - 1] + h[k]) - (h[k - 1] * before if k > low else 0.0)
        before = above[k - low] = h[k] / below
        m[k - low] = (m[k - low] - (h[k - 1] * m[k - low - 1] if k > low else 0.0)) / below
    for k in range(high - 1, low - 1, -1):
        m[k - low] -= above[k - low] * m[k - low + 1]


@entry()
def second(knots, values):
    """Give the second derivatives (K,) at the knots of the spline with these values (K,)."""
    count = len(knots)
    m = np.zeros(count)
    if count < 3:
        return m
    h = _widths(knots)
    for k in range(1, count - 1):
        m[k] = 6.0 * ((values[k + 1] - values[k]) / h[k] - (values[k] - values[k - 1]) / h[k - 1])
    _solve(h, np.int64(1), count - 2, m[1:-1])
    return m


@inner
def _columns(knots, values, move):
    """Give what the spline changes by: each value, and with `move` each inner knot's time at these values (K,).

    centre (C,): the knot. value, kink (C,), bend (C, 2 REACH + 1): the column is the spline with that value at its
    centre and these second derivatives around it, and in the segment after it, kink more at its centre.

    Moving knot j lets s(tau_j) slide along the curve and moves the jump of the third derivative: the derivative is
    -s'(tau_j) times the column of its value, plus the piecewise cubic that vanishes at all knots and whose second
    derivative jumps by s'''_j-1 - s'''_j at knot j.
    """
    count = len(knots)
    inner = max(count - 2, 0) if move else 0
    centre, value, kink = np.empty(count + inner, np.int64), np.empty(count + inner), np.zeros(count + inner)
    bend = np.zeros((count + inner, 2 * REACH + 1))
    h = _widths(knots)
    for i in range(count):
        centre[i], value[i] = i, 1.0
        low, high = max(i - REACH, 1), min(i + REACH, count - 2)
        if low > high:
            continue
        m = bend[i, low - i + REACH : high - i + REACH + 1]
        for k in range(max(low, i - 1), min(high, i + 1) + 1):
            if k == i:
                m[k - low] = -6.0 / h[i - 1] - 6.0 / h[i]
            else:
                m[k - low] = 6.0 / h[min(k, i)]
        _solve(h, low, high, m)
    if inner:
        m = second(knots, values)
        for j in range(1, count - 1):
            c = count + j - 1
            slope = (values[j + 1] - values[j]) / h[j] - h[j] * (2.0 * m[j] + m[j + 1]) / 6.0
            jump = (m[j] - m[j - 1]) / h[j - 1] - (m[j + 1] - m[j]) / h[j]
            low, high = max(j - REACH, 1), min(j + REACH, count - 2)
            own = bend[c, low - j + REACH : high - j + REACH + 1]
            own[j - low] = -2.0 * h[j] * jump
            if j < count - 2:
                own[j + 1 - low] = -h[j] * jump
            _solve(h, low, high, own)
            for k in range(2 * REACH + 1):
                bend[c, k] -= slope * bend[j, k]
            centre[c], value[c], kink[c] = j, -slope, jump
    return centre, value, kink, bend


@inner
def spline(knots, values, measured):
    """Give a spline at the nodes."""
    nodes, grid = measured.nodes, measured.grid
    count = len(knots)
    weights = np.empty((4, len(nodes)))
    firsts = np.empty((2, count), np.int64)
    for part in range(2):
        n, end = (0, grid) if part == 0 else (grid, len(nodes))
        firsts[part, 0] = 0
        begin = n
        for s in range(count - 1):
            h = knots[s + 1] - knots[s]
            while n < end and (nodes[n] < knots[s + 1] or s == count - 2):
                u, w = nodes[n] - knots[s], knots[s + 1] - nodes[n]
                weights[0, n], weights[1, n] = w / h, u / h
                weights[2, n], weights[3, n] = (w * w / h - h) * w / 6.0, (u * u / h - h) * u / 6.0
                n += 1
            firsts[part, s + 1] = n - begin
    return Spline(knots, values, second(knots, values), weights, firsts[0], firsts[1])


@inner
def at_nodes(spline, grid):
    """Give a spline at all nodes."""
    out = np.empty(spline.weights.shape[1])
    for part in range(2):
        firsts, begin = (spline.grid, 0) if part == 0 else (spline.between, grid)
        for s in range(len(spline.knots) - 1):
            a, b, c, d = spline.values[s], spline.values[s + 1], spline.bend[s], spline.bend[s + 1]
            for n in range(begin + firsts[s], begin + firsts[s + 1]):
                w = spline.weights
                out[n] = a * w[0, n] + b * w[1, n] + c * w[2, n] + d * w[3, n]
    return out


@inner
def _column(spline, column, firsts, begin, out):
    """Write a column, its centre, value, kink and bend, at the nodes of the segments around its centre, which begin at
    this node.
    """
    centre, value, kink, bend = column
    weights, count = spline.weights, len(spline.knots)
    low, high = max(centre - REACH - 1, 0), min(centre + REACH + 1, count - 1)
    start = firsts[low]
    for s in range(low, high):
        k = s - centre + REACH
        left = bend[k] if k >= 0 else 0.0
        right = bend[k + 1] if k + 1 <= 2 * REACH else 0.0
        if s == centre:
            left += kink
        first, last = firsts[s], firsts[s + 1]
        for n in range(first, last):
            out[n - start] = left * weights[2, begin + n] + right * weights[3, begin + n]
        if s == centre:
            for n in range(first, last):
                out[n - start] += value * weights[0, begin + n]
        elif s + 1 == centre:
            for n in range(first, last):
                out[n - start] += value * weights[1, begin + n]


@inner
def _nearest(measured, knots, ridge_bend, ridge):
    """Give matrix (K, K) and right sides (2, K) of the values of the splines nearest to the speeds and headings.

    ridge_bend, ridge: weights of the squares of second derivatives and of values.
    """
    count, own = len(knots), measured.own
    _, value, kink, bend = _columns(knots, np.zeros(count), bool(0))
    flat = spline(knots, np.zeros(count), measured)
    every = np.zeros((count, len(measured.t)))
    values, between = np.empty(measured.grid), np.empty(len(measured.nodes) - measured.grid)
    first, last = np.empty(count, np.int64), np.empty(count, np.int64)
    for i in range(count):
        column = (i, value[i], kink[i], bend[i])
        _column(flat, column, flat.grid, np.int64(0), values)
        _column(flat, column, flat.between, measured.grid, between)
        low, high = max(i - REACH - 1, 0), min(i + REACH + 1, count - 1)
        first[i] = _first(measured.t, knots[low]) if low > 0 else 0
        last[i] = _first(measured.t, knots[high]) if high < count - 1 else len(own)
        for n in range(first[i], last[i]):
            even = own[n] < measured.grid  # a time and its node may lie on two sides of a knot, by a rounding
            k = own[n] - flat.grid[low] if even else own[n] - measured.grid - flat.between[low]
            end = flat.grid[high] - flat.grid[low] if even else flat.between[high] - flat.between[low]
            if 0 <= k < end:
                every[i, n] = values[k] if even else between[k]
    normal, right = np.zeros((count, count)), np.zeros((2, count))
    for i in range(count):
        for j in range(i, min(i + 2 * REACH + 3, count)):
            total = 0.0
            for n in range(max(first[i], first[j]), min(last[i], last[j])):
                total += every[i, n] * every[j, n]
            for k in range(max(i, j) - REACH, min(i, j) + REACH + 1):
                total += ridge_bend * bend[i, k - i + REACH] * bend[j, k - j + REACH]
            normal[i, j] = normal[j, i] = total
        normal[i, i] += ridge
        for n in range(first[i], last[i]):
            right[0, i] += every[i, n] * measured.v[n]
            right[1, i] += every[i, n] * measured.heading[n]
    return normal, right


@inner
def _evaluated(measured, splines, noise):
    """Give a candidate of splines (knots and values of speed, the same of heading, the start x + iy [m]), and the
    positions' noise [m].

    weights: of the headings and of second derivatives of speed and heading, by the noise. direction (1 m long) and
    motion [m/s] at the nodes; how far off positions are (T,) [m], their mean distance; the rest of the residual,
    weighted: headings (T,), second derivatives (K,); cost, the sum of all squares.
    """
    v_knots, v_values, heading_knots, heading_values, start = splines
    by_heading, by_v, by_turn = weights = (noise / HEADING_OFF, noise / BEND_V, noise / BEND_HEADING)
    v, heading = spline(v_knots, v_values, measured), spline(heading_knots, heading_values, measured)
    speed, angle = at_nodes(v, measured.grid), at_nodes(heading, measured.grid)
    direction, motion = np.empty(len(speed), np.complex128), np.empty(len(speed), np.complex128)
    for n in range(len(speed)):
        direction[n] = math.cos(angle[n]) + 1j * math.sin(angle[n])
        motion[n] = speed[n] * direction[n]
    before, own, half = measured.before, measured.own, measured.half
    off, heading_off = np.empty(len(before), np.complex128), np.empty(len(before))
    total, k, cost, mean = motion[0], 0, 0.0, 0.0
    for n in range(len(before)):
        while k < before[n]:
            k += 1
            total += motion[k]
        place = (
            STEP * (total - 0.5 * motion[0]) + (half[n] - 0.5 * STEP) * motion[k] + half[n] * motion[own[n]]
        )
        off[n] = start + place - measured.place[n]
        heading_off[n] = by_heading * (angle[own[n]] - measured.heading[n])
        square = off[n].real ** 2 + off[n].imag ** 2
        cost += square + heading_off[n] ** 2
        mean += math.sqrt(square)
    bend_v, bend_heading = by_v * v.bend, by_turn * heading.bend
    for bend in (bend_v, bend_heading):
        for k in range(len(bend)):
            cost += bend[k] ** 2
    return Candidate(
        v_knots, v_values, heading_knots, heading_values, start, weights, direction, motion, off, mean / len(before),
        heading_off, bend_v, bend_heading, cost,
    )  # fmt: skip


@inner
def _place_column(even, more, measured, span, sums, out):
    """Write the positions' derivatives by a column at samples s0 <= n < s1 (span), and give it after them.

    even: the column at its nodes of the grid, the first of them, and what it is multiplied by there (2, ...); more: the
    same of the nodes between. sums (2, ...): for a time.
    """
    (values, g0, factor), (between, b0, factor_between), (s0, s1) = even, more, span
    before, own, half, grid, count = measured.before, measured.own, measured.half, measured.grid, len(values)
    x = y = 0.0
    for k in range(count):
        x += values[k] * factor[0, g0 + k]
        y += values[k] * factor[1, g0 + k]
        sums[0, k], sums[1, k] = x, y
    begin_x = begin_y = 0.0
    if g0 == 0 and count > 0:
        begin_x, begin_y = 0.5 * sums[0, 0], 0.5 * sums[1, 0]
    for n in range(s0, s1):
        k = before[n] - g0
        here_x = here_y = sum_x = sum_y = 0.0
        if 0 <= k < count:
            here_x, here_y = values[k] * factor[0, before[n]], values[k] * factor[1, before[n]]
        if k >= 0:
            sum_x, sum_y = sums[0, min(k, count - 1)], sums[1, min(k, count - 1)]
        there_x, there_y = here_x, here_y
        if own[n] >= grid:
            i = own[n] - grid - b0
            there_x = there_y = 0.0
            if 0 <= i < len(between):
                there_x = between[i] * factor_between[0, own[n] - grid]
                there_y = between[i] * factor_between[1, own[n] - grid]
        low, high = half[n] - 0.5 * STEP, half[n]
        out[n - s0, 0] = STEP * (sum_x - begin_x) + low * here_x + high * there_x
        out[n - s0, 1] = STEP * (sum_y - begin_y) + low * here_y + high * there_y
    return STEP * (x - begin_x), STEP * (y - begin_y)


@inner
def _normal_equations(measured, state, move):
    """Give normal matrix (P, P) and gradient (P,) of the residual by the values of speed (and, with `move`, times of
    inner knots), the same of heading, and the start.
    """
    v, heading = spline(state.v, state.p_v, measured), spline(state.heading, state.p_heading, measured)
    direction, motion, (by_heading, by_v, by_turn) = state.direction, state.motion, state.weights
    samples, grid, before, own = len(measured.before), measured.grid, measured.before, measured.own
    v_centre, v_value, v_kink, v_bends = _columns(v.knots, v.values, move)
    h_centre, h_value, h_kink, h_bends = _columns(heading.knots, heading.values, move)
    cv, ch = len(v_centre), len(h_centre)
    count = cv + ch + 2
    straight, turning = np.empty((2, len(motion))), np.empty((2, len(motion)))
    for n in range(len(motion)):
        straight[0, n], straight[1, n] = direction[n].real, direction[n].imag
        turning[0, n], turning[1, n] = -motion[n].imag, motion[n].real
    sums = np.empty((2, grid))
    s0, s1, offset = np.zeros(count, np.int64), np.zeros(count, np.int64), np.zeros(count + 1, np.int64)
    g, b = np.zeros((count, 2), np.int64), np.zeros((count, 2), np.int64)
    for i in range(cv + ch):
        own_spline, centre = (v, v_centre[i]) if i < cv else (heading, h_centre[i - cv])
        low, high = max(centre - REACH - 1, 0), min(centre + REACH + 1, len(own_spline.knots) - 1)
        g[i, 0], g[i, 1] = own_spline.grid[low], own_spline.grid[high]
        b[i, 0], b[i, 1] = own_spline.between[low], own_spline.between[high]
        s0[i], s1[i] = _first(before, g[i, 0] - 1), _first(before, g[i, 1])
        if high == len(own_spline.knots) - 1:
            s1[i] = samples
        offset[i + 1] = offset[i] + s1[i] - s0[i]
    offset[count] = offset[count - 1] = offset[cv + ch]
    places, angles = np.empty((offset[count], 2)), np.empty(offset[count])
    after = np.zeros((count, 2))
    after[count - 2, 0] = after[count - 1, 1] = 1.0
    scratch, scratch_between = np.empty(grid), np.empty(len(measured.nodes) - grid)
    for i in range(cv + ch):
        values, more = scratch[: g[i, 1] - g[i, 0]], scratch_between[: b[i, 1] - b[i, 0]]
        if i < cv:
            column = (v_centre[i], v_value[i], v_kink[i], v_bends[i])
            _column(v, column, v.grid, np.int64(0), values)
            _column(v, column, v.between, grid, more)
        else:
            column = (h_centre[i - cv], h_value[i - cv], h_kink[i - cv], h_bends[i - cv])
            _column(heading, column, heading.grid, np.int64(0), values)
            _column(heading, column, heading.between, grid, more)
            for n in range(s0[i], s1[i]):
                k = own[n] - g[i, 0] if own[n] < grid else own[n] - grid - b[i, 0]
                there = values if own[n] < grid else more
                angles[offset[i] + n - s0[i]] = by_heading * there[k] if 0 <= k < len(there) else 0.0
        factor = straight if i < cv else turning
        after[i, 0], after[i, 1] = _place_column(
            (values, g[i, 0], factor), (more, b[i, 0], factor[:, grid:]), measured, (s0[i], s1[i]), sums,
            places[offset[i] : offset[i + 1]],
        )  # fmt: skip
    normal, gradient = np.zeros((count, count)), np.zeros(count)
    columns = (cv, s0, s1, offset, places, angles, after)
    for w0 in range(0, samples, WINDOW):
        window = (w0, min(w0 + WINDOW, samples))
        _add_window(window, columns, state.off, state.heading_off, normal, gradient)
    _add_bends(np.int64(0), v_bends, state.v_bend, by_v, normal, gradient)
    _add_bends(cv, h_bends, state.heading_bend, by_turn, normal, gradient)
    return normal, gradient


@inner
def _products(rows, rest):
    """Give the products of the columns of rows (N, C) with each other, above the diagonal, and with rest (N,).

    N is a multiple of four. In a fixed order, as those of a library depend on the processor and on its threads.
    """
    count = rows.shape[1]
    products, along = np.zeros((count, count)), np.zeros(count)
    for n in range(0, len(rows), 4):  # four at a time take half as long
        r0, r1, r2, r3 = rows[n], rows[n + 1], rows[n + 2], rows[n + 3]
        for a in range(count):
            v0, v1, v2, v3, out = r0[a], r1[a], r2[a], r3[a], products[a]
            along[a] += v0 * rest[n] + v1 * rest[n + 1] + v2 * rest[n + 2] + v3 * rest[n + 3]
            for e in range(a, count):
                out[e] += v0 * r0[e] + v1 * r1[e] + v2 * r2[e] + v3 * r3[e]
    return products, along


@inner
def _add_window(window, columns, off, heading_off, normal, gradient):
    """Add the part of the samples w0 <= n < w1: columns that change in them, and those that changed before.

    columns: how many are of speed; first and last sample in which each changes (C,); where it begins in places and
    angles, its values there; what it is after them (C, 2).
    """
    (w0, w1), (cv, s0, s1, offset, places, angles, after) = window, columns
    count, size = len(s0), w1 - w0
    active, past = np.empty(count, np.int64), np.empty(count, np.int64)
    actives = pasts = turning = 0
    for c in range(count):
        if s1[c] <= w0:
            past[pasts] = c
            pasts += 1
        elif s0[c] < w1:
            active[actives] = c
            actives += 1
            turning += c >= cv
    whole = (size + 3) // 4 * 4
    rows, turns = np.zeros((2 * whole, actives)), np.zeros((whole, turning))
    straight = actives - turning
    for a in range(actives):
        c = active[a]
        for n in range(max(s0[c], w0), w1):
            if n < s1[c]:
                rows[2 * (n - w0), a] = places[offset[c] + n - s0[c], 0]
                rows[2 * (n - w0) + 1, a] = places[offset[c] + n - s0[c], 1]
                if a >= straight:
                    turns[n - w0, a - straight] = angles[offset[c] + n - s0[c]]
            else:
                rows[2 * (n - w0), a], rows[2 * (n - w0) + 1, a] = after[c, 0], after[c, 1]
    rest, headings, fore, aside = np.zeros(2 * whole), np.zeros(whole), 0.0, 0.0
    for n in range(size):
        rest[2 * n], rest[2 * n + 1] = off[w0 + n].real, off[w0 + n].imag
        fore += rest[2 * n]
        aside += rest[2 * n + 1]
        headings[n] = heading_off[w0 + n]
    products, along = _products(rows, rest)
    turned, angle = _products(turns, headings)
    for a in range(actives):
        gradient[active[a]] += along[a]
        for e in range(actives):
            normal[active[a], active[e]] += products[min(a, e), max(a, e)]
        if a >= straight:
            gradient[active[a]] += angle[a - straight]
            for e in range(straight, actives):
                normal[active[a], active[e]] += turned[min(a, e) - straight, max(a, e) - straight]
    sums = np.zeros((actives, 2))
    for a in range(actives):
        for n in range(size):
            sums[a, 0] += rows[2 * n, a]
            sums[a, 1] += rows[2 * n + 1, a]
    for c in past[:pasts]:
        gradient[c] += after[c, 0] * fore + after[c, 1] * aside
        for a in range(actives):
            both = after[c, 0] * sums[a, 0] + after[c, 1] * sums[a, 1]
            normal[c, active[a]] += both
            normal[active[a], c] += both
        for d in past[:pasts]:
            normal[c, d] += size * (after[c, 0] * after[d, 0] + after[c, 1] * after[d, 1])


@inner
def _add_bends(first, bends, residual, weight, normal, gradient):
    """Add the part of the second derivatives (K,), by the values at the knots."""
    count = len(residual)
    for i in range(count):
        for k in range(max(i - REACH, 0), min(i + REACH, count - 1) + 1):
            gradient[first + i] += weight * bends[i, k - i + REACH] * residual[k]
        for j in range(max(i - 2 * REACH, 0), min(i + 2 * REACH, count - 1) + 1):
            total = 0.0
            for k in range(max(i, j, REACH) - REACH, min(i, j) + REACH + 1):
                total += bends[i, k - i + REACH] * bends[j, k - j + REACH]
            normal[first + i, first + j] += weight * weight * total


@inner
def apart(knots):
    """Give the knots in their order with MIN_SEGMENT between them, ends fixed (Eq. 5.5)."""
    out, last, least = knots.copy(), len(knots) - 1, MIN_SEGMENT
    for k in range(1, last + 1):
        out[k] = max(out[k], out[k - 1] + least)
    out[last] = knots[last]
    for k in range(last - 1, -1, -1):
        out[k] = min(out[k], out[k + 1] - least)
    for k in range(last + 1):
        out[k] = min(max(out[k], knots[0] + k * least), knots[last] - (last - k) * least)
    return out


@inner
def halved(t, knots, values, error):
    """Give knots and values with the segment halved that has the largest squared error (T,) at times t (T,).

    Of a spline longer than PIECE one is halved in each so long part of it.
    """
    bend, count, least = second(knots, values), len(knots) - 1, MIN_SEGMENT
    squares = np.zeros(count)
    s = 0
    for n in range(len(error)):
        while s < count - 1 and t[n] >= knots[s + 1]:
            s += 1
        squares[s] += error[n] ** 2
    pieces = max(1, int((knots[-1] - knots[0]) / PIECE))
    size = (knots[-1] - knots[0]) / pieces
    worst, largest = np.full(pieces, -1), np.full(pieces, -1.0)
    for s in range(count):
        own = min(int((knots[s] - knots[0]) / size), pieces - 1)
        square = squares[s] if knots[s + 1] - knots[s] >= 2.0 * least else -1.0
        if worst[own] < 0 or square > largest[own]:
            worst[own], largest[own] = s, square
    chosen = np.zeros(count + 1, np.bool_)
    extra = 0
    for s in worst:
        if s >= 0 and knots[s + 1] - knots[s] >= 2.0 * least:
            chosen[s] = True
            extra += 1
    if extra == 0:
        chosen[max(worst[0], 0)] = True
        extra = 1
    new_knots, new_values = np.empty(count + 1 + extra), np.empty(count + 1 + extra)
    at = 0
    for k in range(count + 1):
        new_knots[k + at], new_values[k + at] = knots[k], values[k]
        if chosen[k]:
            width = knots[k + 1] - knots[k]
            at += 1
            new_knots[k + at] = 0.5 * (knots[k] + knots[k + 1])
            new_values[k + at] = 0.5 * (values[k] + values[k + 1]) - width**2 / 16.0 * (bend[k] + bend[k + 1])
    return apart(new_knots), new_values


@inner
def _solve_positive(matrix, right):
    """Solve for right (P,) in place by Cholesky; say whether the matrix (P, P), which is overwritten, is positive."""
    count = len(right)
    for k in range(count):
        if not matrix[k, k] > 0.0:
            return False
        pivot = math.sqrt(matrix[k, k])
        for j in range(k, count):
            matrix[k, j] /= pivot
        for i in range(k + 1, count):
            factor = matrix[k, i]
            for j in range(i, count):
                matrix[i, j] -= factor * matrix[k, j]
    for k in range(count):
        right[k] /= matrix[k, k]
        for j in range(k + 1, count):
            right[j] -= matrix[k, j] * right[k]
    for k in range(count - 1, -1, -1):
        for j in range(k + 1, count):
            right[k] -= matrix[k, j] * right[j]
        right[k] /= matrix[k, k]
    return True


@entry()
def even(measured, segments):
    """Give knots and values of speed, the same of heading, and the start x + iy [m], with evenly spaced knots and the
    measured speed and heading.
    """
    measured = Measured(*measured)
    t, knots = measured.t, np.empty(segments + 1)
    for k in range(segments + 1):
        knots[k] = t[0] + k * ((t[-1] - t[0]) / segments)
    knots[segments] = t[-1]
    matrix, right = _nearest(measured, knots, 1e-6 * len(t), 1e-9)
    again = matrix.copy()
    _solve_positive(matrix, right[0])
    _solve_positive(again, right[1])
    return knots, right[0].copy(), knots, right[1].copy(), measured.place[0]


@entry()
def split(t, splines, error):
    """Give splines and start (as `even`) after halving the segment with the largest squared error along the motion
    (error (T,), real) or across it (imaginary) at times t (T,), of a long trace one a PIECE.
    """
    v, p_v, heading, p_heading, start = splines
    new_v, new_p_v = halved(t, v, p_v, error.real)
    new_heading, new_p_heading = halved(t, heading, p_heading, error.imag)
    return new_v, new_p_v, new_heading, new_p_heading, start


@inner
def _moved(knots, values, delta, first, move):
    """Give knots and values after a step, and where in it the next spline's part begins."""
    count = len(values)
    if not move or count < 3:
        return knots, values + delta[first : first + count], first + count
    there = knots.copy()
    for k in range(1, count - 1):
        there[k] += delta[first + count + k - 1]
    return apart(there), values + delta[first : first + count], first + 2 * count - 2


@entry()
def improved(measured, splines, noise, rounds, move):
    """Take up to `rounds` Levenberg-Marquardt steps from splines and start (as `even`), with `move` of knots as well.

    measured: the fields of `Measured`. noise: of positions [m]. Gives the new splines and start; how far off positions
    are (T,), x + iy [m], the same along and across the motion; and their mean distance.
    """
    measured = Measured(*measured)
    state, damping = _evaluated(measured, splines, noise), 1e-2
    for _ in range(rounds):
        normal, gradient = _normal_equations(measured, state, move)
        better, trial = False, state
        for _ in range(4):
            damped, delta = normal.copy(), -gradient
            for k in range(len(delta)):
                damped[k, k] += damping * (normal[k, k] + 1e-9)
            if _solve_positive(damped, delta):
                v, p_v, first = _moved(state.v, state.p_v, delta, np.int64(0), move)
                heading, p_heading, first = _moved(state.heading, state.p_heading, delta, first, move)
                start = state.start + complex(delta[first], delta[first + 1])
                trial = _evaluated(measured, (v, p_v, heading, p_heading, start), noise)
                better = trial.cost < state.cost
                if better:
                    break
            damping *= 10.0
        if not better:
            break
        settled = state.cost - trial.cost < 1e-3 * state.cost
        state, damping = trial, damping * 0.1
        if settled:
            break
    error = np.empty(len(state.off), np.complex128)
    for n in range(len(error)):
        error[n] = state.off[n] * np.conj(state.direction[measured.own[n]])
    return (state.v, state.p_v, state.heading, state.p_heading, state.start), state.off, error, state.mean
