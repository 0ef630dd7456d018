"""The innermost work of mining, compiled by numba: which lane each sample is on, who is around it, how fast it moves
across.

What is compiled is kept on disk by the source of this module alone, so it takes nothing from others that may change.
Graphs are (first, to): row r leads to `to[first[r]:first[r + 1]]`.
"""

# mypy: ignore-errors
from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from resim.core.compiled import entry, inner

CONTINUES, CROSSES, BREAKS = 0, 1, 2
"""How a sample follows the one before: on the lane's way, over a border into another lane, or from anywhere."""
CROSSING, JUMP, BROKEN, FOLLOWED = 4.0, 2.0, 15.0, 0.05
"""Costs of a lane passed, of one that no link leads to, of a break, and of a link taken; those of being off a lane's
centre or heading are metres and radians by the metre driven."""
MOST_PASSED = 3
"""Lanes that are passed between two samples at most."""
DEEP = 12
"""Rows that lie between two samples at most."""
LONG = 64
"""Rows of a way ahead at most."""
APART = 1.5
"""m between the centres of two lanes that no link joins, from which on they are two."""
FARTHEST = 18.0
"""m between them up to which a vehicle may have gone from one to the other between two samples."""
ALIKE = 0.6
"""rad up to which lanes that no link joins run the same way."""


class LaneGraph(NamedTuple):
    """The rows of a `MinedLanes`: graphs (first, to) ahead and back, m of their centres, and who is left and right."""

    after_first: np.ndarray
    after_to: np.ndarray
    before_first: np.ndarray
    before_to: np.ndarray
    length: np.ndarray
    forward: np.ndarray
    left: np.ndarray
    right: np.ndarray


class LaneCandidates(NamedTuple):
    """Lanes that samples may be on: those of sample k are first[k]:first[k + 1].

    row, with_lane (headed as the lane is driven), heading of the lane [rad], t [m] left of its centre, cost (M,).
    """

    first: np.ndarray
    row: np.ndarray
    with_lane: np.ndarray
    heading: np.ndarray
    t: np.ndarray
    cost: np.ndarray


class CheapestWay(NamedTuple):
    """total, back (M,): cost of the cheapest way to each candidate, and the candidate before it on that."""

    total: np.ndarray
    back: np.ndarray


class FollowedLanes(NamedTuple):
    """kind, count (K,): how each chosen sample follows the one before, and the lanes that it passes to the left."""

    kind: np.ndarray
    count: np.ndarray


class DrivenSamples(NamedTuple):
    """Samples (K,): x, y [m], weight [m] of being off; those of object n are whole[n]:whole[n + 1]."""

    x: np.ndarray
    y: np.ndarray
    weight: np.ndarray
    whole: np.ndarray


@inner
def reaches(graph, ahead, a, b, far):
    """Say whether row a is b, or leads to it (ahead, or back) over rows of up to `far` [m] together."""
    if a == b:
        return True
    rows, left = np.empty(LONG, np.int32), np.empty(LONG)
    depth = np.empty(LONG, np.int32)
    rows[0], left[0], depth[0] = a, far, 0
    top = 1
    first = graph.after_first if ahead else graph.before_first
    to = graph.after_to if ahead else graph.before_to
    while top > 0:
        top -= 1
        row, rest, deep = rows[top], left[top], depth[top]
        for k in range(first[row], first[row + 1]):
            other = to[k]
            if other == b:
                return True
            if rest - graph.length[other] >= 0.0 and deep < DEEP and top < LONG:
                rows[top], left[top], depth[top] = other, rest - graph.length[other], deep + 1
                top += 1
    return False


@inner
def passed(graph, a, with_a, b, far):
    """Give how many lanes to the left of the driver (right: negative) b lies of a's way, 0 for on it, 99 for nowhere.

    with_a: whether a is driven in its direction.
    """
    if reaches(graph, with_a, a, b, far) or reaches(graph, not with_a, a, b, 0.5 * far):
        return 0
    for side in (1, -1):
        row, along = a, with_a
        for n in range(1, MOST_PASSED + 1):
            other = graph.left[row] if (side == 1) == along else graph.right[row]
            if other < 0:
                break
            along = along == (graph.forward[other] == graph.forward[row])
            row = other
            if reaches(graph, along, row, b, far):
                return n * side
    for side in (1, -1):  # b begins beside a lane that a's way leads to
        row = b
        for n in range(1, MOST_PASSED + 1):
            other = graph.right[row] if side == 1 else graph.left[row]
            if other < 0 or graph.forward[other] != graph.forward[row]:
                break
            row = other
            if reaches(graph, with_a, a, row, far):
                return n * side if with_a else -n * side
    return 99


@inner
def turned(angle):
    """Bring an angle [rad] into one turn around 0."""
    return math.atan2(math.sin(angle), math.cos(angle))


@inner
def between(graph, lanes, a, b, dx, dy):
    """Give kind, lanes passed to the left and cost of going from candidate a to candidate b, which lie dx, dy apart."""
    if lanes.row[a] == lanes.row[b] and lanes.with_lane[a] == lanes.with_lane[b]:
        return CONTINUES, 0, 0.0
    count = passed(graph, lanes.row[a], lanes.with_lane[a], lanes.row[b], 10.0 + 2.0 * math.hypot(dx, dy))
    if count == 0:
        return CONTINUES, 0, FOLLOWED
    if count != 99:
        return CROSSES, count, CROSSING * abs(count)
    one = lanes.heading[a] if lanes.with_lane[a] else lanes.heading[a] + math.pi
    two = lanes.heading[b] if lanes.with_lane[b] else lanes.heading[b] + math.pi
    if abs(turned(one - two)) > ALIKE:
        return BREAKS, 0, BROKEN
    mean = one + 0.5 * turned(two - one)
    aside = dy * math.cos(mean) - dx * math.sin(mean)
    off = aside + (lanes.t[a] if lanes.with_lane[a] else -lanes.t[a])
    off -= lanes.t[b] if lanes.with_lane[b] else -lanes.t[b]
    if abs(off) < APART:
        return CONTINUES, 0, JUMP
    if abs(off) > FARTHEST:
        return BREAKS, 0, BROKEN
    return CROSSES, 1 if off > 0.0 else -1, JUMP + CROSSING


@inner
def extend(graph, lanes, samples, last, k, way):
    """Find the cheapest way to each candidate of sample k from those of sample `last`, -1 for none before."""
    for b in range(lanes.first[k], lanes.first[k + 1]):
        own = samples.weight[k] * lanes.cost[b]
        if last < 0:
            way.total[b], way.back[b] = own, -1
            continue
        least, best = math.inf, -1
        dx, dy = samples.x[k] - samples.x[last], samples.y[k] - samples.y[last]
        for a in range(lanes.first[last], lanes.first[last + 1]):
            if way.total[a] < least:
                _, _, more = between(graph, lanes, a, b, dx, dy)
                if way.total[a] + more < least:
                    least, best = way.total[a] + more, a
        way.total[b], way.back[b] = least + own, best


@entry()
def choose(graph, lanes, samples, followed):
    """Choose for each sample with candidates the one on the cheapest way of its object (Viterbi); give it or -1 (K,).

    followed: filled.
    """
    chosen = np.full(len(samples.x), -1, np.int64)
    way = CheapestWay(np.empty(len(lanes.row)), np.empty(len(lanes.row), np.int64))
    for n in range(len(samples.whole) - 1):
        begin, end, last = samples.whole[n], samples.whole[n + 1], -1
        for k in range(begin, end):
            if lanes.first[k + 1] > lanes.first[k]:
                extend(graph, lanes, samples, last, k, way)
                last = k
        if last < 0:
            continue
        best = lanes.first[last]
        for b in range(lanes.first[last], lanes.first[last + 1]):
            if way.total[b] < way.total[best]:
                best = b
        for k in range(last, begin - 1, -1):
            if lanes.first[k + 1] > lanes.first[k]:
                chosen[k] = best
                best = way.back[best]
        last = -1
        for k in range(begin, end):
            if chosen[k] < 0:
                continue
            if last < 0:
                followed.kind[k] = BREAKS
            else:
                dx, dy = samples.x[k] - samples.x[last], samples.y[k] - samples.y[last]
                followed.kind[k], followed.count[k], _ = between(
                    graph, lanes, chosen[last], chosen[k], dx, dy
                )
            last = k
    return chosen


@entry()
def slopes(t, values, first, half):
    """Give the slopes (K,) of values (K,) over t (K,) [s]: a straight line through up to half[p] samples to each side.

    first (P + 1,): where pieces begin, beyond which nothing is looked at; half (P,). NaN in pieces of one sample.
    """
    out = np.empty(len(t))
    for p in range(len(first) - 1):
        low, high = first[p], first[p + 1]
        for k in range(low, high):
            a, b = max(low, k - half[p]), min(high, k + half[p] + 1)
            mean_t = mean = 0.0
            for j in range(a, b):
                mean_t += t[j] - t[k]
                mean += values[j] - values[k]
            mean_t /= b - a
            mean /= b - a
            top = bottom = 0.0
            for j in range(a, b):
                dt = t[j] - t[k] - mean_t
                top += dt * (values[j] - values[k] - mean)
                bottom += dt * dt
            out[k] = top / bottom if bottom > 0.0 else np.nan
    return out


@entry()
def swings(values, first, least):
    """Give the samples (W, 2) at which values (K,) have done 0.3 and 0.7 of each way of `least` or more, up or down.

    Such a way leads from where values turn back by `least` or more, or begin, to the next such place, or their last
    extreme. These parts of it are passed fast, wherever on level ground values turn, or rest half-way.
    first (P + 1,): where pieces begin, in which alone they are sought.
    """
    out = np.empty((len(values), 2), np.intp)
    count = 0
    for p in range(len(first) - 1):
        begin = top = bottom = first[p]  # of the way; the extremes since
        way = 0
        for k in range(first[p], first[p + 1]):
            if values[k] > values[top]:
                top = k
            if values[k] < values[bottom]:
                bottom = k
            if way >= 0 and values[top] - values[k] >= least:
                if way > 0:
                    count = _add_swing(out, count, values, begin, top)
                way, begin, bottom = -1, top, k
                top = k
            elif way <= 0 and values[k] - values[bottom] >= least:
                if way < 0:
                    count = _add_swing(out, count, values, begin, bottom)
                way, begin, top = 1, bottom, k
                bottom = k
        if way != 0:
            count = _add_swing(out, count, values, begin, top if way > 0 else bottom)
    return out[:count]


@inner
def _add_swing(out, count, values, begin, end):
    """Add the samples by which values, on their way from one extreme to the other, have done 0.3 and 0.7 of it."""
    size = values[end] - values[begin]
    k = begin
    while (values[k] - values[begin]) / size < 0.3:
        k += 1
    out[count, 0] = k
    while (values[k] - values[begin]) / size < 0.7:
        k += 1
    out[count, 1] = k
    return count + 1


@entry()
def within_rises(t, values, first, least, within):
    """Mark the samples (K,) that lie in a time of up to `within` in which values (K,) over t (K,) rise by over `least`.

    first (P + 1,): where pieces begin, in which alone they are sought.
    """
    out = np.zeros(len(values), np.bool_)
    for p in range(len(first) - 1):
        low = first[p]
        for k in range(first[p], first[p + 1]):
            while t[k] - t[low] > within + 1e-9:
                low += 1
            for n in range(low, k):
                if values[k] - values[n] > least:
                    out[n : k + 1] = True
                    break
    return out


@entry()
def overlaps(step_first, order, boxes, one, two):
    """Fill pairs of samples of one step whose boxes overlap or touch (separating axes); give how many there are.

    step_first (T + 1,), order (K,): samples by step, those of a step by x. boxes: x, y [m], heading [rad], half length,
    half width [m], each (K,). one, two: as long as there is room.
    """
    x, y, heading, half_length, half_width = boxes
    count = 0
    for step in range(len(step_first) - 1):
        low, high = step_first[step], step_first[step + 1]
        longest = 0.0
        for i in range(low, high):
            longest = max(longest, math.hypot(half_length[order[i]], half_width[order[i]]))
        for i in range(low, high):
            a = order[i]
            reach = math.hypot(half_length[a], half_width[a])
            for j in range(i + 1, high):
                b = order[j]
                dx, dy = x[b] - x[a], y[b] - y[a]
                if dx > reach + longest:
                    break
                if math.hypot(dx, dy) > reach + math.hypot(half_length[b], half_width[b]):
                    continue
                cos, sin = abs(math.cos(heading[b] - heading[a])), abs(math.sin(heading[b] - heading[a]))
                apart = False
                for side in range(2):
                    c, d = (a, b) if side == 0 else (b, a)
                    ca, sa = math.cos(heading[c]), math.sin(heading[c])
                    along = half_length[c] + cos * half_length[d] + sin * half_width[d]
                    across = half_width[c] + sin * half_length[d] + cos * half_width[d]
                    apart = apart or abs(ca * dx + sa * dy) > along or abs(ca * dy - sa * dx) > across
                if not apart and count < len(one):
                    one[count], two[count] = a, b
                    count += 1
    return count
