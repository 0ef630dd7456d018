"""Sensor tracks under the names of the ground truth: identity changes undone, fragments merged."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats
from resim.core.objects import GAP
from resim.core.sightings import SAME
from resim.core.tracks import OPTIONAL_COLUMNS, Strings, Tracks

UNMATCHED = "sd:"


def name_by_ground_truth(sd: Tracks, gt_id: Strings, existence: Floats | None) -> Tracks:
    """Give the SD tracks under their GT ids, one track per GT object.

    gt_id: (N,), "" for none; those objects become `sd:<id>`. existence: (N, T), NaN where unknown. Where
    several fragments of one GT object are valid at one time, the one with the higher existence probability
    stands, else the one with more samples. Length, width and kind are those of the fragment with most.
    """
    names = sensor_names(sd, gt_id)
    score = np.zeros(sd.valid.shape) if existence is None else np.nan_to_num(existence, nan=0.0)
    score = np.where(sd.valid, score, -1.0)
    samples = sd.valid.sum(axis=1)
    parts = []
    for name in dict.fromkeys(names.tolist()):
        rows = np.flatnonzero(names == name)
        rows = rows[np.argsort(-samples[rows], kind="stable")]
        parts.append(_merge(sd.select(sd.ids[rows]), score[rows].argmax(axis=0), name))
    return Tracks.concatenate(parts)


def sensor_names(sd: Tracks, gt_id: Strings) -> Strings:
    """Give what each SD object (N,) is called beside the ground truth; gt_id: (N,), "" for none."""
    return np.where(gt_id != "", gt_id, np.char.add(UNMATCHED, sd.ids))


@dataclass(frozen=True)
class DetectionSpread:
    """What two detections of one object at one time differ by at most: m, rad (front and rear are the same), m/s."""

    apart: float
    turned: float
    faster: float


def doubled(sd: Tracks, gt_id: Strings) -> dict[str, DetectionSpread]:
    """Give by what fragments of one GT object differ that are there at one time, by its name.

    A fragment is there between two of its samples that are at most GAP apart.
    """
    names, out = sensor_names(sd, gt_id), {}
    for name in np.unique(names[np.isin(names, gt_id)]).tolist():
        own = np.flatnonzero(names == name).tolist()
        pairs = [_differences(sd, a, b) for a in own for b in own if a != b]
        if both := [pair for pair in pairs if pair is not None]:
            out[name] = DetectionSpread(*np.max(both, axis=0).tolist())
    return out


def _differences(sd: Tracks, a: int, b: int) -> tuple[float, float, float] | None:
    """By how much b's samples differ from a between its samples; None where they are never there at one time."""
    known = np.flatnonzero(sd.valid[a])
    at = np.flatnonzero(sd.valid[b])
    late = np.searchsorted(sd.t[known], sd.t[at])
    at, late = at[late < len(known)], late[late < len(known)]
    early = np.where(sd.t[known[late]] == sd.t[at], late, late - 1)
    there = (early >= 0) & (sd.t[known[late]] - sd.t[known[early]] <= GAP + SAME)
    at, i, j = at[there], known[early[there]], known[late[there]]
    if not len(at):
        return None
    share = (sd.t[at] - sd.t[i]) / np.maximum(sd.t[j] - sd.t[i], SAME)
    place, velocity = sd.x + 1j * sd.y, sd.v * np.exp(1j * sd.heading)
    apart, faster = (np.abs(z[a, i] + share * (z[a, j] - z[a, i]) - z[b, at]) for z in (place, velocity))
    turn = np.abs(np.angle(np.exp(2j * (sd.heading[a, i] - sd.heading[b, at])))) / 2.0
    return float(apart.max()), float(turn.max()), float(faster.max())


def _merge(fragments: Tracks, chosen: NDArray[np.intp], name: str) -> Tracks:
    """One track that is, at each time, the chosen fragment (T,)."""
    names = ("x", "y", "heading", "v", "valid", *OPTIONAL_COLUMNS)
    values = {c: getattr(fragments, c) for c in names if getattr(fragments, c) is not None}
    merged = {c: np.take_along_axis(value, chosen[None, :], axis=0) for c, value in values.items()}
    longest = fragments.select(fragments.ids[:1])
    return replace(longest, ids=np.array([name]), **merged)
