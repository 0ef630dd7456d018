"""Boxes that overlap: Kaefer's accidents (catalogs), as far as object lists show them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from resim.mining.features import Features
from resim.mining.maneuver import FAMILIES, LabelFamily, LabelledManeuver
from resim.mining.settings import MiningSettings

COLLISION = "collision"
MOST = 1_000_000
"""Pairs of samples that are looked at."""


def find(
    features: Features, settings: MiningSettings, found: Sequence[LabelledManeuver]
) -> Iterator[LabelledManeuver]:
    """Find whose boxes overlap or touch; a label of each of the two."""
    # compiled: numba is imported where it is used only
    from resim.mining import kernel

    samples = features.samples
    order = np.lexsort((samples.x, samples.step))
    first = np.searchsorted(samples.step[order], np.arange(len(samples.tracks.t) + 1))
    size = 0.5 * np.stack([samples.tracks.length, samples.tracks.width])[:, samples.owner]
    one, two = (np.empty(min(MOST, 20 * len(samples) + 1), np.intp) for _ in range(2))
    boxes = samples.x, samples.y, samples.heading, size[0], size[1]
    count = kernel.overlaps(first, order, boxes, one, two)
    if count == 0:
        return
    a, b = np.r_[one[:count], two[:count]], np.r_[two[:count], one[:count]]
    pair = samples.owner[a] * len(samples.tracks) + samples.owner[b]
    by = np.lexsort((a, pair))
    a, b, pair = a[by], b[by], pair[by]
    new = np.ones(len(a), dtype=bool)
    new[1:] = (np.diff(pair) != 0) | (np.diff(a) != 1)
    start = np.flatnonzero(new)
    end = np.append(start[1:], len(a)) - 1
    for k, last in zip(start.tolist(), end.tolist(), strict=True):
        figures = {"relative_speed_mps": _relative_speed(features, int(a[k]), int(b[k]))}
        partner = int(samples.owner[b[k]])
        yield LabelledManeuver(
            COLLISION, int(samples.owner[a[k]]), int(a[k]), int(a[last]), int(a[k]), partner, figures
        )


def _relative_speed(features: Features, k: int, j: int) -> float:
    s = features.samples
    vx = s.v[k] * np.cos(s.heading[k]) - s.v[j] * np.cos(s.heading[j])
    vy = s.v[k] * np.sin(s.heading[k]) - s.v[j] * np.sin(s.heading[j])
    return float(np.hypot(vx, vy))


FAMILIES.add(
    LabelFamily(COLLISION, (COLLISION,), find, "boxes that overlap", "Kaefer 2022, Appendix 1 (accident)")
)
