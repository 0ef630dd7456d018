"""Skidding: moving across one's own heading, as who lost control does (Kaefer's catalogs; he says no numbers)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from resim.core.geometry import wrap_angle
from resim.mining.features import Features
from resim.mining.maneuver import FAMILIES, LabelFamily, LabelledManeuver
from resim.mining.runs import joined, stretches
from resim.mining.settings import MiningSettings
from resim.mining.smoothing import slope

SKIDDING = "skidding"
PRECISION = 0.2
"""m/s: standard deviation to which speeds east and north are smoothed; a tenth of what the angle asks for at speed."""
JOIN = 0.5
"""s: what is less apart is one (our choice)."""


def find(
    features: Features, settings: MiningSettings, found: Sequence[LabelledManeuver]
) -> Iterator[LabelledManeuver]:
    """Find who moves across its heading."""
    rules, samples = settings.skidding, features.samples
    vx, vy = (slope(samples.t, values, samples.piece_of, PRECISION) for values in (samples.x, samples.y))
    slip = wrap_angle(np.arctan2(vy, vx) - samples.heading)
    slip = np.minimum(np.abs(slip), np.pi - np.abs(slip))  # backwards is along it, too
    with np.errstate(invalid="ignore"):
        holds = (np.hypot(vx, vy) > rules.speed) & (slip >= rules.angle)
    first, last = stretches(holds & samples.kinds(frozenset(settings.kinds)), samples.piece_of)
    for start, end in joined(first, last, samples.t, samples.piece_of, JOIN, rules.shortest):
        worst = start + int(np.argmax(slip[start : end + 1]))
        figures = {"slip_rad": float(slip[worst]), "v_mps": float(samples.v[worst])}
        yield LabelledManeuver(SKIDDING, int(samples.owner[start]), start, end, worst, figures=figures)


FAMILIES.add(
    LabelFamily(
        SKIDDING, (SKIDDING,), find, "motion across the own heading",
        "Kaefer 2022, Appendix 1 (control loss); our numbers",
    )
)  # fmt: skip
