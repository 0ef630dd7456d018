"""Driving against the lane's direction: Kaefer's ghost driver (catalog, violating traffic laws).

Readings taken: in a junction nobody drives against a lane, and where lanes cross one another there is a junction,
whatever the map calls it: who turns left there goes askew over lanes of other roads.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from resim.core.geometry import Bools
from resim.mining.features import Features, lane_headings
from resim.mining.maneuver import FAMILIES, LabelFamily, LabelledManeuver
from resim.mining.runs import stretches
from resim.mining.settings import MiningSettings

WRONG = "wrong_way"
ASKEW = np.sin(np.pi / 6.0)
"""Sine of the angle from which on two lanes over one another cross (our choice)."""


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
        if lasts * (1.0 - float(np.mean(_crossed(features, start, end)))) < rules.shortest:
            continue
        figures = {"v_mps": float(np.mean(samples.v[start : end + 1])), "duration_s": lasts}
        yield LabelledManeuver(WRONG, int(samples.owner[start]), start, end, start, figures=figures)


def _overtakes(features: Features, start: int, end: int) -> bool:
    """Whether it comes over the border from its own side and goes back there."""
    after = end + 1
    if after >= len(features.passed) or features.samples.piece_of[after] != features.samples.piece_of[end]:
        return False
    return bool(features.passed[start] != 0 and features.passed[after] != 0 and features.with_lane[after])


def _crossed(features: Features, start: int, end: int) -> Bools:
    """Say at which of the samples from start to end a lane crosses the one that it is on."""
    samples, network = features.samples, features.lanes.network
    of = slice(start, end + 1)
    places = network.lanes_at(samples.x[of], samples.y[of])
    heading = lane_headings(features.lanes, places)
    across = np.abs(np.sin(heading - features.lane_heading[of][places.point])) > ASKEW
    across &= network.lane_table.drivable[places.row]
    return np.isin(np.arange(end + 1 - start), places.point[across])


FAMILIES.add(
    LabelFamily(
        WRONG, (WRONG,), find, "against the direction of the lane", "Kaefer 2022, Appendix 1 (ghost driver)"
    )
)
