"""Drives that are there again, nearly: with noise, by another clock or sampling rate, or cut with an overlap.

Two scenarios see the same traffic where the vehicles around their EGOs move alike over some time, whenever that is by
their clocks. They are found at moments that depend on neither clock nor rate: when somebody comes or goes past a whole
number of metres ahead of the EGO, and where all others are then. That two vehicles come or go at the same time, each
within a sensor's error for seconds, hardly happens twice by chance; where it does, one drive less is on the safe side.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from resim.core.geometry import Floats
from resim.space.traces import RATE, Ints, SlotTraces

GRID = 2.0
"""m ahead, and multiples, at whose passing scenarios are compared."""
SLOWEST = 0.5
"""m/s by which somebody comes or goes at least: else noise tells when."""
FASTEST = 60.0
"""m/s at most: more is another vehicle in the slot."""
NEAR, ALIKE = 0.3, 0.8
"""m, m/s that others, and the speed of who passes, differ at most at a moment (our choice)."""
ERROR = 0.3
"""m that the vehicles around differ at most (our choice: positions of both with errors of 0.1 m)."""
AGREE = 0.75
"""Of what both scenarios see, share that has to agree: at the edges of slots noise decides who holds them."""
LEAST = 15
"""Scenes, 3 s, that two scenarios have to have in common."""
TOGETHER = 5
"""Scenes, 1 s, in which at least two vehicles come or go at the same time."""
HITS = 3
"""Moments at which both are alike, at least, to be looked at."""
AT_ONCE = 2_000_000
"""Of moments that are alike, how many are held at once, about: 150 MB."""


class _Moments(NamedTuple):
    """K moments: row of the scenario, time from its start [s], and what tells them apart: a code, numbers (K, 9)."""

    row: Ints
    t: Floats
    code: Ints
    told: Floats


def same_traffic(traces: SlotTraces, drive: Sequence[str], place: Sequence[str], since: int = 0) -> Ints:
    """Give rows (P, 2) of scenarios of two drives that see the same traffic, within a sensor's error.

    drive, place (N,): drive and map of each; since: the first row that is new, of which one of each pair is. Drives
    that a pair has linked are not compared again: pairs say which drives are one, and not all scenarios that show it.
    """
    found = _moments(traces, np.unique(np.asarray(place, dtype=str), return_inverse=True)[1])
    new = np.isin(found.code, found.code[found.row >= since])
    found = _Moments(found.row[new], found.t[new], found.code[new], found.told[new])
    points = np.column_stack([3.0 * found.code, found.told])
    of, out = np.unique(np.asarray(drive, dtype=str), return_inverse=True)[1], []
    for row, shift in _hits(points, found, of, since):
        pair, which, count = np.unique(row, axis=0, return_inverse=True, return_counts=True)
        order = np.argsort(which.ravel(), kind="stable")
        shifts = np.split(shift[order], np.cumsum(count)[:-1])
        for k in np.flatnonzero(count >= HITS).tolist():
            one, two = of[pair[k]].tolist()
            if one != two and _agree(traces, pair[k], float(np.median(shifts[k]))):
                of[of == two] = one
                out.append(pair[k])
    return np.array(out, dtype=np.intp).reshape(-1, 2)


def _hits(points: Floats, found: _Moments, of: Ints, since: int) -> Iterator[tuple[Ints, Floats]]:
    """Moments that are alike, block by block: rows (H, 2) of their scenarios, all that a later one has with earlier
    ones at once, and times (H,) from the one to the other [s].

    of (N,): number of the drive of each scenario, which may change between blocks.
    """
    begin = int(np.searchsorted(found.row, since))
    if begin == len(points):
        return
    tree = cKDTree(points)
    count = tree.query_ball_point(points[begin:], 1.0, p=np.inf, return_length=True)
    first = np.unique(found.row[begin:], return_index=True)[1]
    block = np.cumsum(np.add.reduceat(count, first)) // AT_ONCE
    for low, high in pairwise(
        [*(begin + first[np.unique(block, return_index=True)[1]]).tolist(), len(points)]
    ):
        hits = cKDTree(points[low:high]).sparse_distance_matrix(tree, 1.0, p=np.inf, output_type="ndarray")
        later, earlier = low + hits["i"], hits["j"]
        row = np.stack([found.row[earlier], found.row[later]], axis=1)
        apart = (row[:, 0] < row[:, 1]) & (of[row[:, 0]] != of[row[:, 1]])
        yield row[apart], (found.t[later] - found.t[earlier])[apart]


def merged(names: Sequence[str], pairs: Ints) -> np.ndarray:
    """Give the names (N,) of drives, where those that pairs (P, 2) of rows link have one name, the first of them."""
    unique, of = np.unique(np.asarray(names, dtype=str), return_inverse=True)
    edges = of[pairs]
    graph = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(len(unique), len(unique)))
    label = connected_components(graph, directed=False)[1]
    first = np.unique(label, return_index=True)[1]
    return np.asarray(unique[first[label]][of])


def _moments(traces: SlotTraces, place: Ints) -> _Moments:
    """When somebody passes a multiple of GRID ahead of an EGO while somebody else is around."""
    of = np.repeat(np.arange(len(traces)), traces.scenes)
    step = traces.offset[1:] - traces.offset[:-1]
    low = np.floor(traces.offset[:-1] / GRID)
    over = np.floor(traces.offset[1:] / GRID) - low
    speed = np.abs(step) * RATE
    passes = (over != 0.0) & (of[1:] == of[:-1])[:, None] & (speed >= SLOWEST) & (speed <= FASTEST)
    scene, slot = np.nonzero(passes)
    line = low[scene, slot] + (step[scene, slot] > 0.0)  # the first one that is passed
    share = (line * GRID - traces.offset[scene, slot]) / step[scene, slot]
    others = traces.offset[scene] + share[:, None] * step[scene]
    others[np.arange(len(scene)), slot] = np.nan
    held = ~np.isnan(others)
    some = held.any(axis=1)
    scene, slot, line, share = scene[some], slot[some], line[some], share[some]
    others, held = others[some], held[some]
    row = of[scene]
    known = np.column_stack([place[row], slot, line, held @ (1 << np.arange(8))]).astype(np.intp)
    code = np.unique(known, axis=0, return_inverse=True)[1].ravel()
    told = np.column_stack([np.nan_to_num(others) / NEAR, step[scene, slot] * RATE / ALIKE])
    return _Moments(row, (scene - traces.first[row] + share) / RATE, code, told)


def _agree(traces: SlotTraces, pair: Ints, shift: float) -> bool:
    """Whether two scenarios see the same traffic. shift [s]: of the second one's time from the first one's, about."""
    one, two = (np.arange(traces.first[k], traces.first[k + 1]) for k in pair.tolist())
    for _ in range(2):
        at = np.arange(len(one)) + shift * RATE
        common = np.flatnonzero((at >= 0.0) & (at <= len(two) - 1))
        if len(common) < LEAST:
            return False
        before = np.minimum(at[common].astype(np.intp), len(two) - 2)
        share = (at[common] - before)[:, None]
        first, then = traces.offset[two[before]], traces.offset[two[before + 1]]
        apart = traces.offset[one[common]] - (first + share * (then - first))
        speed = traces.speed[one[common]]
        good = np.abs(apart) <= 3.0 * NEAR
        shift += float((apart * speed)[good].sum() / max((speed**2)[good].sum(), 1e-9))
    seen = ~np.isnan(traces.offset[one[common]]) | ~np.isnan(first)
    agree = np.abs(apart) <= ERROR
    moves = agree & (np.abs(speed) >= SLOWEST)
    return bool(agree.sum() >= AGREE * seen.sum() and (moves.sum(axis=1) >= 2).sum() >= TOGETHER)
