"""The innermost work of `resim.scenario.fit`, compiled by numba: natural splines, and the normal equations of a fit.

A natural spline over knots (K,) is linear in its values there. What one of them moves fades by a factor of about four
from knot to knot: beyond REACH knots nothing is left of it, so that all that is done here grows with a trace's length,
but for pairs of columns of the normal equations.

What is compiled is kept on disk by the source of this module alone, so it takes nothing from others that may change.
"""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np
from numba import njit

REACH = 16
"""Knots to both sides of one beyond which its spline is 0: 0.27 to the power of 16."""
WINDOW = 256
"""Samples whose part of the normal equations is one product of matrices."""

compiled = njit(cache=True, error_model="numpy")


@compiled
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


@compiled
def second(knots, values):
    """Give the second derivatives (K,) at the knots of the spline with these values (K,)."""
    count = len(knots)
    m = np.zeros(count)
    if count < 3:
        return m
    h = np.diff(knots)
    for k in range(1, count - 1):
        m[k] = 6.0 * ((values[k + 1] - values[k]) / h[k] - (values[k] - values[k - 1]) / h[k - 1])
    _solve(h, 1, count - 2, m[1:-1])
    return m


@compiled
def at(knots, values, nodes):
    """Give the spline with these values (K,) at nodes (T,), in any order."""
    m, inner = second(knots, values), knots[1:-1]
    out = np.empty(len(nodes))
    for n in range(len(nodes)):
        s = np.searchsorted(inner, nodes[n], side="right")
        h = knots[s + 1] - knots[s]
        u, w = nodes[n] - knots[s], knots[s + 1] - nodes[n]
        out[n] = (
            values[s] * w + values[s + 1] * u
            + (m[s] * (w * w - h * h) * w + m[s + 1] * (u * u - h * h) * u) / 6.0
        ) / h  # fmt: skip
    return out


@compiled
def columns(knots, values, move):
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
    h = np.diff(knots)
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


@compiled
def _column(knots, nodes, first, last, segment, centre, value, kink, bend, out):
    """Write a column at the sorted nodes first <= n < last, the first of which is in this segment or after it."""
    inner, s = knots[1:-1], segment
    for n in range(first, last):
        while s < len(inner) and inner[s] <= nodes[n]:
            s += 1
        h = knots[s + 1] - knots[s]
        u, w = nodes[n] - knots[s], knots[s + 1] - nodes[n]
        k = s - centre + REACH
        left = bend[k] if 0 <= k <= 2 * REACH else 0.0
        right = bend[k + 1] if 0 <= k + 1 <= 2 * REACH else 0.0
        if s == centre:
            left += kink
        f = left * (w * w - h * h) * w / 6.0 + right * (u * u - h * h) * u / 6.0
        if s == centre:
            f += value * w
        elif s + 1 == centre:
            f += value * u
        out[n - first] = f / h


@compiled
def _support(knots, centre):
    """Give the first segment in which a column is not 0, and when [s] it begins to be, and ends."""
    low, high = max(centre - REACH - 1, 0), min(centre + REACH + 1, len(knots) - 1)
    return low, (knots[low] if low > 0 else -np.inf), (knots[high] if high < len(knots) - 1 else np.inf)


@compiled
def start(knots, times, targets, ridge_bend, ridge):
    """Give the values (K, 2) of the two splines nearest to targets (T, 2) at times (T,) [s], which increase.

    ridge_bend, ridge: weights of the squares of second derivatives and of values.
    """
    count = len(knots)
    _, value, kink, bend = columns(knots, np.zeros(count), False)
    first, last = np.empty(count, np.int64), np.empty(count, np.int64)
    for i in range(count):
        _, begin, end = _support(knots, i)
        first[i], last[i] = np.searchsorted(times, begin), np.searchsorted(times, end)
    each = np.zeros((count, (last - first).max()))
    for i in range(count):
        segment, _, _ = _support(knots, i)
        _column(knots, times, first[i], last[i], segment, i, value[i], kink[i], bend[i], each[i])
    normal, right = np.zeros((count, count)), np.zeros((count, 2))
    for i in range(count):
        for j in range(i, min(i + 2 * REACH + 3, count)):
            total = 0.0
            for n in range(max(first[i], first[j]), min(last[i], last[j])):
                total += each[i, n - first[i]] * each[j, n - first[j]]
            for k in range(max(i, j) - REACH, min(i, j) + REACH + 1):
                total += ridge_bend * bend[i, k - i + REACH] * bend[j, k - j + REACH]
            normal[i, j] = normal[j, i] = total
        normal[i, i] += ridge
        for n in range(first[i], last[i]):
            right[i, 0] += each[i, n - first[i]] * targets[n, 0]
            right[i, 1] += each[i, n - first[i]] * targets[n, 1]
    return np.linalg.solve(normal, right)


@compiled
def positions(motion, grid, before, own, half, step):
    """Give the integrals (T,) of a motion at the nodes, as `resim.scenario.trace.Quadrature` does."""
    out = np.empty(len(before), np.complex128)
    total, k = motion[0], 0
    for n in range(len(before)):
        while k < before[n]:
            k += 1
            total += motion[k]
        out[n] = (
            step * (total - 0.5 * motion[0]) + (half[n] - 0.5 * step) * motion[before[n]] + half[n] * motion[own[n]]
        )  # fmt: skip
    return out


@compiled
def _place_column(values, between, g0, b0, factor, grid, before, own, half, step, s0, s1, out):
    """Write the positions' derivatives by a column at samples s0 <= n < s1; gives it after them.

    values, between: the column at its nodes of the grid, from g0 on, and at those between, from b0 on.
    """
    total = 0j
    begin = values[0] * factor[0] if g0 == 0 and len(values) > 0 else 0j
    k, end = g0 - 1, g0 + len(values) - 1
    for n in range(s0, s1):
        while k < before[n] and k < end:
            k += 1
            total += values[k - g0] * factor[k]
        here = values[before[n] - g0] * factor[before[n]] if g0 <= before[n] <= end else 0j
        there = here
        if own[n] >= grid:
            i = own[n] - grid - b0
            there = between[i] * factor[own[n]] if 0 <= i < len(between) else 0j
        place = step * (total - 0.5 * begin) + (half[n] - 0.5 * step) * here + half[n] * there
        out[n - s0, 0], out[n - s0, 1] = place.real, place.imag
    while k < end:
        k += 1
        total += values[k - g0] * factor[k]
    return step * (total - 0.5 * begin)


@compiled
def normal_equations(
    v_knots, p_v, h_knots, p_h, move, nodes, grid, before, own, half, step, direction, motion, off, heading_off,
    v_bend, h_bend, by_heading, by_v_bend, by_h_bend,
):  # fmt: skip
    """Give normal matrix (P, P) and gradient (P,) of the residual by the values of speed (and, with `move`, times of
    inner knots), the same of heading, and the start.

    nodes: `grid` sorted ones, then sorted ones between. before, own, half, step: of the rule. direction, motion: at the
    nodes. off (T,): of positions. heading_off (T,), v_bend, h_bend (K,): the rest of the residual, whose derivatives
    have the weights by_heading, by_v_bend, by_h_bend.
    """
    samples, between = len(before), nodes[grid:]
    evenly = nodes[:grid]
    v_centre, v_value, v_kink, v_bends = columns(v_knots, p_v, move)
    h_centre, h_value, h_kink, h_bends = columns(h_knots, p_h, move)
    cv, ch = len(v_centre), len(h_centre)
    count = cv + ch + 2
    turning = 1j * motion
    s0, s1, offset = np.zeros(count, np.int64), np.zeros(count, np.int64), np.zeros(count + 1, np.int64)
    g, b = np.zeros((count, 2), np.int64), np.zeros((count, 2), np.int64)
    for c in range(cv + ch):
        if c < cv:
            _, begin, end = _support(v_knots, v_centre[c])
        else:
            _, begin, end = _support(h_knots, h_centre[c - cv])
        g[c, 0], g[c, 1] = np.searchsorted(evenly, begin), np.searchsorted(evenly, end)
        b[c, 0], b[c, 1] = np.searchsorted(between, begin), np.searchsorted(between, end)
        s0[c], s1[c] = np.searchsorted(before, g[c, 0] - 1), np.searchsorted(before, g[c, 1])
        offset[c + 1] = offset[c] + s1[c] - s0[c]
    offset[count] = offset[count - 1] = offset[cv + ch]
    places, angles = np.empty((offset[count], 2)), np.empty(offset[count])
    after = np.zeros((count, 2))
    after[count - 2, 0] = after[count - 1, 1] = 1.0
    scratch, scratch_between = np.empty(grid), np.empty(len(between))
    for c in range(cv + ch):
        values, more = scratch[: g[c, 1] - g[c, 0]], scratch_between[: b[c, 1] - b[c, 0]]
        if c < cv:
            knots, centre, value, kink, bend = v_knots, v_centre[c], v_value[c], v_kink[c], v_bends[c]
        else:
            knots, centre, value, kink, bend = (
                h_knots, h_centre[c - cv], h_value[c - cv], h_kink[c - cv], h_bends[c - cv],
            )  # fmt: skip
        segment, _, _ = _support(knots, centre)
        _column(knots, evenly, g[c, 0], g[c, 1], segment, centre, value, kink, bend, values)
        _column(knots, between, b[c, 0], b[c, 1], segment, centre, value, kink, bend, more)
        mine = slice(offset[c], offset[c + 1])
        end = _place_column(
            values, more, g[c, 0], b[c, 0], direction if c < cv else turning, grid, before, own, half, step,
            s0[c], s1[c], places[mine],
        )  # fmt: skip
        after[c, 0], after[c, 1] = end.real, end.imag
        if c >= cv:
            for n in range(s0[c], s1[c]):
                i = own[n] - g[c, 0] if own[n] < grid else own[n] - grid - b[c, 0]
                there = values if own[n] < grid else more
                angles[offset[c] + n - s0[c]] = by_heading * there[i] if 0 <= i < len(there) else 0.0
    normal, gradient = np.zeros((count, count)), np.zeros(count)
    for w0 in range(0, samples, WINDOW):
        _add_window(
            w0, min(w0 + WINDOW, samples), cv, s0, s1, offset, places, angles, after, off, heading_off,
            normal, gradient,
        )  # fmt: skip
    _add_bends(len(v_knots), 0, v_bends, v_bend, by_v_bend, normal, gradient)
    _add_bends(len(h_knots), cv, h_bends, h_bend, by_h_bend, normal, gradient)
    return normal, gradient


@compiled
def _add_window(
    w0, w1, cv, s0, s1, offset, places, angles, after, off, heading_off, normal, gradient
):  # fmt: skip
    """Add the part of the samples w0 <= n < w1: columns that change in them, and those that changed before."""
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
    rows, turns = np.zeros((actives, 2 * size)), np.zeros((turning, size))
    straight = actives - turning
    for a in range(actives):
        c = active[a]
        for n in range(max(s0[c], w0), w1):
            if n < s1[c]:
                rows[a, 2 * (n - w0)] = places[offset[c] + n - s0[c], 0]
                rows[a, 2 * (n - w0) + 1] = places[offset[c] + n - s0[c], 1]
                if a >= straight:
                    turns[a - straight, n - w0] = angles[offset[c] + n - s0[c]]
            else:
                rows[a, 2 * (n - w0)], rows[a, 2 * (n - w0) + 1] = after[c, 0], after[c, 1]
    rest = np.empty(2 * size)
    fore, aside = 0.0, 0.0
    for n in range(size):
        rest[2 * n], rest[2 * n + 1] = off[w0 + n].real, off[w0 + n].imag
        fore += rest[2 * n]
        aside += rest[2 * n + 1]
    products, along = np.dot(rows, rows.T), np.dot(rows, rest)
    turned, angle = np.dot(turns, turns.T), np.dot(turns, heading_off[w0:w1])
    for a in range(actives):
        gradient[active[a]] += along[a]
        for e in range(actives):
            normal[active[a], active[e]] += products[a, e]
        if a >= straight:
            gradient[active[a]] += angle[a - straight]
            for e in range(straight, actives):
                normal[active[a], active[e]] += turned[a - straight, e - straight]
    sums = np.zeros((actives, 2))
    for a in range(actives):
        for n in range(size):
            sums[a, 0] += rows[a, 2 * n]
            sums[a, 1] += rows[a, 2 * n + 1]
    for p in range(pasts):
        c = past[p]
        gradient[c] += after[c, 0] * fore + after[c, 1] * aside
        for a in range(actives):
            both = after[c, 0] * sums[a, 0] + after[c, 1] * sums[a, 1]
            normal[c, active[a]] += both
            normal[active[a], c] += both
        for q in range(pasts):
            d = past[q]
            normal[c, d] += size * (after[c, 0] * after[d, 0] + after[c, 1] * after[d, 1])


@compiled
def _add_bends(count, first, bends, residual, weight, normal, gradient):
    """Add the part of the second derivatives, by the values at the knots."""
    for i in range(count):
        for k in range(max(i - REACH, 0), min(i + REACH, count - 1) + 1):
            gradient[first + i] += weight * bends[i, k - i + REACH] * residual[k]
        for j in range(max(i - 2 * REACH, 0), min(i + 2 * REACH, count - 1) + 1):
            total = 0.0
            for k in range(max(i, j, REACH) - REACH, min(i, j) + REACH + 1):
                total += bends[i, k - i + REACH] * bends[j, k - j + REACH]
            normal[first + i, first + j] += weight * weight * total
