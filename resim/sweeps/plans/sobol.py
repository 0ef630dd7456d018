"""Points of Sobol's sequence, scrambled."""

from __future__ import annotations

from resim.sweeps.plans.drawn import drawn_by
from resim.sweeps.plans.registry import PLANS, SweepPlan, as_many_as_asked

PLANS.add(
    SweepPlan(
        name="sobol", words="Sobol points", layout="drawn", design=drawn_by("Sobol"),
        count=as_many_as_asked,
    )
)  # fmt: skip
