"""The innermost work of `resim.mining.surroundings`, compiled by numba: who is ahead, and who holds which slot.

What is compiled is kept on disk by the source of this module alone, so it takes nothing from others that may change.
"""

# mypy: ignore-errors
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from resim.core.compiled import entry, inner

LONG = 128
"""Rows of a way ahead or back at most."""
SAME = 1e-9
"""m that make no difference at the borders of slots."""
OWN, LEFT, RIGHT = 0, 1, 2
"""What of a row is looked at: it and those beside it, or it alone as the lane to the left or right."""


class SamplesByStep(NamedTuple):
    """Samples on lanes: those of step i are order[first[i]:first[i + 1]], by row, then by metres along the lane."""

    first: np.ndarray
    order: np.ndarray


class LaneSamples(NamedTuple):
    """Samples (K,): row, s on the road, u along the lane [m], with_lane (driven as it is meant to), run: the stretch of
    the track on one row, rank: of the object's id.
    """

    row: np.ndarray
    s: np.ndarray
    u: np.ndarray
    with_lane: np.ndarray
    run: np.ndarray
    rank: np.ndarray


class LaneRuns(NamedTuple):
    """Stretches of tracks (R,): row, and the stretch that goes on from it and that it comes from, -1 for none."""

    row: np.ndarray
    after: np.ndarray
    before: np.ndarray


class LaneWays(NamedTuple):
    """Rows (L,): graphs (first, to) ahead and back, who is beside whom, and the tables of `Stations`."""

    after_first: np.ndarray
    after_to: np.ndarray
    before_first: np.ndarray
    before_to: np.ndarray
    beside_left: np.ndarray
    beside_right: np.ndarray
    node: np.ndarray
    start: np.ndarray
    step: np.ndarray
    at: np.ndarray
    length: np.ndarray
    forward: np.ndarray


class SlotBorders(NamedTuple):
    """m: half the zone beside, and how far slots reach ahead and behind."""

    beside: float
    ahead: float
    behind: float


class HeldSlots(NamedTuple):
    """samples (K, 8): who holds each slot, -1 for nobody; offsets (K, 8): m ahead along the EGO's lane."""

    samples: np.ndarray
    offsets: np.ndarray


class Looking(NamedTuple):
    """Scratch: where in `order` the samples of each row begin and end, and the rows still to be looked at."""

    low: np.ndarray
    high: np.ndarray
    row: np.ndarray
    offset: np.ndarray
    mode: np.ndarray
    run: np.ndarray


@inner
def looking(rows):
    """Give empty scratch for so many rows."""
    return Looking(
        np.full(rows, -1, np.int64), np.full(rows, -1, np.int64), np.empty(LONG + 8, np.int64), np.empty(LONG + 8),
        np.empty(LONG + 8, np.int64), np.empty(LONG + 8, np.int64),
    )  # fmt: skip


@inner
def group(steps, step, on, look):
    """Note where the samples of each row begin and end in a step."""
    for i in range(steps.first[step], steps.first[step + 1]):
        r = on.row[steps.order[i]]
        if look.low[r] < 0:
            look.low[r] = i
        look.high[r] = i + 1


@inner
def ungroup(steps, step, on, look):
    """Forget it."""
    for i in range(steps.first[step], steps.first[step + 1]):
        look.low[on.row[steps.order[i]]] = -1


@inner
def leads(ways, ahead, row, other):
    """Say whether row leads to the other at once, ahead or back."""
    first = ways.after_first if ahead else ways.before_first
    to = ways.after_to if ahead else ways.before_to
    found = False
    for i in range(first[row], first[row + 1]):
        found = found or to[i] == other
    return found


@inner
def beyond(steps, on, ways, look, k, least):
    """Give the nearest sample up to `least` [m] away on any way on from the row in look, and its distance [m].

    look.row[0], look.offset[0]: the row, and how far away [m] it ends.
    """
    best, top = -1, 1
    while top > 0:
        top -= 1
        row, gone = look.row[top], look.offset[top]
        for i in range(ways.after_first[row], ways.after_first[row + 1]):
            other = ways.after_to[i]
            if gone > least:
                continue
            if look.low[other] >= 0:
                j = steps.order[look.low[other]]
                if j != k and gone + on.u[j] <= least:
                    best, least = j, gone + on.u[j]
            elif top < LONG:
                look.row[top], look.offset[top] = other, gone + ways.length[other]
                top += 1
    return best, least


@inner
def next_ahead(steps, on, runs, ways, look, i):
    """Give the next sample ahead of the i-th in order up to look.offset[-1] [m] away, -1 for none, and the distance."""
    k, far = steps.order[i], look.offset[-1]
    here = on.row[k]
    if i + 1 < look.high[here]:
        j = steps.order[i + 1]
        return (j, on.u[j] - on.u[k]) if on.u[j] - on.u[k] <= far else (-1, far)
    gone, run = ways.length[here] - on.u[k], on.run[k]
    for _ in range(LONG):
        if gone > far:
            break
        run = runs.after[run]
        if run < 0 or not leads(ways, True, here, runs.row[run]):
            look.row[0], look.offset[0] = here, gone
            return beyond(steps, on, ways, look, k, far)
        here = runs.row[run]
        if look.low[here] >= 0:
            j = steps.order[look.low[here]]
            return (j, gone + on.u[j]) if j != k and gone + on.u[j] <= far else (-1, far)
        gone += ways.length[here]
    return -1, far


@entry()
def leaders(steps, on, runs, ways, far, found):
    """Give the distance (K,) [m] to the next sample ahead on the lane's way up to `far` [m] away, NaN for none, and
    fill found (K,) with it.

    The way is that which the object takes, as far as its track shows it; beyond, any that the map has. Who drives
    against his lane has none.
    """
    distance, look = np.full(len(on.row), np.nan), looking(len(ways.length))
    look.offset[-1] = far
    for step in range(len(steps.first) - 1):
        group(steps, step, on, look)
        for i in range(steps.first[step], steps.first[step + 1]):
            k = steps.order[i]
            if on.with_lane[k]:
                j, gap = next_ahead(steps, on, runs, ways, look, i)
                if j >= 0:
                    found[k], distance[k] = j, gap
        ungroup(steps, step, on, look)
    return distance


@inner
def station(ways, row, s):
    """Give metres along the centre of a row at s [m] of its road, as `MinedLanes.station`."""
    first, count = ways.node[row], ways.node[row + 1] - ways.node[row]
    place = min(max((s - ways.start[row]) / ways.step[row], 0.0), count - 1.0)
    node = min(int(place), count - 2)
    low = ways.at[first + node]
    along = low + (place - node) * (ways.at[first + node + 1] - low)
    return along if ways.forward[row] else ways.length[row] - along


@inner
def take(k, j, far, slot, rank, held):
    """Give a slot to a sample that is nearer than who has it, or as near and of the lower id."""
    other = held.samples[k, slot]
    if other >= 0:
        own = abs(held.offsets[k, slot])
        if abs(far) > own or (abs(far) == own and rank[j] > rank[other]):
            return
    held.samples[k, slot], held.offsets[k, slot] = j, far


@inner
def slot_of(far, side, borders):
    """Give the slot (0 to 7) of who is `far` [m] ahead in the own lane or on a side, -1 for none."""
    if far > borders.ahead + SAME or far < -borders.behind - SAME:
        return -1
    near = abs(far) <= borders.beside + SAME
    if side == OWN:
        return -1 if near else 3 if far < 0.0 else 4
    base = 0 if side == LEFT else 5
    return base + 1 if near else base if far < 0.0 else base + 2


@inner
def look_at(steps, on, ways, look, top, k_held_borders):
    """Put those on the row at `top`, and beside it, into the slots of sample k."""
    k, held, borders = k_held_borders
    here, offset, mode = look.row[top], look.offset[top], look.mode[top]
    for side in range(3):
        if mode not in (OWN, side):
            continue
        other = here
        if mode == OWN and side != OWN:
            other = ways.beside_left[here] if side == LEFT else ways.beside_right[here]
        if other < 0 or look.low[other] < 0:
            continue
        for n in range(look.low[other], look.high[other]):
            j = steps.order[n]
            far = offset + (on.u[j] if other == here else station(ways, here, on.s[j]))
            slot = slot_of(far, side, borders)
            if j != k and slot >= 0:
                take(k, j, far, slot, on.rank, held)


@inner
def push(ways, look, top, row, ahead, edge):
    """Note the rows that a row leads to, ahead or back; edge: where it ends, m from the EGO. Give the new top."""
    first = ways.after_first if ahead else ways.before_first
    to = ways.after_to if ahead else ways.before_to
    for n in range(first[row], first[row + 1]):
        if top < LONG:
            look.row[top], look.run[top] = to[n], -1
            look.offset[top] = edge if ahead else edge - ways.length[to[n]]
            top += 1
    return top


@inner
def go_on(runs, ways, look, top, ahead, borders):
    """Note the rows that come after the one at `top`, on the track as far as it shows them. Give the new top."""
    here, offset, mode, run = look.row[top], look.offset[top], look.mode[top], look.run[top]
    edge = offset + ways.length[here] if ahead else offset
    if top >= LONG or (edge > borders.ahead if ahead else edge < -borders.behind):
        return top
    follows = -1
    if run >= 0:
        follows = runs.after[run] if ahead else runs.before[run]
    if follows >= 0 and leads(ways, ahead, here, runs.row[follows]):
        row = runs.row[follows]
        look.row[top], look.run[top] = row, follows
        look.offset[top] = edge if ahead else edge - ways.length[row]
        return top + 1
    now = push(ways, look, top, here, ahead, edge)
    look.mode[top:now] = mode
    if now == top and mode == OWN:  # the lane ends: those beside it go on
        for side in (LEFT, RIGHT):
            nearby = ways.beside_left[here] if side == LEFT else ways.beside_right[here]
            if nearby >= 0:
                begin = now
                now = push(ways, look, now, nearby, ahead, edge)
                look.mode[begin:now] = side
    return now


@entry()
def hold(steps, on, runs, ways, borders, held):
    """Fill who holds the slots of each sample.

    Slots I to VIII: left rear, beside, front; own lane rear, front; right rear, beside, front. The way ahead and back
    is that of the track, beyond it any. Who drives against his lane has none.
    """
    look = looking(len(ways.length))
    for step in range(len(steps.first) - 1):
        group(steps, step, on, look)
        for i in range(steps.first[step], steps.first[step + 1]):
            k = steps.order[i]
            if not on.with_lane[k]:
                continue
            for ahead in (True, False):
                look.row[0], look.offset[0], look.mode[0], look.run[0] = on.row[k], -on.u[k], OWN, on.run[k]
                if ahead:
                    look_at(steps, on, ways, look, 0, (k, held, borders))
                top = go_on(runs, ways, look, 0, ahead, borders)
                while top > 0:
                    top -= 1
                    look_at(steps, on, ways, look, top, (k, held, borders))
                    top = go_on(runs, ways, look, top, ahead, borders)
        ungroup(steps, step, on, look)
