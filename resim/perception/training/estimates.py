"""What stands behind the estimates: intervals and counts by the parameters' dotted names."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from resim.perception.model import FEATURES, TrainedParameter
from resim.perception.training.clusters import quantile
from resim.perception.training.errors import FittedQuantity, ObjectErrors
from resim.perception.training.lists import around
from resim.perception.training.localisation import spread_estimates

LAGS = {"position": "longitudinal", "speed": "speed", "heading": "heading"}
"""Which quantity tells each latency."""


def lag_estimates(objects: ObjectErrors, drive: NDArray[np.intp]) -> dict[str, TrainedParameter]:
    """Give the estimates of latencies and averaging times."""
    out = {}
    groups = len(np.unique(drive))
    for name, quantity in LAGS.items():
        fitted = objects.fitted[quantity]
        n, aligned = int(fitted.known.sum()), fitted.aligned
        out[f"latency.{name}"] = around(aligned.late, aligned.se_late, n, groups, least=0.0)
        if name != "position":
            low, high = aligned.over_limits
            out[f"averaging.{name}"] = TrainedParameter(value=aligned.over, low=low, high=high, samples=n)
    return out


def error_estimates(
    prefix: str, fitted: FittedQuantity, drive: NDArray[np.intp]
) -> dict[str, TrainedParameter]:
    """Give the estimates of one quantity's bias, drift and noise; parameters that are left out have none."""
    n, groups, out = int(fitted.known.sum()), len(np.unique(drive)), {}
    bias, se = fitted.aligned.biases[fitted.component], fitted.aligned.se[fitted.component]
    for k, name in enumerate(("constant", *FEATURES)):
        if k == 0 or bias[k] != 0.0:
            out[f"{prefix}.bias.{name}"] = around(float(bias[k]), float(se[k]), n, groups)
    spread = fitted.spreads
    if spread is None:
        return out
    for name, estimate in spread_estimates(spread, n, groups).items():
        out[f"{prefix}.{name}" + ("" if name == "correlation_time" else ".constant")] = estimate
    for part, by in (("drift", spread.drift_by), ("noise", spread.noise_by)):
        for f, slope in by.items():
            half = quantile(groups) * spread.se[f"{part}.{f}"]
            out[f"{prefix}.{part}.{FEATURES[f]}"] = TrainedParameter(
                value=slope, low=slope - half, high=slope + half, samples=n
            )
    return out
