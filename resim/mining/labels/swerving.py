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
    """Find who swings several times from side to side within some seconds, from middle to middle of the swings."""
    # compiled: numba is imported where it is used only
    from resim.mining import kernel

    samples, rules = features.samples, settings.swerving
    on = np.flatnonzero((features.row >= 0) & samples.kinds(frozenset(settings.kinds)))
    if not len(on):
        return
    group = samples.piece_of[on] * (len(samples) + 1) + features.stretch[on]
    first = bounds(group)
    at = np.flatnonzero(kernel.swings(features.aside[on], first, rules.swing))
    many = rules.swings - 1
    if len(at) <= many:
        return
    quick = group[at[many:]] == group[at[:-many]]
    quick &= samples.t[on[at[many:]]] - samples.t[on[at[:-many]]] <= rules.within + 1e-9
    last = -1
    for k in np.flatnonzero(quick).tolist():
        if k <= last:
            continue
        end = k
        while end + 1 < len(quick) and quick[end + 1]:
            end += 1
        last = end
        middles = at[k : end + many + 1]
        start, stop = int(on[middles[0]]), int(on[middles[-1]])
        swing = float(np.ptp(features.aside[on[middles[0] : middles[-1] + 1]]))
        figures = {"swing_m": swing, "swings": float(len(middles))}
        yield LabelledManeuver(SWERVING, int(samples.owner[start]), start, stop, start, figures=figures)


FAMILIES.add(
    LabelFamily(
        SWERVING, (SWERVING,), find, "from side to side, several times within seconds",
        "Kaefer 2022, Appendix 1 (irrational driving); our numbers",
    )
)  # fmt: skip
