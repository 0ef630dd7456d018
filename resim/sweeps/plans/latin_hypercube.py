"""A Latin hypercube: each parameter's points are spread evenly over its distribution."""

from __future__ import annotations

from resim.sweeps.plans.drawn import drawn_by
from resim.sweeps.plans.registry import PLANS, SweepPlan, as_many_as_asked

PLANS.add(
    SweepPlan(
        name="latin_hypercube", words="Latin hypercube", layout="drawn", design=drawn_by("LatinHypercube"),
        count=as_many_as_asked,
    )
)  # fmt: skip
