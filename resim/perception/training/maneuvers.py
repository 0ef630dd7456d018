"""Errors of single maneuvers, where they are sure to differ from those of all."""

from __future__ import annotations

import numpy as np

from resim.core.geometry import Bools
from resim.perception.model import Error, ErrorModels, Maneuver, Objects, TrainedParameter
from resim.perception.training.clusters import certain
from resim.perception.training.errors import (
    MEASURED,
    FittedQuantity,
    ObjectErrors,
    deserves_own_fit,
    error_of,
    refit,
    sizes_of,
)
from resim.perception.training.estimates import error_estimates
from resim.perception.training.residuals import OwnErrorSamples
from resim.perception.training.samples import TrainingSamples
from resim.scenario.maneuvers import MANEUVERS

SAMPLES, TRACKS = 300, 8
"""Fewest matched samples, and fewest tracks that they are of, from which a maneuver has errors of its own."""
SURE = 3.3
"""Standard errors, of many drives, by which they differ from those of all."""


def fit_maneuvers(
    samples: TrainingSamples, objects: ObjectErrors, errors: ErrorModels
) -> tuple[dict[Maneuver, Objects], dict[str, TrainedParameter], dict[str, list[OwnErrorSamples]]]:
    """Give the maneuvers that differ, and by quantity the samples that they are fitted to. Latencies and averaging
    times are those of all: they are the sensors' own."""
    does = samples.maneuvers(objects.latency.speed)
    found: dict[Maneuver, Objects] = {}
    estimates: dict[str, TrainedParameter] = {}
    parts: dict[str, list[OwnErrorSamples]] = {}
    for index, name in enumerate(MANEUVERS):
        own: dict[str, Error] = {}
        for quantity in MEASURED:
            pooled = objects.fitted[quantity]
            mask = pooled.known & (does == index)
            if mask.sum() < SAMPLES or mask.any(axis=1).sum() < TRACKS or mask.sum() == pooled.known.sum():
                continue
            if not deserves_own_fit(samples, objects, quantity, mask):
                continue
            fitted = refit(samples, objects, quantity, mask)
            drives = len(np.unique(samples.drive[mask.any(axis=1)]))
            if _differs(pooled, fitted, mask, objects, certain(SURE, drives)):
                own[quantity] = error_of(fitted)
                parts.setdefault(quantity, []).append(OwnErrorSamples(mask, fitted))
                prefix = f"maneuvers.{name}.errors.{quantity}"
                estimates |= error_estimates(prefix, fitted, samples.drive)
        if own:
            found[name] = Objects(  # type: ignore[index]
                latency=objects.latency, averaging=objects.averaging, errors=errors.model_copy(update=own)
            )
    return found, estimates, parts


def _differs(
    pooled: FittedQuantity, own: FittedQuantity, mask: Bools, objects: ObjectErrors, sure: float
) -> bool:
    """Whether bias, or a spread, where this maneuver is, differs from that of all by `sure` standard errors."""
    middle = np.concatenate([[1.0], objects.features[mask].mean(axis=0)])
    off = float((own.aligned.biases[0] - pooled.aligned.biases[pooled.component]) @ middle)
    if abs(off) > sure * own.aligned.se_mean[0]:
        return True
    if (own.spreads is None) or (pooled.spreads is None):
        return (own.spreads is None) != (pooled.spreads is None)
    sizes = sizes_of(objects.features)
    total = []
    for spreads in (own.spreads, pooled.spreads):
        drift, noise = spreads.levels(sizes)
        total.append(np.log(np.mean((drift**2 + noise**2)[mask])) / 2.0)
    name = "drift" if own.spreads.drift is not None else "noise"
    return bool(abs(total[0] - total[1]) > sure * own.spreads.se[name])
