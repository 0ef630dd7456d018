"""The levels of each parameter, the others at their base."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from resim.core.geometry import Floats
from resim.sweeps.plans.parameter import SweepParameter
from resim.sweeps.plans.registry import PLANS, SweepPlan


def _design(parameters: Sequence[SweepParameter], points: int, seed: int) -> Floats:
    base = np.array([p.middle() for p in parameters])
    rows = [np.tile(base, (len(p.levels()), 1)) for p in parameters]
    for k, p in enumerate(parameters):
        rows[k][:, k] = p.levels()
    return np.unique(np.concatenate([base[None], *rows]), axis=0)


def _count(parameters: Sequence[SweepParameter], points: int) -> int:
    return 1 + sum(p.level_count for p in parameters)


PLANS.add(
    SweepPlan(
        name="one_at_a_time", words="one parameter at a time", layout="axes", design=_design, count=_count
    )
)
