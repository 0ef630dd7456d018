"""Every vehicle of a recording in few samples: what Kaefer's graphical statistics (Table 4.5) are drawn from."""

from __future__ import annotations

import numpy as np
import pandas as pd

from resim.mining.features import Features
from resim.mining.samples import VEHICLES, Ints, Samples

MOST = 6000
"""Samples of a recording that are drawn, beside the first and the last of each piece."""


def overview_frame(features: Features) -> pd.DataFrame:
    """Give samples of all vehicles, equally far apart in time: object, piece, t [s], x, y [m], v [m/s], lane."""
    samples = features.samples
    taken = _thinned(samples)
    ids = np.asarray(samples.tracks.ids)[samples.owner[taken]]
    return pd.DataFrame({
        "object": ids.astype(str), "piece": samples.piece_of[taken], "t": samples.t[taken],
        "x": samples.x[taken], "y": samples.y[taken], "v": samples.v[taken], "lane": features.lane_names(taken),
    }).astype({"object": "string", "lane": "string", "piece": "int64"})  # fmt: skip


def _thinned(samples: Samples) -> Ints:
    """Give the samples to draw: the first and the last of each piece of a vehicle, and one each so many seconds."""
    if not len(samples):
        return np.zeros(0, np.intp)
    piece = samples.piece_of
    begun = samples.t - samples.t[samples.piece[:-1]][piece]
    driven = samples.kinds(VEHICLES)
    ends = np.r_[samples.piece[1:] - 1]
    lasts = float(begun[ends][driven[ends]].sum())
    slot = np.floor(begun / max(lasts / MOST, 1e-9)).astype(np.int64)
    new = np.ones(len(samples), dtype=bool)
    new[1:] = (slot[1:] != slot[:-1]) | (piece[1:] != piece[:-1])
    new[ends] = True
    return np.flatnonzero(new & driven)
