"""Moments in which a measure of criticality to the leader is beyond a limit, for use as triggers.

TTC and THW by distances from bumper to bumper along the lane (Wagner 2021, Eq. 3.2 and 3.5).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from resim.mining.features import Features
from resim.mining.labels.cut import ttc
from resim.mining.maneuver import FAMILIES, LabelFamily, LabelledManeuver
from resim.mining.runs import joined, stretches
from resim.mining.settings import MiningSettings

TTC, THW = "critical_ttc", "critical_thw"


def find(
    features: Features, settings: MiningSettings, found: Sequence[LabelledManeuver]
) -> Iterator[LabelledManeuver]:
    """Find who comes too near to the leader, in time."""
    rules, samples, flow = settings.critical, features.samples, features.flow
    led, v = flow.leader >= 0, samples.v
    gap = np.where(led, np.maximum(flow.gap, 0.0), np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        headway = np.where(led & (v > 0.0), gap / v, np.inf)
    times = np.where(led, ttc(gap, v, v[flow.leader]), np.inf)
    wanted = samples.kinds(frozenset(settings.kinds))
    for label, values, limit in ((TTC, times, rules.ttc), (THW, headway, rules.thw)):
        who = np.where(led, samples.owner[flow.leader], -1)
        group = samples.piece_of * (len(samples.tracks) + 1) + who
        first, last = stretches((values < limit) & wanted, group)
        for start, end in joined(first, last, samples.t, group, rules.join, rules.shortest):
            worst = start + int(np.argmin(values[start : end + 1]))
            figures = {f"{label[-3:]}_s": float(values[worst]), "v_mps": float(v[worst])}
            partner = int(samples.owner[flow.leader[worst]])
            yield LabelledManeuver(label, int(samples.owner[start]), start, end, worst, partner, figures)


FAMILIES.add(
    LabelFamily(
        "critical", (TTC, THW), find, "a time to collision or a headway below a limit",
        "Wagner 2021, 3.2.3; limits as scenarios/criteria/highway.toml",
    )
)  # fmt: skip
