"""Speeding and standing (Kaefer 2022, 4.5.6.5 and 4.5.6.6).

Readings taken: strictly above the limit, noise of the speed apart; without a limit nothing is judged. Standing is a
speed of 0 there, which measured speeds never have: here up to a threshold, either way, noise apart as well.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from resim.mining.features import Features
from resim.mining.maneuver import FAMILIES, LabelFamily, LabelledManeuver
from resim.mining.runs import joined, stretches
from resim.mining.settings import MiningSettings
from resim.mining.smoothing import below

SPEEDING, STANDING = "speeding", "standing"
ROUNDED = 1e-6
"""m/s by which who keeps to the limit may be above it: files have as many digits."""
FINE_STANDING, BEYOND_STANDING = 0.03, 0.5
"""m/s: deviation to which speeds are averaged that are held against that of standing, and by how many such they are
below it (our choice): who stops for a moment has no surer sample, and hardly anybody drives just above it."""


def find_speeding(
    features: Features, settings: MiningSettings, found: Sequence[LabelledManeuver]
) -> Iterator[LabelledManeuver]:
    """Find who is faster than the limit."""
    rules, samples = settings.speeding, features.samples
    limit = features.limit
    if rules.limit is not None:
        limit = np.where(np.isnan(limit), rules.limit, limit)
    over = samples.v - limit
    known = np.nan_to_num(limit, nan=np.inf)  # where there is no limit nobody is above it
    holds = below(samples.t, -samples.v, samples.piece_of, -(known + rules.tolerance + ROUNDED))
    first, last = stretches(holds & samples.kinds(frozenset(settings.kinds)), samples.piece_of)
    for start, end in joined(first, last, samples.t, samples.piece_of, rules.join, 0.0):
        worst = start + int(np.nanargmax(over[start : end + 1]))
        figures = {
            "v_mps": float(samples.v[worst]), "limit_mps": float(limit[worst]), "over_mps": float(over[worst]),
            "duration_s": float(samples.t[end] - samples.t[start]),
        }  # fmt: skip
        yield LabelledManeuver(SPEEDING, int(samples.owner[start]), start, end, worst, figures=figures)


def find_standing(
    features: Features, settings: MiningSettings, found: Sequence[LabelledManeuver]
) -> Iterator[LabelledManeuver]:
    """Find who stands."""
    rules, samples = settings.standing, features.samples
    highest = np.nextafter(rules.speed, np.inf)  # up to it
    slow = [
        below(samples.t, way * samples.v, samples.piece_of, highest, FINE_STANDING, BEYOND_STANDING)
        for way in (1.0, -1.0)
    ]
    holds = slow[0] & slow[1] & samples.kinds(frozenset(settings.kinds))
    first, last = stretches(holds, samples.piece_of)
    for start, end in joined(first, last, samples.t, samples.piece_of, rules.join, rules.shortest):
        figures = {"duration_s": float(samples.t[end] - samples.t[start])}
        yield LabelledManeuver(STANDING, int(samples.owner[start]), start, end, start, figures=figures)


FAMILIES.add(
    LabelFamily(
        SPEEDING, (SPEEDING,), find_speeding, "faster than the limit of the lane", "Kaefer 2022, 4.5.6.5"
    )
)
FAMILIES.add(
    LabelFamily(STANDING, (STANDING,), find_standing, "a speed of 0, but for noise", "Kaefer 2022, 4.5.6.6")
)
