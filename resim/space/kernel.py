"""The innermost work of `resim.space`, compiled by numba: distances between scenarios.

What is compiled is kept on disk by the source of this module alone, so it takes nothing from others that may change.
"""

# mypy: ignore-errors
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from resim.core.compiled import entry, inner

SLOTS = 8
AWAY = 1e9
"""m: where nobody is."""


class SlotSamples(NamedTuple):
    """Scenes (K,) of scenarios, those of scenario n from first[n] to first[n + 1].

    offset, speed (K, 8): m and m/s, AWAY and 0 where a slot is vacant; lane (K,), bend (K,) 1/m, NaN without a lane.
    """

    first: np.ndarray
    offset: np.ndarray
    speed: np.ndarray
    lane: np.ndarray
    bend: np.ndarray


class SceneWeights(NamedTuple):
    """longest: m that make a distance of 1; vacant: what a slot held in one scene alone costs; more: whether anything
    else counts; speed: of a difference of `full_speed` [m/s]; lane: of another lane; bend: of a difference of
    `full_bend` [1/m].
    """

    longest: float
    vacant: float
    more: bool
    speed: float
    full_speed: float
    lane: float
    bend: float
    full_bend: float


class PairMeasure(NamedTuple):
    """weights: of a scene; window: scenes by which an alignment in time may be off, below 0 for none; unequal: what a
    difference in length costs, by the share that the longer scenario has alone.
    """

    weights: SceneWeights
    window: float
    unequal: float


@inner
def slots(of, i, j, count, weights):
    """Give the sum of the slot distances of `count` scenes from i and from j on (Wagner 2021, 6.2.3.1 and 6.2.3.2).

    Vacant slots lie AWAY, so that a distance is cut to what a vacant slot costs, and two vacant ones are at none.
    """
    x, cap = of.offset, weights.vacant * weights.longest
    a0 = a1 = a2 = a3 = a4 = a5 = a6 = a7 = 0.0
    for k in range(count):
        p, q = x[i + k], x[j + k]
        d0, d1, d2, d3 = abs(p[0] - q[0]), abs(p[1] - q[1]), abs(p[2] - q[2]), abs(p[3] - q[3])
        d4, d5, d6, d7 = abs(p[4] - q[4]), abs(p[5] - q[5]), abs(p[6] - q[6]), abs(p[7] - q[7])
        a0 += d0 if d0 < cap else cap
        a1 += d1 if d1 < cap else cap
        a2 += d2 if d2 < cap else cap
        a3 += d3 if d3 < cap else cap
        a4 += d4 if d4 < cap else cap
        a5 += d5 if d5 < cap else cap
        a6 += d6 if d6 < cap else cap
        a7 += d7 if d7 < cap else cap
    return (((a0 + a1) + (a2 + a3)) + ((a4 + a5) + (a6 + a7))) / weights.longest


@inner
def beside(of, i, j, weights):
    """Give what the weights add to the distance of two scenes: speeds, lane, bend."""
    total = 0.0
    if weights.speed > 0.0:
        for k in range(SLOTS):
            if of.offset[i, k] != AWAY and of.offset[j, k] != AWAY:
                total += weights.speed * min(abs(of.speed[i, k] - of.speed[j, k]) / weights.full_speed, 1.0)
    if weights.lane > 0.0 and of.lane[i] != of.lane[j]:
        total += weights.lane
    if weights.bend > 0.0:
        one, two = np.isnan(of.bend[i]), np.isnan(of.bend[j])
        if one != two:
            total += weights.bend
        elif not one:
            total += weights.bend * min(abs(of.bend[i] - of.bend[j]) / weights.full_bend, 1.0)
    return total


@inner
def common(of, a, b, weights):
    """Give the mean distance of two scenarios' scenes over their common time (Wagner 2021, 6.2.3.3)."""
    i, j = of.first[a], of.first[b]
    count = min(of.first[a + 1] - i, of.first[b + 1] - j)
    total = slots(of, i, j, count, weights)
    if weights.more:
        for k in range(count):
            total += beside(of, i + k, j + k, weights)
    return total / count


@inner
def warped(of, a, b, weights, window, row):
    """Give the mean distance along the cheapest alignment in time of two scenarios.

    Dynamic time warping (Sakoe and Chiba 1978), with the symmetric steps and weights of their form P = 0: a step of
    both counts twice, so that the sum is over the scenes of both. window: scenes by which an alignment may be off the
    diagonal of their lengths. row: scratch (2, M + 1).
    """
    i, j = of.first[a], of.first[b]
    n, m = of.first[a + 1] - i, of.first[b + 1] - j
    row[0, : m + 1] = np.inf
    row[0, 0] = 0.0
    for k in range(1, n + 1):
        now, before = k % 2, 1 - k % 2
        row[now, : m + 1] = np.inf
        centre = k * m / n
        low, high = max(1, int(np.ceil(centre - window))), min(m, int(np.floor(centre + window)))
        for p in range(low, high + 1):
            d = slots(of, i + k - 1, j + p - 1, 1, weights)
            if weights.more:
                d += beside(of, i + k - 1, j + p - 1, weights)
            row[now, p] = min(row[before, p - 1] + 2.0 * d, row[before, p] + d, row[now, p - 1] + d)
    return row[n % 2, m] / (n + m)


@inner
def pair(of, a, b, how, row):
    """Give the distance of two scenarios. row: scratch (2, M + 1)."""
    n, m = of.first[a + 1] - of.first[a], of.first[b + 1] - of.first[b]
    if how.window < 0.0:
        found = common(of, a, b, how.weights)
    else:
        found = warped(of, a, b, how.weights, max(how.window, abs(n - m)), row)
    return found + how.unequal * abs(n - m) / max(n, m)


@entry(nogil=True)
def triangle(of, how, ends, out):
    """Fill out with the distances of scenarios a from ends[0] to ends[1] to all later ones, row by row."""
    count, k = len(of.first) - 1, 0
    row = np.empty((2, longest(of) + 1))
    for a in range(ends[0], ends[1]):
        for b in range(a + 1, count):
            out[k] = pair(of, a, b, how, row)
            k += 1


@entry(nogil=True)
def between(of, ones, others, how, out):
    """Fill out (A, B) with the distances of scenarios ones (A,) to others (B,)."""
    row = np.empty((2, longest(of) + 1))
    for n in range(len(ones)):
        for m in range(len(others)):
            out[n, m] = pair(of, ones[n], others[m], how, row)


@inner
def longest(of):
    """Give the scenes of the longest scenario."""
    most = 0
    for n in range(len(of.first) - 1):
        most = max(most, of.first[n + 1] - of.first[n])
    return most


@entry(nogil=True)
def sums(condensed, count, order, start):
    """Give sums (K,) of the distances of each scenario to those of its own cluster, and the largest (K,).

    condensed: upper triangle of `count` scenarios; order (K,): scenarios, cluster by cluster; start (C + 1,): where
    each cluster begins.
    """
    total, most = np.zeros(len(order)), np.zeros(len(order))
    for c in range(len(start) - 1):
        for p in range(start[c], start[c + 1]):
            for q in range(p + 1, start[c + 1]):
                a, b = min(order[p], order[q]), max(order[p], order[q])
                d = condensed[a * count - a * (a + 1) // 2 + b - a - 1]
                total[p] += d
                total[q] += d
                most[p], most[q] = max(most[p], d), max(most[q], d)
    return total, most


@entry(nogil=True)
def mean_to_clusters(condensed, count, label, clusters):
    """Give the sums (K, C) of the distances of each scenario to those of each cluster. label (K,): 0 to C - 1."""
    out = np.zeros((count, clusters))
    k = 0
    for a in range(count):
        for b in range(a + 1, count):
            out[a, label[b]] += condensed[k]
            out[b, label[a]] += condensed[k]
            k += 1
    return out
