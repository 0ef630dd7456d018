"""The innermost work of `contact`, `motion` and `nearness`, compiled by numba: a sweep asks for it in every run.

What is compiled is kept on disk by the source of this module alone, so it takes nothing from others that may change.
Motions, paths: (P, N, 4) x, y [m], heading [rad], v [m/s]; all arrays as `plain` gives them.
"""

# mypy: ignore-errors
from __future__ import annotations

import math

import numpy as np

from resim.core.compiled import entry, inner
from resim.core.geometry import Floats

PARTS = 16
SLOW = 0.05  # m/s up to which somebody stands
SMALL = 0.05  # rad; below it the series of `_integrals` is exact to 1e-12
BULGE = 4.0 / 27.0  # the most that a cubic Hermite strays from its chord, per metre of tangent error


def plain(*arrays: Floats) -> list[Floats]:
    """Give arrays (P, ...) of one kind, for which everything here is compiled once."""
    if len({len(array) for array in arrays}) > 1:  # compiled code would read beyond the end
        raise ValueError(f"pairs do not match: {', '.join(str(array.shape) for array in arrays)}")
    return [np.require(array, float, ("C", "W")) for array in arrays]


@inner
def _wrap(angle):
    return math.pi - (math.pi - angle) % (2.0 * math.pi)


@inner
def _hermite(f, p0, m0, p1, m1):
    f2, f3 = f * f, f * f * f
    return (2 * f3 - 3 * f2 + 1) * p0 + (f3 - 2 * f2 + f) * m0 + (3 * f2 - 2 * f3) * p1 + (f3 - f2) * m1


@inner
def _share(f):
    """f in [0, 1], NaN as it is."""
    return 0.0 if f < 0.0 else 1.0 if f > 1.0 else f


@inner
def _above(x):
    """x, 0 at least, NaN as it is."""
    return 0.0 if x < 0.0 else x


@inner
def _place(a, b, f, tangents, beyond, out):
    """Put into out (4,) x, y and heading at share f from a to b with tangents [m]; `beyond` [m] straight on.

    a, b: x, y, heading, its cosine and sine.
    """
    ma, mb = tangents
    out[0] = _hermite(f, a[0], ma * a[3], b[0], mb * b[3]) + beyond * b[3]
    out[1] = _hermite(f, a[1], ma * a[4], b[1], mb * b[4]) + beyond * b[4]
    out[2] = a[2] + f * _wrap(b[2] - a[2])


@inner
def _turned(path, out):
    """Put into out (M + 1, 5 or more) x, y, heading of a path (M + 1, 4), and its heading's cosine and sine."""
    for j in range(len(path)):
        out[j, 0], out[j, 1], out[j, 2] = path[j, 0], path[j, 1], path[j, 2]
        out[j, 3], out[j, 4] = math.cos(path[j, 2]), math.sin(path[j, 2])


@inner
def _integrals(turn, t):
    """Real and imaginary parts of I0 = ∫ e^(i w s) ds and I1 = ∫ s e^(i w s) ds over 0..t, with turn = w t."""
    half = 0.5 * turn
    sinc = math.sin(half) / half if abs(half) > 1e-8 else 1.0
    x0, y0 = t * math.cos(half) * sinc, t * math.sin(half) * sinc
    if abs(turn) > SMALL:
        return x0, y0, t * (t * math.sin(turn) - y0) / turn, -t * (t * math.cos(turn) - x0) / turn
    square = turn * turn
    x1 = t * t * (1 / 2 - square * (1 / 8 - square / 144))
    return x0, y0, x1, t * t * turn * (1 / 3 - square * (1 / 30 - square / 840))


@entry()
def ctra(state, t):
    """See `motion.ctra`."""
    out = np.empty((*t.shape, 4))
    for p in range(t.shape[0]):
        x, y, heading, v, a, rate = state[p]
        cos, sin = math.cos(heading), math.sin(heading)
        stop = math.inf
        if -SLOW <= v <= 0.0:
            stop = 0.0 if a <= 0.0 else math.inf
        elif v * a < 0.0:
            stop = abs(v) / max(abs(a), 1e-12)
        for n in range(t.shape[1]):
            until = min(t[p, n], stop)
            x0, y0, x1, y1 = _integrals(rate * until, until)
            ahead, aside = v * x0 + a * x1, v * y0 + a * y1
            out[p, n, 0], out[p, n, 1] = x + cos * ahead - sin * aside, y + sin * ahead + cos * aside
            out[p, n, 2], out[p, n, 3] = heading + rate * until, v + a * until
    return out


@entry()
def straight(state, t):
    """See `motion.straight`."""
    out = np.empty((*t.shape, 4))
    for p in range(t.shape[0]):
        x, y, heading, v = state[p, 0], state[p, 1], state[p, 2], state[p, 3]
        cos, sin = math.cos(heading), math.sin(heading)
        for n in range(t.shape[1]):
            way = v * t[p, n]
            out[p, n, 0], out[p, n, 1], out[p, n, 2], out[p, n, 3] = x + way * cos, y + way * sin, heading, v
    return out


@entry()
def turned(path):
    """Give paths (P, M + 1, 4) as (P, M + 1, 6): x, y, heading, its cosine and sine, v."""
    out = np.empty((path.shape[0], path.shape[1], 6))
    for p in range(path.shape[0]):
        _turned(path[p], out[p])
        for n in range(path.shape[1]):
            out[p, n, 5] = path[p, n, 3]
    return out


@entry()
def sample(turned, rows, step, t):
    """See `motion.sample`, of the paths in these rows (P,) of `turned`."""
    last = turned.shape[1] - 1
    out = np.empty((*t.shape, 4))
    for p in range(t.shape[0]):
        path = turned[rows[p]]
        for n in range(t.shape[1]):
            at = t[p, n] / step
            j = min(max(int(at), 0), last - 1)
            one, two = path[j, 5], path[j + 1, 5]
            f, beyond = _share(at - j), _above(t[p, n] - last * step) * two
            _place(path[j], path[j + 1], f, (one * step, two * step), beyond, out[p, n])
            out[p, n, 3] = one + f * (two - one)
    return out


@inner
def _direction(path, first):
    """Which way a path (M + 1, 4) goes at point `first`, 1 or -1, and the last point till which it goes that way.

    Who stands faces the way he came, else the way he goes next, else ahead.
    """
    last, j, until = len(path) - 1, first, first
    while j > 0 and abs(path[j, 3]) <= SLOW:
        j -= 1
    while j < last and abs(path[j, 3]) <= SLOW:
        j += 1
    side = -1.0 if path[j, 3] < -SLOW else 1.0
    while until < last and side * path[until + 1, 3] >= -SLOW:
        until += 1
    return side, until


@entry()
def along(path, s, v):
    """See `motion.along`."""
    last = path.shape[1] - 1
    out, station, turned = np.empty((*s.shape, 4)), np.zeros(last + 1), np.empty((last + 1, 5))
    for p in range(s.shape[0]):
        _turned(path[p], turned)
        for k in range(last):
            dx, dy = path[p, k + 1, 0] - path[p, k, 0], path[p, k + 1, 1] - path[p, k, 1]
            station[k + 1] = station[k] + math.hypot(dx, dy)
        j = 0
        while j < last and station[j + 1] <= s[p, 0]:
            j += 1
        ahead, turn = _direction(path[p], j)
        top = max(turn - 1, 0)
        j = min(j, top)
        for n in range(s.shape[1]):  # mostly in order, so the next place is near
            while j > 0 and s[p, n] < station[j]:
                j -= 1
            while j < top and s[p, n] >= station[j + 1]:
                j += 1
            k = min(j + 1, turn)
            ds = station[k] - station[j]
            f = _share((s[p, n] - station[j]) / (ds if ds > 1e-9 else 1.0))
            beyond = ahead * _above(s[p, n] - station[turn])
            _place(turned[j], turned[k], f, (ahead * ds, ahead * ds), beyond, out[p, n])
            out[p, n, 3] = ahead * v[p, n]
    return out


@inner
def _entry(start, end, headings, size_a, size_b, slack):
    """Share at which boxes of fixed headings first touch while b goes straight, as seen from a; inf: never.

    start, end: where b is from a, x and y [m]. headings: of a and b [rad]. slack [m]: what the boxes grow by.
    """
    (x0, y0), (x1, y1), (heading_a, heading_b) = start, end, headings
    c, s = abs(math.cos(heading_b - heading_a)), abs(math.sin(heading_b - heading_a))
    low, high = 0.0, 1.0
    for k in range(4):  # length and width of a, then of b
        axis, own, other = (heading_a, size_a, size_b) if k < 2 else (heading_b, size_b, size_a)
        ca, sa = math.cos(axis), math.sin(axis)
        if k % 2 == 0:
            p0, p1 = ca * x0 + sa * y0, ca * x1 + sa * y1
            r = 0.5 * own[0] + c * (0.5 * other[0]) + s * (0.5 * other[1]) + slack
        else:
            p0, p1 = ca * y0 - sa * x0, ca * y1 - sa * x1
            r = 0.5 * own[1] + s * (0.5 * other[0]) + c * (0.5 * other[1]) + slack
        d = p1 - p0
        if abs(d) < 1e-12:
            if abs(p0) > r:
                return math.inf
            continue
        one, two = (-r - p0) / d, (r - p0) / d
        if d < 0.0:
            one, two = two, one
        if not one <= two:  # NaN
            return math.inf
        low, high = max(low, one), min(high, two)
        if low > high:
            return math.inf
    return low


@inner
def _overlap(a, b, size_a, size_b):
    """Whether boxes touch (separating axes); NaN never does."""
    off = (b[0] - a[0], b[1] - a[1])
    return _entry(off, off, (a[2], b[2]), size_a, size_b, 0.0) == 0.0


@inner
def _of_step(a, b, j, h, size_a, size_b):
    """Share of step j at which contact of motions a, b (N, 4) begins; inf: none."""
    a0, a1, b0, b1 = a[j], a[j + 1], b[j], b[j + 1]
    x, y = b0[0] - a0[0], b0[1] - a0[1]
    chord_x, chord_y = (b1[0] - a1[0]) - x, (b1[1] - a1[1]) - y
    first_x = (b0[3] * math.cos(b0[2]) - a0[3] * math.cos(a0[2])) * h - chord_x
    first_y = (b0[3] * math.sin(b0[2]) - a0[3] * math.sin(a0[2])) * h - chord_y
    second_x = (b1[3] * math.cos(b1[2]) - a1[3] * math.cos(a1[2])) * h - chord_x
    second_y = (b1[3] * math.sin(b1[2]) - a1[3] * math.sin(a1[2])) * h - chord_y
    turn_a, turn_b = _wrap(a1[2] - a0[2]), _wrap(b1[2] - b0[2])
    bulge = BULGE * (math.hypot(first_x, first_y) + math.hypot(second_x, second_y))
    ra, rb = 0.5 * math.hypot(size_a[0], size_a[1]), 0.5 * math.hypot(size_b[0], size_b[1])
    turned = 0.5 * (ra * abs(turn_a) + rb * abs(turn_b))
    mean, end = (a0[2] + 0.5 * turn_a, b0[2] + 0.5 * turn_b), (x + chord_x, y + chord_y)
    whole = _entry((x, y), end, mean, size_a, size_b, turned + bulge)
    if whole == math.inf:
        return math.inf
    slack = turned / PARTS + bulge / PARTS**2
    x0, y0 = x, y
    for k in range(PARTS):
        f, middle = (k + 1) / PARTS, (k + 0.5) / PARTS
        m0, m1 = f * (1.0 - f) ** 2, f * f * (f - 1.0)
        x1 = x + f * chord_x + m0 * first_x + m1 * second_x
        y1 = y + f * chord_y + m0 * first_y + m1 * second_y
        headings = (a0[2] + middle * turn_a, b0[2] + middle * turn_b)
        share = _entry((x0, y0), (x1, y1), headings, size_a, size_b, slack)
        if share < math.inf:
            return (k + share) / PARTS
        x0, y0 = x1, y1
    return math.inf


@entry()
def first_contact(a, b, h, size_a, size_b):
    """See `contact.first_contact`: step by step until they touch, the circles around the boxes first."""
    out = np.full(a.shape[0], math.inf)
    for p in range(a.shape[0]):
        reach = 0.5 * (math.hypot(size_a[p, 0], size_a[p, 1]) + math.hypot(size_b[p, 0], size_b[p, 1]))
        x0, y0 = b[p, 0, 0] - a[p, 0, 0], b[p, 0, 1] - a[p, 0, 1]
        d0, pace0 = math.sqrt(x0 * x0 + y0 * y0), abs(a[p, 0, 3]) + abs(b[p, 0, 3])
        for j in range(a.shape[1] - 1):
            x1, y1 = b[p, j + 1, 0] - a[p, j + 1, 0], b[p, j + 1, 1] - a[p, j + 1, 1]
            d1, pace1 = math.sqrt(x1 * x1 + y1 * y1), abs(a[p, j + 1, 3]) + abs(b[p, j + 1, 3])
            chord = math.sqrt((x1 - x0) ** 2 + (y1 - y0) ** 2)
            gap = 0.5 * (d0 + d1) - (0.5 + 2.0 * BULGE) * chord
            if gap <= reach + BULGE * h[p] * (pace0 + pace1):
                if j == 0 and _overlap(a[p, 0], b[p, 0], size_a[p], size_b[p]):
                    share = 0.0
                else:
                    share = _of_step(a[p], b[p], j, h[p], size_a[p], size_b[p])
                if share < math.inf:
                    out[p] = (j + share) * h[p]
                    break
            x0, y0, d0, pace0 = x1, y1, d1, pace1
    return out


@inner
def _corner_to_box(dx, dy, heading, turn, own, other):
    """Square of the distance [m²] from the nearest corner of a box of size `own`, at dx, dy from another and turned
    against it, to that other of size `other` with this heading.
    """
    c, s, ct, st = math.cos(heading), math.sin(heading), math.cos(turn), math.sin(turn)
    px, py = c * dx + s * dy, c * dy - s * dx
    best = math.inf
    for i in (-0.5, 0.5):
        for k in (-0.5, 0.5):
            ahead, left = i * own[0], k * own[1]
            ox = _above(abs(px + ct * ahead - st * left) - 0.5 * other[0])
            oy = _above(abs(py + st * ahead + ct * left) - 0.5 * other[1])
            square = ox * ox + oy * oy
            if square < best or math.isnan(square):
                best = square
    return best


@entry()
def distance(a, b, size_a, size_b):
    """See `contact.distance`."""
    out = np.empty(a.shape[:2])
    for p in range(a.shape[0]):
        reach = 0.5 * (math.hypot(size_a[p, 0], size_a[p, 1]) + math.hypot(size_b[p, 0], size_b[p, 1])) + 1e-6
        for n in range(a.shape[1]):
            one, two = a[p, n], b[p, n]
            dx, dy, turn = one[0] - two[0], one[1] - two[1], one[2] - two[2]
            if dx * dx + dy * dy <= reach * reach and _overlap(one, two, size_a[p], size_b[p]):
                out[p, n] = 0.0
                continue
            square = min(
                _corner_to_box(dx, dy, two[2], turn, size_a[p], size_b[p]),
                _corner_to_box(-dx, -dy, one[2], -turn, size_b[p], size_a[p]),
            )
            out[p, n] = math.sqrt(square)
    return out


@entry()
def least_shift(a, b, reach):
    """Give the fewest steps (P,) between a at one place and b within reach (P,) [m] of it; inf: never.

    a, b: (P, N, 4).
    """
    out = np.full(a.shape[0], math.inf)
    steps = a.shape[1]
    for p in range(a.shape[0]):
        square = reach[p] * reach[p]
        for shift in range(steps):
            for j in range(steps - shift):
                for one, two in ((j, j + shift), (j + shift, j)):
                    x, y = b[p, two, 0] - a[p, one, 0], b[p, two, 1] - a[p, one, 1]
                    if x * x + y * y <= square:
                        out[p] = shift
                        break
                if out[p] < math.inf:
                    break
            if out[p] < math.inf:
                break
    return out
