"""Which SD object is which GT object: by assignment of those that are nearest to each other, in most of the samples.

The EGO only has what can be the sensor's own detection of it (`resim.recordings.own_detection`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from resim.core.geometry import Bools, Floats
from resim.core.tracks import Strings, Tracks
from resim.recordings.own_detection import elsewhere, other_shape

BEYOND = 1e6
"""What a pair beyond the gate costs [m]: no pair within it is given up for one."""


@dataclass(frozen=True, eq=False)
class Assignment:
    """SD objects and their GT.

    gt_id: (N_sd,) "" where it has none. distance: (N_sd,) median distance [m] from it, NaN where there is none.
    not_ego: why SD objects that are mostly within the gate of the EGO are not its detection, by their ids.
    """

    gt_id: Strings
    distance: Floats
    not_ego: Mapping[str, str] = field(default_factory=dict)


def assigned(gt: pd.DataFrame, sd: pd.DataFrame, gate: float, ego: str) -> Assignment:
    """Give the GT id of each SD object.

    At each SD time SD objects are assigned to the GT objects interpolated there, pairs farther than gate [m] left out,
    so that the sum of distances is least. An SD object has the GT object that it is assigned to in more than half of
    the samples that both have; the EGO only if it can be the EGO's own detection, throughout.

    gt, sd: track tables, each time and object once, no value missing but sizes and kinds of their own in each row.
    """
    whole, seen = Tracks.from_frame(gt), Tracks.from_frame(sd)
    truth = at_times_of(seen, whole)
    not_ego = _not_ego(truth, seen, gt[gt["id"] == ego], sd, ego)
    never = np.zeros((len(seen), len(truth)), dtype=bool)
    if ego in truth.ids:
        never[np.isin(seen.ids, list(not_ego)), truth.index(ego)] = True
    wins = np.zeros((len(seen), len(truth)), dtype=int)
    for k in range(len(seen.t)):
        own, known = np.flatnonzero(seen.valid[:, k]), np.flatnonzero(truth.valid[:, k])
        if len(own) and len(known):
            i, j = _pairs(seen, truth, (own, known), k, gate, never)
            wins[i, j] += 1
    both = seen.valid.astype(int) @ truth.valid.T.astype(int)
    most = wins.argmax(axis=1)
    rows = np.arange(len(seen))
    sure = wins[rows, most] > 0.5 * both[rows, most]
    gt_id = np.where(sure, truth.ids[most], "").astype(truth.ids.dtype)
    apart = np.hypot(seen.x - truth.x[most], seen.y - truth.y[most])
    distance = np.array([_median(apart[n]) if sure[n] else np.nan for n in rows])
    near = _near_ego(truth, seen, ego, gate)
    return Assignment(gt_id, distance, {name: why for name, why in not_ego.items() if name in near})


def _not_ego(truth: Tracks, seen: Tracks, own: pd.DataFrame, sd: pd.DataFrame, ego: str) -> dict[str, str]:
    """Which SD ids are not the EGO's own detection, and why."""
    if own.empty:
        return {}
    track = truth.select([ego])
    ego_size = (float(own["length"].max()), float(own["width"].max()))
    out = {}
    for name, rows in sd.groupby("id", sort=False):
        size = (float(rows["length"].max()), float(rows["width"].max()))
        if why := other_shape(rows, own) or elsewhere(*_offsets(seen, str(name), track), size, ego_size):
            out[str(name)] = why
    return out


def _offsets(seen: Tracks, name: str, ego: Tracks) -> tuple[Floats, NDArray[np.complex128]]:
    """Times (K,) [s] at which an SD object and the EGO are there, and its place (K,) [m] in the EGO's frame."""
    n = seen.index(name)
    both = seen.valid[n] & ego.valid[0]
    off = (seen.x[n, both] - ego.x[0, both]) + 1j * (seen.y[n, both] - ego.y[0, both])
    return seen.t[both], off * np.exp(-1j * ego.heading[0, both])


def _near_ego(truth: Tracks, seen: Tracks, ego: str, gate: float) -> set[str]:
    """The SD ids that are within the gate of the EGO in more than half of the samples that both have."""
    if ego not in truth.ids:
        return set()
    n = truth.index(ego)
    near = (np.hypot(seen.x - truth.x[n], seen.y - truth.y[n]) <= gate).sum(axis=1)
    return set(seen.ids[near > 0.5 * (seen.valid & truth.valid[n]).sum(axis=1)].tolist())


def distances(truth: Tracks, sd: Tracks, gt_id: Strings) -> Floats:
    """Give the median distance [m] of each SD object (N,) from the GT object that it names, NaN where none.

    truth: the GT at the times of the SD (`at_times_of`).
    """
    number = {name: n for n, name in enumerate(truth.ids.tolist())}
    out = np.full(len(sd), np.nan)
    for n, name in enumerate(gt_id.tolist()):
        if name in number:
            m = number[name]
            out[n] = _median(np.hypot(sd.x[n] - truth.x[m], sd.y[n] - truth.y[m]))
    return out


def _pairs(
    sd: Tracks, truth: Tracks, rows: tuple[np.ndarray, np.ndarray], k: int, gate: float, never: Bools
) -> tuple[np.ndarray, np.ndarray]:
    """SD and GT rows that belong to each other at a time, of these. never: (N_sd, N_gt) pairs that do not."""
    own, known = rows
    apart = np.hypot(sd.x[own, k][:, None] - truth.x[known, k], sd.y[own, k][:, None] - truth.y[known, k])
    apart[never[np.ix_(own, known)]] = np.inf
    i, j = nearest(apart, gate)
    return own[i], known[j]


def nearest(apart: Floats, gate: float) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Give rows and columns of the pairs within the gate whose sum of distances, of (N, M) [m], is least."""
    from scipy.optimize import (
        linear_sum_assignment,  # slow to load, and not needed to tell what is wrong in a file
    )

    i, j = linear_sum_assignment(np.where(apart <= gate, apart, BEYOND))
    near = apart[i, j] <= gate
    return i[near], j[near]


def at_times_of(sd: Tracks, gt: Tracks) -> Tracks:
    """Give the GT at the times of the SD, interpolated over at most two of its usual steps."""
    steps = np.concatenate([np.zeros(0), *(np.diff(gt.t[known]) for known in gt.valid)])
    return gt.at(sd.t, max_gap=max(0.3, 2.0 * float(np.median(steps))) if len(steps) else 0.3)


def _median(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else np.nan
