"""Strong braking and strong acceleration (rows of Kaefer's catalogs; he says no numbers)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from resim.mining.features import ALONG_PRECISION, Features
from resim.mining.maneuver import FAMILIES, LabelFamily, LabelledManeuver
from resim.mining.runs import bounds, stretches
from resim.mining.settings import MiningSettings
from resim.mining.smoothing import averaged, slope

BRAKING, ACCELERATION = "strong_braking", "strong_acceleration"
PRECISION = 0.04
"""m/s: standard deviation to which speeds are averaged (our choice: misses and false labels are as many)."""


def find(
    features: Features, settings: MiningSettings, found: Sequence[LabelledManeuver]
) -> Iterator[LabelledManeuver]:
    """Find who brakes or accelerates strongly: whose speed changes by more than a limit within so many seconds.

    It lasts from the first sample to the last one of these seconds at which the acceleration is beyond the limit.
    """
    # compiled: numba is imported where it is used only
    from resim.mining import kernel

    rules, samples = settings.acceleration, features.samples
    wanted, first = samples.kinds(frozenset(settings.kinds)), bounds(samples.piece_of)
    v = averaged(samples.t, samples.v, samples.piece_of, PRECISION)
    a = features.a
    if samples.tracks.a is not None:  # recorded ones may be cut off
        a = slope(samples.t, samples.v, samples.piece_of, ALONG_PRECISION)
    for label, sign, limit in ((BRAKING, -1.0, -rules.braking), (ACCELERATION, 1.0, rules.acceleration)):
        within = kernel.within_rises(samples.t, sign * v, first, limit * rules.within, rules.within)
        for begin, until in zip(*stretches(within & wanted, samples.piece_of), strict=True):
            beyond = begin + np.flatnonzero(sign * a[begin : until + 1] > limit)
            start, end = (int(beyond[0]), int(beyond[-1])) if len(beyond) else (int(begin), int(until))
            peak = start + int(np.nanargmax(sign * a[start : end + 1]))
            figures = {
                "a_mps2": float(a[peak]), "v_start_mps": float(samples.v[start]),
                "v_end_mps": float(samples.v[end]), "duration_s": float(samples.t[end] - samples.t[start]),
            }  # fmt: skip
            yield LabelledManeuver(label, int(samples.owner[start]), start, end, peak, figures=figures)


FAMILIES.add(
    LabelFamily(
        "acceleration", (ACCELERATION, BRAKING), find, "acceleration beyond what comfort systems may do",
        "Kaefer 2022, Appendix 1; thresholds: ISO 15622:2018 and our choice",
    )
)  # fmt: skip
