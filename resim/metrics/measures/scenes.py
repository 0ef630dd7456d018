"""Tracks into scenes: what the EGO drove, and who was around."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from resim.core.geometry import Bools, Floats
from resim.core.tracks import Tracks
from resim.metrics.measures.driving import WINDOW, longitudinal_acceleration, yaw_rate
from resim.metrics.measures.pairs import Pairs


def driven_pairs(
    tracks: Tracks, ego: str, t: Floats, *, horizon: float, step: float = 0.1, driven: bool = False,
    window: float = WINDOW,
) -> Pairs:  # fmt: skip
    """Give the scenes at times t (S,) [s], the EGO's driven path as its plan; objects (K) in the order of `ids`.

    Tracks that end within the horizon [s] go straight on. A time at which an object is not there, or gaps of over 0.3 s
    in what is needed, are NaN: NOT_COMPUTED. driven: take the objects' driven paths in place of predicted ones, for
    `pet` above all. Accelerations and yaw rates that were not measured are slopes over `window` [s]. Raises
    ResimError for an unknown EGO.
    """
    row = tracks.index(ego)
    a, rate = longitudinal_acceleration(tracks, window=window).value, yaw_rate(tracks, window=window)
    known = replace(tracks, a=a, yaw_rate=rate)
    times = np.asarray(t, dtype=float)[:, None] + np.arange(round(horizon / step) + 1) * step
    poses, there = _poses(known, times)
    others = np.flatnonzero(np.arange(len(tracks)) != row)
    now = known.at(t)
    state = np.stack([now.x, now.y, now.heading, now.v, now.a, now.yaw_rate], axis=-1)[others].swapaxes(0, 1)  # type: ignore[list-item]
    plan = np.where(there[row][:, None, None], poses[row], np.nan)
    sizes = np.stack([tracks.length, tracks.width], axis=-1)
    return Pairs(
        plan, np.tile(sizes[row], (len(plan), 1)), state, np.tile(sizes[others], (len(plan), 1, 1)), step,
        path=poses[others].swapaxes(0, 1) if driven else None,
    )  # fmt: skip


def _poses(tracks: Tracks, times: Floats) -> tuple[Floats, Bools]:
    """Poses (N, S, M + 1, 4) at times (S, M + 1), straight on after a track's end; and who is there (N, S) at first."""
    every, place = np.unique(times, return_inverse=True)
    seen = tracks.at(every)
    poses = np.stack([seen.x, seen.y, seen.heading, seen.v], axis=-1)[:, place.reshape(times.shape)]
    there = np.isfinite(poses[:, :, 0, 0])
    end = tracks.span()[1]
    for n in np.flatnonzero(np.isfinite(end)):
        last = int(np.flatnonzero(tracks.valid[n])[-1])
        x, y, heading, v = (o[n, last] for o in (tracks.x, tracks.y, tracks.heading, tracks.v))
        late = (times > end[n]) & there[n][:, None] & ~np.isfinite(poses[n, :, :, 0])
        way = v * (times[late] - end[n])
        poses[n][late] = np.stack(
            [x + way * np.cos(heading), y + way * np.sin(heading), heading + 0 * way, v + 0 * way], axis=-1
        )
    return poses, there
