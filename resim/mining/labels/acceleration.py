"""Strong braking and strong acceleration (rows of Kaefer's catalogs; he says no numbers)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from resim.core.geometry import Floats
from resim.mining.features import ALONG_PRECISION, Features
from resim.mining.maneuver import FAMILIES, LabelFamily, LabelledManeuver
from resim.mining.runs import joined, stretches
from resim.mining.settings import MiningSettings
from resim.mining.smoothing import shortening

BRAKING, ACCELERATION = "strong_braking", "strong_acceleration"


def find(
    features: Features, settings: MiningSettings, found: Sequence[LabelledManeuver]
) -> Iterator[LabelledManeuver]:
    """Find who brakes or accelerates strongly."""
    rules, samples = settings.acceleration, features.samples
    wanted = samples.kinds(frozenset(settings.kinds))
    shortest: float | Floats = rules.shortest
    if samples.tracks.a is None:
        shortest = rules.shortest - shortening(samples.t, samples.v, samples.piece_of, ALONG_PRECISION)
    for label, excess in (
        (BRAKING, rules.braking - features.a),
        (ACCELERATION, features.a - rules.acceleration),
    ):
        first, last = stretches((excess > 0.0) & wanted, samples.piece_of)
        for start, end in joined(first, last, samples.t, samples.piece_of, rules.join, shortest):
            peak = start + int(np.nanargmax(excess[start : end + 1]))
            figures = {
                "a_mps2": float(features.a[peak]), "v_start_mps": float(samples.v[start]),
                "v_end_mps": float(samples.v[end]), "duration_s": float(samples.t[end] - samples.t[start]),
            }  # fmt: skip
            yield LabelledManeuver(label, int(samples.owner[start]), start, end, peak, figures=figures)


FAMILIES.add(
    LabelFamily(
        "acceleration", (ACCELERATION, BRAKING), find, "acceleration beyond what comfort systems may do",
        "Kaefer 2022, Appendix 1; thresholds: ISO 15622:2018 and our choice",
    )
)  # fmt: skip
