"""Points of Halton's sequence, scrambled."""

from __future__ import annotations

from resim.sweeps.plans.drawn import drawn_by
from resim.sweeps.plans.registry import PLANS, SweepPlan, as_many_as_asked

PLANS.add(
    SweepPlan(
        name="halton", words="Halton points", layout="drawn", design=drawn_by("Halton"),
        count=as_many_as_asked,
    )
)  # fmt: skip
