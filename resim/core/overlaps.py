"""Who is in whom: pairs of tracks whose boxes overlap."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from resim.core.geometry import Boxes, boxes_overlap
from resim.core.tracks import Tracks


def first_overlaps(tracks: Tracks) -> list[tuple[int, int, float]]:
    """Give the rows of each pair whose boxes ever overlap, and when [s] they first do, in order of time."""
    found: dict[tuple[int, int], float] = {}
    half = 0.5 * np.hypot(tracks.length, tracks.width)
    for k, t in enumerate(tracks.t.tolist()):
        rows = np.flatnonzero(tracks.valid[:, k])
        if len(rows) < 2:
            continue
        tree = cKDTree(np.column_stack([tracks.x[rows, k], tracks.y[rows, k]]))
        pairs = rows[tree.query_pairs(2.0 * float(half[rows].max()), output_type="ndarray")]
        if len(pairs):
            one, two = (_boxes(tracks, pairs[:, side], k) for side in (0, 1))
            for n, m in pairs[boxes_overlap(one, two)].tolist():
                found.setdefault((n, m), t)
    return [(n, m, t) for (n, m), t in found.items()]


def _boxes(tracks: Tracks, rows: NDArray[np.intp], k: int) -> Boxes:
    """The boxes of rows at sample k."""
    return Boxes(
        tracks.x[rows, k], tracks.y[rows, k], tracks.heading[rows, k], tracks.length[rows], tracks.width[rows]
    )
