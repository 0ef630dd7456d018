"""Keeping to a lane, as it goes on over sections, junctions and merges, between lane changes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from resim.mining.features import Features
from resim.mining.labels.lane_change import LaneChangeLabel
from resim.mining.maneuver import FAMILIES, LabelFamily, LabelledManeuver
from resim.mining.runs import joined, stretches
from resim.mining.settings import MiningSettings

FOLLOW = "follow_lane"


def find(
    features: Features, settings: MiningSettings, found: Sequence[LabelledManeuver]
) -> Iterator[LabelledManeuver]:
    """Find who keeps to a lane."""
    samples, rules = features.samples, settings.follow_lane
    holds = (features.row >= 0) & (samples.v > rules.speed) & samples.kinds(frozenset(settings.kinds))
    for change in found:
        if isinstance(change, LaneChangeLabel):
            holds[change.start : change.end + 1] = False
    new = np.zeros(len(samples), dtype=bool)
    new[1:] = (
        (np.diff(samples.piece_of) != 0) | (np.diff(features.stretch) != 0) | (np.diff(features.strand) != 0)
    )
    group = np.cumsum(new)
    first, last = stretches(holds, group)
    for start, end in joined(first, last, samples.t, group, 0.0, rules.shortest):
        leader = int(features.flow.leader[start])
        partner = int(samples.owner[leader]) if leader >= 0 else -1
        figures = {
            "duration_s": float(samples.t[end] - samples.t[start]),
            "v_mps": float(np.mean(samples.v[start : end + 1])),
        }
        yield LabelledManeuver(FOLLOW, int(samples.owner[start]), start, end, start, partner, figures)


FAMILIES.add(
    LabelFamily(
        FOLLOW, (FOLLOW,), find, "the same lane, between lane changes; partner: the leader at its beginning",
        "as `resim.scenario.maneuvers`",
    )
)  # fmt: skip
