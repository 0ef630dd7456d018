"""Damage to exact tracks as that of a tracker: noise, gaps, broken tracks whose parts have ids of their own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from resim.core.geometry import wrap_angle
from resim.core.tracks import Tracks
from resim.recordings import Recording, write_recording

NOISE = {"x": 0.05, "y": 0.05, "heading": 0.002, "v": 0.05}
"""m, rad, m/s: standard deviations of white noise, sample by sample."""
GAPS, BROKEN = 0.3, 0.3
"""Share of vehicles with a gap; and of those whose track breaks there and begins anew under another id."""
LASTS = (0.2, 0.9)
"""s that a gap lasts."""
PART = "_part"


def whose(name: str) -> str:
    """Give the vehicle of which a track, or a part of one, is."""
    return name.partition(PART)[0]


def damaged(recording: Recording, folder: Path, rng: np.random.Generator) -> None:
    """Write a recording, damaged, as a new folder. The EGO's track has noise alone."""
    tracks = recording.gt
    moved = {n: getattr(tracks, n) + s * rng.standard_normal(tracks.x.shape) for n, s in NOISE.items()}
    moved["heading"] = wrap_angle(moved["heading"])
    parts = [replace(tracks, a=None, yaw_rate=None, **moved)]
    valid = tracks.valid.copy()
    later: list[tuple[int, np.ndarray]] = []
    for row in range(len(tracks)):
        steps = np.flatnonzero(valid[row])
        gap, broken = rng.random() < GAPS, rng.random() < BROKEN
        lasts, at = rng.uniform(*LASTS), rng.uniform(0.15, 0.85)
        if not gap or str(tracks.ids[row]) == recording.ego or len(steps) < 100:
            continue
        first = steps[int(at * len(steps))]
        after = tracks.t > tracks.t[first] + lasts
        valid[row, first : np.flatnonzero(after)[0] if after.any() else None] = False
        if broken and (valid[row] & after).any():
            later.append((row, valid[row] & after))
            valid[row] &= ~after
    whole = _valid(parts[0], valid)
    if later:
        rows = np.array([row for row, _ in later])
        part = whole.select(whole.ids[rows])
        own = _valid(parts[0].select(whole.ids[rows]), np.array([mask for _, mask in later]))
        part = replace(own, ids=np.array([f"{name}{PART}" for name in part.ids.tolist()], dtype=str))
        whole = Tracks.concatenate([whole, part])
    write_recording(replace(recording, gt=whole, name=folder.name), folder, parquet=True)


def _valid(tracks: Tracks, valid: np.ndarray) -> Tracks:
    """The tracks without the samples that are not valid."""
    columns = {n: np.where(valid, getattr(tracks, n), np.nan) for n in ("x", "y", "heading", "v")}
    return replace(tracks, valid=valid, **columns)
