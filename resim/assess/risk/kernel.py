"""The accident-risk kernel: Monte-Carlo prediction, contact, time to react (Wagner 2021, 4.1), compiled by numba.

One call works through all scenes. Poses are x, y, cos, sin; every grid has M + 1 times 0, h, ..., M h.
"""

# mypy: ignore-errors
from __future__ import annotations

import math

import numpy as np
from numba import njit

LEFT, RIGHT, BRAKE, ACCELERATE = 0, 1, 2, 3
FREE = np.inf


@njit(cache=True, error_model="numpy")
def _norm(x, y):
    return math.sqrt(x * x + y * y)


@njit(cache=True, error_model="numpy")
def _integrals(rate, h):
    """I0 = ∫ e^(i rate s) ds and I1 = ∫ s e^(i rate s) ds over 0..h, as (re, im, re, im)."""
    u = rate * h
    if abs(u) < 0.5:
        # Taylor series: eight terms leave under 1e-16 of h
        r0 = i0 = r1 = i1 = 0.0
        term = 1.0  # u^k / k!
        for k in range(14):
            a, b = term / (k + 1), term / (k + 2)
            quarter = k & 3
            if quarter == 0:
                r0 += a
                r1 += b
            elif quarter == 1:
                i0 += a
                i1 += b
            elif quarter == 2:
                r0 -= a
                r1 -= b
            else:
                i0 -= a
                i1 -= b
            term *= u / (k + 1)
        return r0 * h, i0 * h, r1 * h * h, i1 * h * h
    c, s = math.cos(u), math.sin(u)
    r0, i0 = s / rate, (1.0 - c) / rate
    r1 = (h * s) / rate + (c - 1.0) / (rate * rate)
    i1 = -(h * c) / rate + s / (rate * rate)
    return r0, i0, r1, i1


@njit(cache=True, error_model="numpy")
def _ctra(x, y, cos, sin, v, a, rate, h, stops, out):
    """Fill out (M + 1, 6): x, y, cos, sin, vx, vy of constant turn rate and acceleration (Eq. 4.1).

    stops: a braking object stays where it stops; else it goes on backwards, as Eq. 4.1 has it.
    """
    r0, i0, r1, i1 = _integrals(rate, h)
    tc, ts = math.cos(rate * h), math.sin(rate * h)
    last = out.shape[0] - 1
    for j in range(last + 1):
        out[j, 0], out[j, 1], out[j, 2], out[j, 3] = x, y, cos, sin
        out[j, 4], out[j, 5] = v * cos, v * sin
        if j == last:
            break
        if stops and v + a * h < 0.0:
            if v > 0.0:
                part = -v / a
                p0, q0, p1, q1 = _integrals(rate, part)
                dx, dy = v * p0 + a * p1, v * q0 + a * q1
                x, y = x + cos * dx - sin * dy, y + sin * dx + cos * dy
                pc, ps = math.cos(rate * part), math.sin(rate * part)
                cos, sin = cos * pc - sin * ps, sin * pc + cos * ps
            v = 0.0
            continue
        dx, dy = v * r0 + a * r1, v * i0 + a * i1
        x, y = x + cos * dx - sin * dy, y + sin * dx + cos * dy
        cos, sin = cos * tc - sin * ts, sin * tc + cos * ts
        v += a * h


@njit(cache=True, error_model="numpy")
def _corner_inside(ax, ay, ac, as_, al, aw, bx, by, bc, bs, bl, bw):
    """Whether a corner of box a lies in box b; half lengths and widths."""
    dx, dy = ax - bx, ay - by
    px, py = bc * dx + bs * dy, bc * dy - bs * dx
    c, s = ac * bc + as_ * bs, as_ * bc - ac * bs
    lx, ly, wx, wy = c * al, s * al, -s * aw, c * aw
    return (
        (abs(px + lx + wx) <= bl and abs(py + ly + wy) <= bw)
        or (abs(px + lx - wx) <= bl and abs(py + ly - wy) <= bw)
        or (abs(px - lx + wx) <= bl and abs(py - ly + wy) <= bw)
        or (abs(px - lx - wx) <= bl and abs(py - ly - wy) <= bw)
    )


@njit(cache=True, error_model="numpy")
def _corners(dx, dy, ac, as_, bc, bs, el, ew, tl, tw):
    """The published test (Algorithm 4.1): corners of either box in the other; b at (dx, dy) from a."""
    # a corner inside means overlap: boxes that an axis of either parts need no look at corners
    c, s = abs(ac * bc + as_ * bs), abs(ac * bs - as_ * bc)
    if abs(ac * dy - as_ * dx) > ew + s * tl + c * tw or abs(ac * dx + as_ * dy) > el + c * tl + s * tw:
        return False
    if abs(bc * dy - bs * dx) > tw + s * el + c * ew or abs(bc * dx + bs * dy) > tl + c * el + s * ew:
        return False
    return _corner_inside(dx, dy, bc, bs, tl, tw, 0.0, 0.0, ac, as_, el, ew) or _corner_inside(
        0.0, 0.0, ac, as_, el, ew, dx, dy, bc, bs, tl, tw
    )


@njit(cache=True, error_model="numpy")
def _slab(p0, p1, r, low, high):
    """The part of low..high in which |p0 + s (p1 - p0)| <= r; empty as (1, 0)."""
    d = p1 - p0
    if abs(d) < 1e-12:
        return (low, high) if abs(p0) <= r else (1.0, 0.0)
    s0, s1 = (-r - p0) / d, (r - p0) / d
    if s0 > s1:
        s0, s1 = s1, s0
    return max(low, s0), min(high, s1)


@njit(cache=True, error_model="numpy")
def _swept(x0, y0, x1, y1, ac, as_, bc, bs, el, ew, tl, tw, slack):
    """Whether boxes of fixed headings touch while b moves relative to a from (x0, y0) to (x1, y1)."""
    c, s = abs(ac * bc + as_ * bs), abs(ac * bs - as_ * bc)
    low, high = 0.0, 1.0
    low, high = _slab(ac * x0 + as_ * y0, ac * x1 + as_ * y1, el + c * tl + s * tw + slack, low, high)
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


@njit(cache=True, error_model="numpy")
def _part(a, j, f):
    """The place at share f between rows j and j + 1, by cubic Hermite; rows of x, y, cos, sin, vx h, vy h."""
    f2, f3 = f * f, f * f * f
    h00, h10, h01, h11 = 2 * f3 - 3 * f2 + 1, f3 - 2 * f2 + f, 3 * f2 - 2 * f3, f3 - f2
    return (
        h00 * a[j, 0] + h10 * a[j, 4] + h01 * a[j + 1, 0] + h11 * a[j + 1, 4],
        h00 * a[j, 1] + h10 * a[j, 5] + h01 * a[j + 1, 1] + h11 * a[j + 1, 5],
    )


@njit(cache=True, error_model="numpy")
def _turned(a, i, j, f):
    """Cosine and sine between two headings that are less than a right angle apart."""
    c, s = a[i, 2] + f * (a[j, 2] - a[i, 2]), a[i, 3] + f * (a[j, 3] - a[i, 3])
    n = math.sqrt(c * c + s * s)
    return (c / n, s / n) if n > 0.0 else (a[i, 2], a[i, 3])


PARTS = 4


@njit(cache=True, error_model="numpy")
def _parted(p0, p1, r):
    """Whether an offset that goes from p0 to p1 stays beyond r on one side."""
    return (p0 > r and p1 > r) or (p0 < -r and p1 < -r)


@njit(cache=True, error_model="numpy")
def _may_touch(x0, y0, x1, y1, ac, as_, bc, bs, el, ew, tl, tw, slack):
    """Whether no axis of either box (of fixed headings) parts them for the whole step."""
    c, s = abs(ac * bc + as_ * bs), abs(ac * bs - as_ * bc)
    return not (
        _parted(ac * y0 - as_ * x0, ac * y1 - as_ * x1, ew + s * tl + c * tw + slack)
        or _parted(ac * x0 + as_ * y0, ac * x1 + as_ * y1, el + c * tl + s * tw + slack)
        or _parted(bc * y0 - bs * x0, bc * y1 - bs * x1, tw + s * el + c * ew + slack)
        or _parted(bc * x0 + bs * y0, bc * x1 + bs * y1, tl + c * el + s * ew + slack)
    )


@njit(cache=True, error_model="numpy")
def _part_that_touches(a, b, j, x0, y0, el, ew, tl, tw, slack):
    for k in range(PARTS):
        pa, pb = _part(a, j, (k + 1.0) / PARTS), _part(b, j, (k + 1.0) / PARTS)
        x1, y1 = pb[0] - pa[0], pb[1] - pa[1]
        ac, as_ = _turned(a, j, j + 1, (k + 0.5) / PARTS)
        bc, bs = _turned(b, j, j + 1, (k + 0.5) / PARTS)
        if _swept(x0, y0, x1, y1, ac, as_, bc, bs, el, ew, tl, tw, slack):
            return k / PARTS
        x0, y0 = x1, y1
    return FREE


@njit(cache=True, error_model="numpy")
def _along(plan, s, v, a, h, first, out):
    """Fill out from row `first`: the plan's way from there with speed v and acceleration a instead of its own."""
    last = plan.shape[0] - 1
    i = first
    begin = s[first]
    for j in range(first, last + 1):
        t = (j - first) * h
        if a < 0.0 and v + a * t < 0.0:
            at, speed = begin - 0.5 * v * v / a, 0.0
        else:
            at, speed = begin + v * t + 0.5 * a * t * t, v + a * t
        while i < last - 1 and s[i + 1] < at:
            i += 1
        step = s[i + 1] - s[i] if i < last else 0.0
        f = (at - s[i]) / step if step > 1e-9 else 0.0
        if f > 1.0:  # beyond the plan: straight on
            c, sn = plan[last, 2], plan[last, 3]
            beyond = at - s[last]
            out[j, 0], out[j, 1] = plan[last, 0] + beyond * c, plan[last, 1] + beyond * sn
        else:
            c, sn = _turned(plan, i, min(i + 1, last), f)
            out[j, 0] = plan[i, 0] + f * (plan[min(i + 1, last), 0] - plan[i, 0])
            out[j, 1] = plan[i, 1] + f * (plan[min(i + 1, last), 1] - plan[i, 1])
        out[j, 2], out[j, 3] = c, sn
        out[j, 4], out[j, 5] = speed * h * c, speed * h * sn


@njit(cache=True, error_model="numpy")
def _evade(plan, s, speed, j, option, limits, h, out):
    """Fill out[j:] with an evasion (LEFT, RIGHT, BRAKE, ACCELERATE) that begins at grid time j.

    limits: lateral, braking and forward acceleration [m/s²], curvature [1/m].
    """
    v = speed[j]
    if option >= BRAKE:
        _along(plan, s, v, -limits[1] if option == BRAKE else limits[2], h, j, out)
        return
    rate = 0.0
    if v > 1e-6:
        rate = min(limits[0] / v, limits[3] * v)
    if option == RIGHT:
        rate = -rate
    _ctra(plan[j, 0], plan[j, 1], plan[j, 2], plan[j, 3], v, 0.0, rate, h, True, out[j:])
    for n in range(j, out.shape[0]):
        out[n, 4] *= h
        out[n, 5] *= h


@njit(cache=True, error_model="numpy")
def _contact(a, b, start, hint, el, ew, tl, tw, swept):
    """Step (and share of it) in which paths a and b touch, -1 where they do not.

    Looked for in the step `hint` first, then from `start` on: with hint < start the first contact.
    Swept (continuous): contact is never missed. Headings stand still within a part of a step, and the boxes grow
    by what they turn there.
    """
    ra, rb = math.sqrt(el * el + ew * ew), math.sqrt(tl * tl + tw * tw)
    reach, inner = ra + rb, min(el, ew) + min(tl, tw)
    near, rim = inner * inner, reach * reach
    last = a.shape[0] - 1
    first = start - 1 if hint >= start and hint + (1 if swept else 0) <= last else start
    for k in range(first, last + (0 if swept else 1)):
        j = hint if k < start else k
        x0, y0 = b[j, 0] - a[j, 0], b[j, 1] - a[j, 1]
        d = x0 * x0 + y0 * y0
        if not swept:
            if d <= rim and _corners(x0, y0, a[j, 2], a[j, 3], b[j, 2], b[j, 3], el, ew, tl, tw):
                return float(j)
            continue
        if d <= near:
            return float(j)
        x1, y1 = b[j + 1, 0] - a[j + 1, 0], b[j + 1, 1] - a[j + 1, 1]
        bulge = 0.125 * (
            _norm(a[j + 1, 4] - a[j, 4], a[j + 1, 5] - a[j, 5])
            + _norm(b[j + 1, 4] - b[j, 4], b[j + 1, 5] - b[j, 5])
        )
        far = reach + bulge + abs(x1 - x0) + abs(y1 - y0)
        if d > far * far:
            continue
        turn = 0.55 * (
            ra * _norm(a[j + 1, 2] - a[j, 2], a[j + 1, 3] - a[j, 3])
            + rb * _norm(b[j + 1, 2] - b[j, 2], b[j + 1, 3] - b[j, 3])
        )
        # the mean of two headings is a little shorter than 1: offsets shrink, no contact is lost
        ac, as_ = 0.5 * (a[j, 2] + a[j + 1, 2]), 0.5 * (a[j, 3] + a[j + 1, 3])
        bc, bs = 0.5 * (b[j, 2] + b[j + 1, 2]), 0.5 * (b[j, 3] + b[j + 1, 3])
        if _may_touch(x0, y0, x1, y1, ac, as_, bc, bs, el, ew, tl, tw, turn + bulge):
            f = _part_that_touches(a, b, j, x0, y0, el, ew, tl, tw, turn / PARTS + bulge / (PARTS * PARTS))
            if f < 1.0:
                return j + f
    return -1.0


@njit(cache=True, error_model="numpy")
def _weight(t, pnr, most, slope):
    """Eq. 4.6."""
    if slope == 0.0:
        g = (most - t) / (most - pnr)
    else:
        tail = math.exp(-slope * (most - pnr))
        g = (math.exp(-slope * (t - pnr)) - tail) / (1.0 - tail)
    return min(1.0, max(0.0, g))


@njit(cache=True, error_model="numpy")
def _weight_sum(t, pnr, most, slope):
    """The integral of Eq. 4.6 from 0 to t."""
    one = min(t, pnr)
    if t <= pnr:
        return one
    end = min(t, most)
    if slope == 0.0:
        return one + (0.5 * (end - pnr) * (2.0 * most - end - pnr)) / (most - pnr)
    tail = math.exp(-slope * (most - pnr))
    whole = (1.0 - math.exp(-slope * (end - pnr))) / slope
    return one + (whole - tail * (end - pnr)) / (1.0 - tail)


@njit(cache=True, error_model="numpy")
def _dependent(g, weight, order):
    """r_dep = E[max over objects of g] (Eq. 4.9), exact for independent objects: g (K, N), weight (N,)."""
    objects, samples = g.shape
    below = np.zeros(objects)  # mass of each object at or below the current value
    count = 0
    flat = g.ravel()
    for k in range(objects):
        for i in range(samples):
            if g[k, i] > 0.0:
                order[count] = k * samples + i
                count += 1
            else:
                below[k] += weight[i]
    if count == 0:
        return 0.0
    some = order[:count]
    some = some[np.argsort(flat[some], kind="mergesort")]
    value = total = 0.0
    n = 0
    while n < count:
        up = flat[some[n]]
        product = 1.0
        for k in range(objects):
            product *= below[k]
        total += (up - value) * (1.0 - product)
        value = up
        while n < count and flat[some[n]] == up:
            below[some[n] // samples] += weight[some[n] % samples]
            n += 1
    return min(1.0, max(0.0, total))


@njit(cache=True, error_model="numpy")
def kernel(plan_in, ego_size, state, size, inputs, sample, weight, limits, times, h, steps, swept,
           r_to, r_ind, r_dep, hits, ttc, ttr):  # fmt: skip
    """Fill the results of all scenes; see `risk`."""
    scenes, objects = state.shape[0], state.shape[1]
    samples = len(weight)
    points = steps + 1
    pnr, most, slope = times[0], times[1], times[2]
    plan, path = np.empty((points, 6)), np.empty((points, 6))
    s, speed = np.empty(points), np.empty(points)
    evasion = np.empty((points, 4, points, 6))
    made = np.zeros((points, 4), dtype=np.bool_)
    g = np.zeros((objects, samples))
    order = np.empty(objects * samples, dtype=np.int64)
    hint = np.empty(4, dtype=np.int64)
    table = np.empty(points + 1)
    for j in range(points + 1):
        if swept:
            table[j] = (_weight_sum((j + 1) * h, pnr, most, slope) - _weight_sum(j * h, pnr, most, slope)) / h
        else:
            table[j] = _weight(j * h, pnr, most, slope)
    for n in range(scenes):
        el, ew = 0.5 * ego_size[n, 0], 0.5 * ego_size[n, 1]
        ready = False
        product = 1.0
        any_risk = 0
        for k in range(objects):
            r_to[n, k] = hits[n, k] = 0.0
            ttc[n, k] = ttr[n, k] = FREE
            g[k, :] = 0.0
            if not size[n, k, 0] > 0.0:
                r_to[n, k] = hits[n, k] = np.nan
                continue
            if not ready:
                s[0] = 0.0
                for j in range(points):
                    heading = plan_in[n, j, 2]
                    speed[j] = plan_in[n, j, 3]
                    plan[j, 0], plan[j, 1] = plan_in[n, j, 0], plan_in[n, j, 1]
                    plan[j, 2], plan[j, 3] = math.cos(heading), math.sin(heading)
                    plan[j, 4], plan[j, 5] = speed[j] * plan[j, 2] * h, speed[j] * plan[j, 3] * h
                    if j > 0:
                        s[j] = s[j - 1] + _norm(plan[j, 0] - plan[j - 1, 0], plan[j, 1] - plan[j - 1, 1])
                made[:, :] = False
                ready = True
            tl, tw = 0.5 * size[n, k, 0], 0.5 * size[n, k, 1]
            x, y, heading, v = state[n, k, 0], state[n, k, 1], state[n, k, 2], state[n, k, 3]
            cos, sin = math.cos(heading), math.sin(heading)
            mu_a, sd_a, mu_w, sd_w = inputs[n, k, 0], inputs[n, k, 1], inputs[n, k, 2], inputs[n, k, 3]
            reach = math.sqrt(el * el + ew * ew) + math.sqrt(tl * tl + tw * tw)
            if _out_of_reach(plan, x, y, cos, sin, v, mu_a, sd_a, mu_w, sd_w, h, swept, reach, path):
                continue
            for i in range(samples):
                _ctra(
                    x,
                    y,
                    cos,
                    sin,
                    v,
                    mu_a + 3.0 * sd_a * sample[i, 0],
                    mu_w + 3.0 * sd_w * sample[i, 1],
                    h,
                    swept,
                    path,
                )
                for j in range(points):
                    path[j, 4] *= h
                    path[j, 5] *= h
                contact = _contact(plan, path, 0, -1, el, ew, tl, tw, swept)
                if contact < 0.0:
                    continue
                hits[n, k] += weight[i]
                ttc[n, k] = min(ttc[n, k], contact * h)
                hint[:] = -1
                found = -1
                for j in range(int(contact), -1, -1):
                    for option in range(4):
                        if not made[j, option]:
                            _evade(plan, s, speed, j, option, limits, h, evasion[j, option])
                            made[j, option] = True
                        hint[option] = int(
                            _contact(evasion[j, option], path, j, hint[option], el, ew, tl, tw, swept)
                        )
                        if hint[option] < 0:
                            found = j
                            break
                    if found >= 0:
                        break
                ttr[n, k] = min(ttr[n, k], max(found, 0) * h)
                g[k, i] = 1.0 if found < 0 else table[found]
                r_to[n, k] += weight[i] * g[k, i]
            if r_to[n, k] > 0.0:
                any_risk += 1
                product *= 1.0 - min(r_to[n, k], 1.0)
        r_ind[n] = 1.0 - product
        r_dep[n] = r_ind[n] if any_risk < 2 else min(_dependent(g, weight, order), r_ind[n])


@njit(cache=True, error_model="numpy")
def _out_of_reach(plan, x, y, cos, sin, v, mu_a, sd_a, mu_w, sd_w, h, swept, reach, path):
    """Whether no sample can touch: the mean path is farther off than samples stray from it and boxes reach."""
    _ctra(x, y, cos, sin, v, mu_a, mu_w, h, swept, path)
    fastest = abs(v) + (abs(mu_a) + 3.0 * sd_a) * h * (plan.shape[0] - 1)
    spread = 1.5 * sd_a + 1.5 * fastest * sd_w
    sway = 0.0
    for j in range(plan.shape[0]):
        dx, dy = plan[j, 0] - path[j, 0], plan[j, 1] - path[j, 1]
        t = j * h
        if j > 0:  # how far both may have come nearer within the step
            sway = _norm(plan[j, 0] - plan[j - 1, 0], plan[j, 1] - plan[j - 1, 1]) + fastest * h
        far = reach + spread * t * t + sway
        if dx * dx + dy * dy < far * far:
            return False
    return True


@njit(cache=True, error_model="numpy")
def ctra_plans(state, h, steps):
    """Plans (S, steps + 1, 4) x, y, heading, v of states (S, 6) whose acceleration and yaw rate are kept."""
    scenes = state.shape[0]
    out = np.empty((scenes, steps + 1, 4))
    path = np.empty((steps + 1, 6))
    for n in range(scenes):
        x, y, heading, v, a, rate = state[n]
        _ctra(x, y, math.cos(heading), math.sin(heading), v, a, rate, h, True, path)
        for j in range(steps + 1):
            out[n, j, 0], out[n, j, 1] = path[j, 0], path[j, 1]
            out[n, j, 2] = math.atan2(path[j, 3], path[j, 2])
            out[n, j, 3] = path[j, 4] * path[j, 2] + path[j, 5] * path[j, 3]
    return out
