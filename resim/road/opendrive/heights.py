"""How high lanes lie above the road: kerbs and walkways."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from resim.core.geometry import Floats
from resim.road.opendrive.lanes import Lanes
from resim.road.opendrive.model import Road
from resim.road.opendrive.reference import Ints


def raised(roads: Sequence[Road], lanes: Lanes, row: Ints, s: Floats, t: Floats) -> Floats:
    """Give the height (N,) [m] over the road at t (N,) [m] from the centres of lanes (rows (N,)) at s (N,).

    A <height> record holds from its s on; between the borders the height goes linearly.
    """
    out = np.zeros(len(s))
    width = lanes.centre_and_width(row, s)[1]
    for own in np.unique(row):
        section, number = roads[lanes.road[own]].sections[lanes.section[own]], int(lanes.lane[own])
        lane = section.lanes.get(number)
        if lane is None or not lane.heights:
            continue
        here = np.flatnonzero(row == own)
        table = np.array([(-np.inf, 0.0, 0.0), *lane.heights])
        held = table[np.searchsorted(section.start + table[:, 0], s[here], side="right") - 1]
        across = t[here] / np.maximum(width[here], 1e-9) * (1.0 if number > 0 else -1.0)
        out[here] = held[:, 1] + np.clip(0.5 + across, 0.0, 1.0) * (held[:, 2] - held[:, 1])
    return out
