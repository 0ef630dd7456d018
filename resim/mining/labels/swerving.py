"""Swerving: going from side to side (Kaefer's catalog: irrational driving; he says no numbers)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from resim.mining.features import Features
from resim.mining.maneuver import FAMILIES, LabelFamily, LabelledManeuver
from resim.mining.runs import bounds
from resim.mining.settings import MiningSettings

SWERVING = "swerving"


def find(
    features: Features, settings: MiningSettings, found: Sequence[LabelledManeuver]
) -> Iterator[LabelledManeuver]:
    """Find who swings several times from side to side within some seconds.

    They count from where the first one has done 0.3 of its way to where the last one has done 0.7.
    """
    # compiled: numba is imported where it is used only
    from resim.mining import kernel

    samples, rules = features.samples, settings.swerving
    on = np.flatnonzero((features.row >= 0) & samples.kinds(frozenset(settings.kinds)))
    if not len(on):
        return
    group = samples.piece_of[on] * (len(samples) + 1) + features.stretch[on]
    first = bounds(group)
    swings, many = kernel.swings(features.aside[on], first, rules.swing), rules.swings - 1
    if len(swings) <= many:
        return
    begin, end = on[swings].T
    quick = group[swings[many:, 0]] == group[swings[:-many, 0]]
    quick &= samples.t[end[many:]] - samples.t[begin[:-many]] <= rules.within + 1e-9
    told: list[tuple[int, int]] = []  # the first and the last swing of each
    for k in np.flatnonzero(quick).tolist():
        if told and k <= told[-1][1]:
            told[-1] = told[-1][0], k + many
        else:
            told.append((k, k + many))
    for k, last in told:
        start, stop = int(begin[k]), int(end[last])
        swing = float(np.ptp(features.aside[on[swings[k, 0] : swings[last, 1] + 1]]))
        figures = {"swing_m": swing, "swings": float(last + 1 - k)}
        yield LabelledManeuver(SWERVING, int(samples.owner[start]), start, stop, start, figures=figures)


FAMILIES.add(
    LabelFamily(
        SWERVING, (SWERVING,), find, "from side to side, several times within seconds",
        "Kaefer 2022, Appendix 1 (irrational driving); our numbers",
    )
)  # fmt: skip
