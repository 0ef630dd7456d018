"""The published algorithm as it stands, in plain Python loops: Algorithms 4.1 and 4.2, Eq. 4.5 to 4.10.

What its last fitting step means is taken as meant (the last evasion that helps, see 4.1.2.2), not as printed.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from scipy.integrate import odeint


def ctra(x, y, heading, v, a, rate, times):
    """Poses at the times by scipy's odeint, as published (4.1.1.3)."""

    def slope(state, _):
        return state[3] * math.cos(state[2]), state[3] * math.sin(state[2]), rate, a

    return [tuple(row) for row in odeint(slope, (x, y, heading, v), times, rtol=1e-12, atol=1e-12)]


def corners(pose, size):
    x, y, heading = pose[:3]
    c, s = math.cos(heading), math.sin(heading)
    for i, j in itertools.product((0.5, -0.5), repeat=2):
        yield x + c * i * size[0] - s * j * size[1], y + s * i * size[0] + c * j * size[1]


def ray_cast(point, pose, size):
    """Whether a ray from the point crosses the box's outline an odd number of times: the point lies inside."""
    px, py = point
    a, b, c, d = corners(pose, size)
    inside = False
    for (x0, y0), (x1, y1) in ((a, b), (b, d), (d, c), (c, a)):
        if (y0 > py) != (y1 > py) and px < (x1 - x0) * (py - y0) / (y1 - y0) + x0:
            inside = not inside
    return inside


def intersect(one, other, size_one, size_other):
    """Algorithm 4.1, vehicle_intersection: circles, then every corner of either in the other."""
    apart = math.hypot(one[0] - other[0], one[1] - other[1])
    collided = False
    if apart <= 0.5 * math.hypot(*size_one) + 0.5 * math.hypot(*size_other):
        for corner in corners(other, size_other):
            if ray_cast(corner, one, size_one):
                collided = True
        for corner in corners(one, size_one):
            if ray_cast(corner, other, size_other):
                collided = True
    return collided


def direction(plan, j):
    """Which way the plan goes at grid time j; up to 0.05 m/s it stands: as it came, as it goes next, or ahead."""
    for k in [*range(j, -1, -1), *range(j + 1, len(plan))]:
        if abs(plan[k][3]) > 0.05:
            return 1.0 if plan[k][3] > 0.0 else -1.0
    return 1.0


def along(plan, start, a, h):
    """The plan's way from grid time `start` on at constant acceleration a of its pace, then straight on.

    It ends where the plan does, or turns round.
    """
    side, end = direction(plan, start), start
    while end + 1 < len(plan) and direction(plan, end + 1) == side:
        end += 1
    way = [0.0]
    for before, after in itertools.pairwise(plan[start : end + 1]):
        way.append(way[-1] + math.hypot(after[0] - before[0], after[1] - before[1]))
    pace, out = abs(plan[start][3]), []
    for j in range(len(plan) - start):
        t = j * h
        at = -0.5 * pace * pace / a if a < 0.0 and pace + a * t < 0.0 else pace * t + 0.5 * a * t * t
        if at > way[-1]:
            x, y, heading = plan[end][:3]
            on = side * (at - way[-1])
            out.append((x + on * math.cos(heading), y + on * math.sin(heading), heading))
            continue
        i = next((i for i in range(len(way) - 1) if at <= way[i + 1]), None)
        if i is None or way[i + 1] - way[i] <= 1e-9:
            out.append(tuple(plan[start + (i or 0)][:3]))
            continue
        f, one, two = (at - way[i]) / (way[i + 1] - way[i]), plan[start + i], plan[start + i + 1]
        out.append(tuple(one[k] + f * (two[k] - one[k]) for k in range(3)))
    return out


def evasions(plan, start, h, lateral=7.0, braking=8.5, forward=3.0, curvature=0.2):
    x, y, heading, v = plan[start]
    rate = min(lateral / abs(v), curvature * abs(v)) if abs(v) > 1e-6 else 0.0
    times = [k * h for k in range(len(plan) - start)]
    for sign in (1.0, -1.0):
        if len(times) > 1:
            yield ctra(x, y, heading, v, 0.0, sign * rate, times)
        else:
            yield [(x, y, heading)]
    yield along(plan, start, -braking, h)
    yield along(plan, start, forward, h)


def weight(ttr, no_return=0.5, most=3.5, slope=2.0):
    tail = math.exp(-slope * (most - no_return))
    return min(1.0, max(0.0, (math.exp(-slope * (ttr - no_return)) - tail) / (1.0 - tail)))


def risk(plan, ego_size, objects, inputs, sample, h):
    """r_to, r_ind, r_dep, collision probabilities of one scene; objects: (state, size) pairs."""
    p = np.exp(-4.5 * (np.asarray(sample) ** 2).sum(axis=1))
    p /= p.sum()
    times = [k * h for k in range(len(plan))]
    r_to, hits, every = [], [], []
    for (state, size), (mu_a, sd_a, mu_w, sd_w) in zip(objects, inputs, strict=True):
        g = []
        for u, w in sample:
            path = ctra(*state[:4], mu_a + 3.0 * sd_a * u, mu_w + 3.0 * sd_w * w, times)
            contact = next((j for j in range(len(plan)) if intersect(plan[j], path[j], ego_size, size)), None)
            if contact is None:
                g.append(None)
                continue
            found = -1.0
            for j in range(contact + 1):
                for way in evasions(plan, j, h):
                    if not any(intersect(e, path[j + n], ego_size, size) for n, e in enumerate(way)):
                        found = j * h
                        break
            g.append(1.0 if found < 0.0 else weight(found))
        values = [x or 0.0 for x in g]
        r_to.append(float(np.dot(p, values)))
        hits.append(float(sum(q for q, x in zip(p, g, strict=True) if x is not None)))
        every.append(values)
    r_ind = 1.0 - math.prod(1.0 - r for r in r_to)
    r_dep = sum(
        math.prod(p[i] for i in each) * max(every[k][i] for k, i in enumerate(each))
        for each in itertools.product(range(len(p)), repeat=len(every))
    ) if len(p) ** len(every) <= 20_000 else None  # fmt: skip
    return r_to, r_ind, r_dep, hits
