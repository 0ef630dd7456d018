"""What plans share that draw their points evenly from the parameters' distributions."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Literal

import numpy as np

from resim.core.geometry import Floats
from resim.sweeps.plans.parameter import SweepParameter
from resim.sweeps.plans.registry import Design


def values_at(parameters: Sequence[SweepParameter], share: Floats) -> Floats:
    """Give the values (R, P) below which these shares (R, P) in [0, 1] of the parameters' distributions lie."""
    return np.stack([p.at(share[:, k]) for k, p in enumerate(parameters)], axis=1)


def drawn_by(engine: Literal["Halton", "LatinHypercube", "Sobol"]) -> Design:
    """Give the design of as many points of an engine of `scipy.stats.qmc` as asked for, balanced or not."""

    def design(parameters: Sequence[SweepParameter], points: int, seed: int) -> Floats:
        from scipy.stats import qmc  # it takes a second to load: when points are drawn

        rng = np.random.default_rng(seed)
        with warnings.catch_warnings(action="ignore", category=UserWarning):
            return values_at(parameters, getattr(qmc, engine)(d=len(parameters), rng=rng).random(points))

    return design
