"""Driving against the lane's direction: Kaefer's ghost driver (catalog, violating traffic laws)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from resim.mining.features import Features
from resim.mining.maneuver import FAMILIES, LabelFamily, LabelledManeuver
from resim.mining.runs import stretches
from resim.mining.settings import MiningSettings

WRONG = "wrong_way"


def find(
    features: Features, settings: MiningSettings, found: Sequence[LabelledManeuver]
) -> Iterator[LabelledManeuver]:
    """Find who drives against the direction of a lane outside of junctions, and does not just overtake there."""
    samples, rules = features.samples, settings.wrong_way
    holds = (features.row >= 0) & ~features.with_lane & (samples.v > rules.speed) & (features.junction < 0)
    holds &= samples.kinds(frozenset(settings.kinds))
    first, last = stretches(holds, samples.piece_of)
    for start, end in zip(first.tolist(), last.tolist(), strict=True):
        lasts = float(samples.t[end] - samples.t[start])
        if lasts < rules.shortest or (lasts <= rules.overtaking and _overtakes(features, start, end)):
            continue
        figures = {"v_mps": float(np.mean(samples.v[start : end + 1])), "duration_s": lasts}
        yield LabelledManeuver(WRONG, int(samples.owner[start]), start, end, start, figures=figures)


def _overtakes(features: Features, start: int, end: int) -> bool:
    """Whether it comes over the border from its own side and goes back there."""
    after = end + 1
    if after >= len(features.passed) or features.samples.piece_of[after] != features.samples.piece_of[end]:
        return False
    return bool(features.passed[start] != 0 and features.passed[after] != 0 and features.with_lane[after])


FAMILIES.add(
    LabelFamily(
        WRONG, (WRONG,), find, "against the direction of the lane", "Kaefer 2022, Appendix 1 (ghost driver)"
    )
)
