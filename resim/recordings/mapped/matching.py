"""Which SD object is which GT object: by assignment of those that are nearest to each other, in most of the samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from resim.core.geometry import Floats
from resim.core.tracks import Strings, Tracks

BEYOND = 1e6
"""What a pair beyond the gate costs [m]: no pair within it is given up for one."""


@dataclass(frozen=True, eq=False)
class Assignment:
    """SD objects and their GT.

    gt_id: (N_sd,) "" where it has none. distance: (N_sd,) median distance [m] from it, NaN where there is none.
    """

    gt_id: Strings
    distance: Floats


def assigned(gt: Tracks, sd: Tracks, gate: float) -> Assignment:
    """Give the GT id of each SD object.

    At each SD time SD objects are assigned to the GT objects interpolated there, pairs farther than gate [m] left out,
    so that the sum of distances is least. An SD object has the GT object that it is assigned to in more than half of
    the samples that both have.
    """
    truth = gt.at(sd.t, max_gap=_max_gap(gt))
    wins = np.zeros((len(sd), len(gt)), dtype=int)
    for k in range(len(sd.t)):
        own, known = np.flatnonzero(sd.valid[:, k]), np.flatnonzero(truth.valid[:, k])
        if len(own) and len(known):
            i, j = _pairs(sd, truth, own, known, k, gate)
            wins[i, j] += 1
    both = sd.valid.astype(int) @ truth.valid.T.astype(int)
    most = wins.argmax(axis=1)
    rows = np.arange(len(sd))
    sure = wins[rows, most] > 0.5 * both[rows, most]
    gt_id = np.where(sure, gt.ids[most], "").astype(gt.ids.dtype)
    apart = np.hypot(sd.x - truth.x[most], sd.y - truth.y[most])
    distance = np.array([_median(apart[n]) if sure[n] else np.nan for n in rows])
    return Assignment(gt_id, distance)


def distances(gt: Tracks, sd: Tracks, gt_id: Strings) -> Floats:
    """Give the median distance [m] of each SD object (N,) from the GT object that it names, NaN where none."""
    truth = gt.at(sd.t, max_gap=_max_gap(gt))
    number = {name: n for n, name in enumerate(gt.ids.tolist())}
    out = np.full(len(sd), np.nan)
    for n, name in enumerate(gt_id.tolist()):
        if name in number:
            m = number[name]
            out[n] = _median(np.hypot(sd.x[n] - truth.x[m], sd.y[n] - truth.y[m]))
    return out


def _pairs(
    sd: Tracks, truth: Tracks, own: np.ndarray, known: np.ndarray, k: int, gate: float
) -> tuple[np.ndarray, np.ndarray]:
    """SD and GT rows that belong to each other at a time."""
    apart = np.hypot(sd.x[own, k][:, None] - truth.x[known, k], sd.y[own, k][:, None] - truth.y[known, k])
    i, j = linear_sum_assignment(np.where(apart <= gate, apart, BEYOND))
    near = apart[i, j] <= gate
    return own[i[near]], known[j[near]]


def _max_gap(gt: Tracks) -> float:
    """Time [s] over which GT is interpolated: two of its usual steps."""
    steps = np.concatenate([np.zeros(0), *(np.diff(gt.t[known]) for known in gt.valid)])
    return max(0.3, 2.0 * float(np.median(steps))) if len(steps) else 0.3


def _median(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else np.nan
