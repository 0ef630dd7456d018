"""Starting from a standstill in a driven lane (a row of Kaefer's catalogs; he says no numbers)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from resim.mining.features import Features
from resim.mining.labels.speed import STANDING
from resim.mining.maneuver import FAMILIES, LabelFamily, LabelledManeuver
from resim.mining.settings import MiningSettings

STARTING = "starting"


def find(
    features: Features, settings: MiningSettings, found: Sequence[LabelledManeuver]
) -> Iterator[LabelledManeuver]:
    """Find who drives off forwards, from the last sample of standing until it is as fast as the rule asks for."""
    rules, samples = settings.starting, features.samples
    for stood in found:
        if stood.label != STANDING or features.row[stood.end] < 0:
            continue
        high = int(samples.piece[samples.piece_of[stood.end] + 1])
        own = slice(stood.end, high)
        fast = (samples.v[own] >= rules.speed) & (samples.t[own] <= samples.t[stood.end] + rules.within)
        if not fast.any():
            continue
        end = stood.end + int(np.argmax(fast))
        figures = {"duration_s": float(samples.t[end] - samples.t[stood.end]), "v_mps": float(samples.v[end])}
        yield LabelledManeuver(STARTING, stood.object, stood.end, end, stood.end, figures=figures)


FAMILIES.add(
    LabelFamily(
        STARTING, (STARTING,), find, "driving off from a standstill in a lane",
        "Kaefer 2022, Appendix 1; our numbers",
    )
)  # fmt: skip
