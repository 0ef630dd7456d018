"""Recordings that are there twice: the same traffic in another file of a drive, whatever its bytes are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from resim.space.traces import Ints, SlotTraces

EQUAL = 0.01
"""m that two scenarios differ at most in each slot and scene to see the same (our choice: less than a sensor tells)."""
MOVES = 0.5
"""m that somebody in a slot has to come or go: standing traffic, or a free road, looks the same in many drives."""
SHORTEST = 10
"""Scenes, 2 s, that a scenario has at least to be told from others."""
SHARE = 0.5
"""Of the scenarios of a recording that another one has to see as well to be the same drive (our choice)."""


def equal_scenarios(traces: SlotTraces) -> Iterator[tuple[int, int]]:
    """Give the rows of every two scenarios that see the same. Those in which nobody moves against the EGO are left
    aside."""
    return _equal(traces, _told(traces))


def first_copy(traces: SlotTraces, recording: Sequence[str]) -> tuple[int, int] | None:
    """Give the rows of a scenario that is in two recordings which see the same, None where there are none.

    recording (N,): of which each scenario is. Those in which nobody moves against the EGO are left aside.
    """
    told = _told(traces)
    names, of = np.unique(np.asarray(recording, dtype=str), return_inverse=True)
    counts = np.bincount(of[told], minlength=len(names))
    pairs: dict[tuple[int, int], tuple[set[int], set[int], tuple[int, int]]] = {}
    for one, two in _equal(traces, told):
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


def _equal(traces: SlotTraces, rows: Ints) -> Iterator[tuple[int, int]]:
    """Pairs of scenarios that see the same: they are neighbours in what their slots are on average."""
    of = np.repeat(np.arange(len(traces)), traces.scenes)
    mean = np.bincount(of, np.nan_to_num(traces.offset).sum(axis=1), len(traces)) / np.maximum(
        traces.scenes, 1
    )
    rows = rows[np.lexsort((mean[rows], traces.scenes[rows]))]
    for k, row in enumerate(rows.tolist()):
        for other in rows[k + 1 :].tolist():
            if traces.scenes[other] != traces.scenes[row] or mean[other] - mean[row] > 8.0 * EQUAL:
                break
            a, b = (traces.offset[traces.first[one] : traces.first[one + 1]] for one in (row, other))
            if np.allclose(a, b, rtol=0.0, atol=EQUAL, equal_nan=True):
                yield row, other
