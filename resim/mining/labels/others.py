"""What Kaefer's catalogs have beyond his labels: on foot or by bicycle on the road, and backing up."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from resim.core.geometry import Bools, wrap_angle
from resim.mining.features import Features
from resim.mining.maneuver import FAMILIES, LabelFamily, LabelledManeuver
from resim.mining.runs import joined, stretches
from resim.mining.settings import MiningSettings

CROSSING, ALONG, REVERSING = "crossing_road", "walking_on_road", "reversing"
STILL = 0.2
"""m/s up to which nobody crosses or walks (our choice)."""
SLANTED = 0.25 * np.pi
"""rad off the lane's direction, from which on one crosses it."""
JOIN, SHORTEST = 1.0, 0.5
"""s: what is less apart is one, what lasts less is none (our choice)."""


def find(
    features: Features, settings: MiningSettings, found: Sequence[LabelledManeuver]
) -> Iterator[LabelledManeuver]:
    """Find pedestrians and cyclists that cross driven lanes, pedestrians along them, and vehicles that back up."""
    samples = features.samples
    across = slanted(features)
    moves = (features.row >= 0) & (np.abs(samples.v) > STILL)
    weak = samples.kinds(frozenset({"pedestrian", "bicycle"}))
    on_foot = samples.kinds(frozenset({"pedestrian"}))
    backs = (samples.v < -STILL) & samples.kinds(frozenset(settings.kinds))
    for label, holds in (
        (CROSSING, moves & across & weak), (ALONG, moves & ~across & on_foot), (REVERSING, backs),
    ):  # fmt: skip
        yield from lasting(features, label, holds, SHORTEST)


def lasting(features: Features, label: str, holds: Bools, shortest: float) -> Iterator[LabelledManeuver]:
    """Give the maneuvers of stretches that hold (K,), of `shortest` [s] or longer, with their mean speed."""
    samples = features.samples
    first, last = stretches(holds, samples.piece_of)
    for start, end in joined(first, last, samples.t, samples.piece_of, JOIN, shortest):
        figures = {
            "v_mps": float(np.mean(samples.v[start : end + 1])),
            "duration_s": float(samples.t[end] - samples.t[start]),
        }
        yield LabelledManeuver(label, int(samples.owner[start]), start, end, start, figures=figures)


def slanted(features: Features) -> Bools:
    """Say who is headed across its lane (K,)."""
    off = np.abs(wrap_angle(features.lane_heading - features.samples.heading))
    return (off > SLANTED) & (off < np.pi - SLANTED)


FAMILIES.add(
    LabelFamily(
        "others", (CROSSING, ALONG, REVERSING), find, "across driven lanes, along them on foot, and backing up",
        "Kaefer 2022, Appendix 1; our numbers",
    )
)  # fmt: skip
