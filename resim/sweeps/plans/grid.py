"""All combinations of the parameters' levels."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from resim.core.geometry import Floats
from resim.sweeps.plans.parameter import SweepParameter
from resim.sweeps.plans.registry import PLANS, SweepPlan


def _design(parameters: Sequence[SweepParameter], points: int, seed: int) -> Floats:
    mesh = np.meshgrid(*(p.levels() for p in parameters), indexing="ij")
    return np.stack([m.ravel() for m in mesh], axis=1)


def _count(parameters: Sequence[SweepParameter], points: int) -> int:
    return math.prod(p.level_count for p in parameters)


PLANS.add(
    SweepPlan(
        name="grid", words="all combinations of the values", layout="grid", design=_design, count=_count
    )
)
