"""Does the model fit? Its assumptions, tested on what is left of the errors, and what a failure costs.

Every statistic is judged by how drives differ (`clusters`), and all of them share one risk: for a model that fits, the
probability that anything is told is ALPHA (Bonferroni over all tests). What is surely there but smaller than what
references can show (`NEGLIGIBLE`) is not told.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from resim.perception.model import ModelFit, Quantity
from resim.perception.training.clusters import FEWEST
from resim.perception.training.dependence import Dependence
from resim.perception.training.detected import DetectedShare, DetectedTogether
from resim.perception.training.errors import MEASURED, ObjectErrors
from resim.perception.training.false_places import FalsePlaces
from resim.perception.training.residuals import OwnErrorSamples, Residuals, of_mean, of_spread, residuals_of
from resim.perception.training.samples import TrainingSamples
from resim.perception.training.single import (
    SingleStatistic,
    common_offset,
    common_spread,
    latencies,
    tails,
    together,
    white,
)

ALPHA = 0.05
"""Probability that something is told of a model that fits."""
LAG = 0.5
"""Time [s] between errors that are to be independent, beside one list."""


def fit_of(
    samples: TrainingSamples,
    objects: ObjectErrors,
    own: Mapping[str, Sequence[OwnErrorSamples]],
    shares: Sequence[DetectedShare | DetectedTogether | FalsePlaces] = (),
) -> ModelFit:
    """Test the model; own: samples with errors of their own, by quantity. Too few drives test nothing."""
    drives = len(np.unique(samples.drive))
    every = {
        q: residuals_of(samples, objects, q, own.get(q, ()))
        for q in MEASURED
        if objects.fitted[q].spreads is not None
    }
    if drives < FEWEST:
        return ModelFit(drives=drives)
    tests: list[SingleStatistic | Dependence | DetectedShare | DetectedTogether | FalsePlaces] = [
        test for q, r in every.items() for test in _tests(q, r, objects)
    ]
    tests += shares
    misfits = [m for test in tests for m in test.failures(ALPHA / max(sum(t.count for t in tests), 1))]
    return ModelFit(
        drives=drives, tests=sum(t.count for t in tests), misfits=tuple(sorted(misfits, key=lambda m: m.p))
    )


def _tests(quantity: Quantity, r: Residuals, objects: ObjectErrors) -> Iterator[SingleStatistic | Dependence]:
    yield tails(quantity, r)
    lags = {1, max(round(LAG / r.step), 1)}
    yield from (white(quantity, r, lag) for lag in sorted(lags))
    yield together(quantity, r)
    yield common_offset(quantity, r)
    yield common_spread(quantity, r)
    yield latencies(quantity, r)
    yield Dependence(quantity, r, *of_mean(r), spread=False)
    yield Dependence(quantity, r, *of_spread(r, objects), spread=True)
