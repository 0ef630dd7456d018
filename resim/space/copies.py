"""Recordings that are there twice: the same traffic in another file of a drive, whatever its bytes are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from resim.core.geometry import Bools
from resim.space.traces import Ints, SlotTraces

EQUAL = 0.01
"""m that two scenarios differ at most in each slot and scene to see the same (our choice: less than a sensor tells)."""
MOVES = 0.5
"""m that somebody in a slot has to come or go: standing traffic, or a free road, looks the same in many drives."""
SHORTEST = 10
"""Scenes, 2 s, that a scenario has at least to be told from others."""
SHARE = 0.5
"""Of the scenarios of a recording that another one has to see as well to be the same drive (our choice)."""


def equal_scenarios(traces: SlotTraces, since: int = 0) -> Ints:
    """Give the rows (P, 2) of every two scenarios that see the same, of which one is no earlier row than `since`. Those
    in which nobody moves against the EGO are left aside."""
    return _equal(traces, _told(traces), since)


def first_copy(traces: SlotTraces, recording: Sequence[str], since: int = 0) -> tuple[int, int] | None:
    """Give the rows of a scenario that is in two recordings which see the same, None where there are none.

    recording (N,): of which each scenario is; since: the first row that is new. Those in which nobody moves against the
    EGO are left aside.
    """
    told = _told(traces)
    names, of = np.unique(np.asarray(recording, dtype=str), return_inverse=True)
    counts = np.bincount(of[told], minlength=len(names))
    pairs: dict[tuple[int, int], tuple[set[int], set[int], tuple[int, int]]] = {}
    for one, two in _equal(traces, told, since).tolist():
        if of[one] == of[two]:
            continue
        one, two = sorted((one, two), key=lambda row: (of[row], row))
        mine, theirs, _ = pairs.setdefault((int(of[one]), int(of[two])), (set(), set(), (one, two)))
        mine.add(one)
        theirs.add(two)
    for (a, b), (mine, theirs, rows) in sorted(pairs.items()):
        if len(mine) >= SHARE * counts[a] or len(theirs) >= SHARE * counts[b]:
            return rows
    return None


def _told(traces: SlotTraces) -> Ints:
    """The scenarios that can be told from others."""
    of, held = np.repeat(np.arange(len(traces)), traces.scenes), ~np.isnan(traces.offset)
    low, high = np.full((len(traces), 8), np.inf), np.full((len(traces), 8), -np.inf)
    np.minimum.at(low, of, np.where(held, traces.offset, np.inf))
    np.maximum.at(high, of, np.where(held, traces.offset, -np.inf))
    return np.flatnonzero(((high - low) >= MOVES).any(axis=1) & (traces.scenes >= SHORTEST))


def _equal(traces: SlotTraces, rows: Ints, since: int) -> Ints:
    """Pairs (P, 2) of scenarios that see the same: they are neighbours in what their slots are on average."""
    of = np.repeat(np.arange(len(traces)), traces.scenes)
    mean = np.bincount(of, np.nan_to_num(traces.offset).sum(axis=1), len(traces)) / np.maximum(
        traces.scenes, 1
    )
    rows = rows[np.lexsort((mean[rows], traces.scenes[rows]))]
    found = [np.zeros((0, 2), dtype=np.intp)]
    for apart in range(1, len(rows)):
        one, two = rows[:-apart], rows[apart:]
        near = (traces.scenes[one] == traces.scenes[two]) & (mean[two] - mean[one] <= 8.0 * EQUAL)
        if not near.any():
            break
        near &= np.maximum(one, two) >= since
        pair = np.stack([one[near], two[near]], axis=1)
        found += [row[None] for row in pair[_begin_alike(traces, pair)] if _alike(traces, row)]
    return np.concatenate(found)


def _begin_alike(traces: SlotTraces, pair: Ints) -> Bools:
    """Whether the first scenes of pairs (P, 2) are the same."""
    one, two = traces.offset[traces.first[pair[:, 0]]], traces.offset[traces.first[pair[:, 1]]]
    return np.asarray(np.isclose(one, two, rtol=0.0, atol=EQUAL, equal_nan=True).all(axis=1))


def _alike(traces: SlotTraces, pair: Ints) -> bool:
    one, two = (traces.offset[traces.first[row] : traces.first[row + 1]] for row in pair.tolist())
    return np.allclose(one, two, rtol=0.0, atol=EQUAL, equal_nan=True)
