"""Sensor tracks under the names of the ground truth: identity changes undone, fragments merged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats
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


def doubled(sd: Tracks, gt_id: Strings) -> dict[str, float]:
    """Give how far apart [m] fragments of one GT object are at most that are valid at one time, by its name."""
    names, out = sensor_names(sd, gt_id), {}
    for name in np.unique(names[np.isin(names, gt_id)]).tolist():
        own = names == name
        both = sd.valid[own].sum(axis=0) > 1
        place = np.where(sd.valid[own], sd.x[own] + 1j * sd.y[own], np.nan)[:, both]
        if both.any():
            out[name] = float(np.nanmax(np.abs(place[:, None] - place[None])))
    return out


def _merge(fragments: Tracks, chosen: NDArray[np.intp], name: str) -> Tracks:
    """One track that is, at each time, the chosen fragment (T,)."""
    names = ("x", "y", "heading", "v", "valid", *OPTIONAL_COLUMNS)
    values = {c: getattr(fragments, c) for c in names if getattr(fragments, c) is not None}
    merged = {c: np.take_along_axis(value, chosen[None, :], axis=0) for c, value in values.items()}
    longest = fragments.select(fragments.ids[:1])
    return replace(longest, ids=np.array([name]), **merged)
