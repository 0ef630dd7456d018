"""What is left of the errors once the model is taken off: standardised, beside what they may still depend on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Bools, Floats
from resim.perception.model import FEATURES
from resim.perception.training.alignment import Component
from resim.perception.training.clusters import between_drives, by_drive, larger
from resim.perception.training.errors import FittedQuantity, ObjectErrors, sizes_of, with_spread
from resim.perception.training.samples import TrainingSamples
from resim.perception.training.whiten import whiten
from resim.scenario.maneuvers import SEEN_BRAKING

_D_LATE = 0.01  # s, step of a derivative
EARLIER = (-0.3, -0.2, -0.1, 0.1, 0.2, 0.3)
"""Times [s] by which the latency of speed may be off where braking was taken for one."""
BEYOND = {"range_bend": "range", "bearing_side": "bearing"}
"""What is looked for beyond a straight line, by the feature of the line."""
LEAST_OWN = 0.02
"""Share of a variable that others must not explain for its effect to be told from theirs."""


class OwnErrorSamples(NamedTuple):
    """Samples (R, T) that have errors of their own in the model, and their fit."""

    mask: Bools
    fitted: FittedQuantity


@dataclass(frozen=True, eq=False)
class Residuals:
    """One quantity. z: innovations over their standard deviation (R, T), under the model independent, normal, of mean 0
    and variance 1; known: where; outlier: samples beyond what training took for the sensor's. spread: standard
    deviation of the error (R, T) in its unit. columns: what z may depend on, whitened like z; raw: as they are."""

    z: Floats
    known: Bools
    outlier: Bools
    spread: Floats
    raw: Mapping[str, Floats]
    columns: Mapping[str, Floats]
    fitted: FittedQuantity
    drive: NDArray[np.intp]
    t: Floats
    step: float


def residuals_of(
    samples: TrainingSamples, objects: ObjectErrors, quantity: str, own: Sequence[OwnErrorSamples]
) -> Residuals:
    """Lay out what is left of one quantity's errors, each sample judged by the parameters that the model has for it."""
    pooled = objects.fitted[quantity]
    raw = {
        "constant": np.ones(samples.t.shape),
        **_lags(samples, pooled, quantity),
        **variables(samples, objects),
        **(_braking(samples, objects.latency.speed) if quantity == "speed" else {}),
    }
    rest = pooled.known & ~np.any([part.mask for part in own], axis=0) if own else pooled.known
    inside = np.all([np.isfinite(v) for v in raw.values()], axis=0)
    z, total = np.zeros(samples.t.shape), np.zeros(samples.t.shape)
    columns = {name: np.zeros(samples.t.shape) for name in raw}
    known = np.zeros(samples.t.shape, dtype=bool)
    for part in (OwnErrorSamples(rest, pooled), *own):
        here = part.mask & inside & np.isfinite(part.fitted.residual)
        component = with_spread(
            Component(samples.x, samples.x, samples.x, 1.0), part.fitted.spreads, objects.features, quantity
        )
        table = np.stack([part.fitted.residual, *raw.values()], axis=-1)
        white = whiten(
            np.where(here[..., None], table, 0.0),
            here,
            objects.steps,
            component.drift,
            component.noise,
            component.tau,
        )
        z[here], total[here] = white[here, 0], np.hypot(component.drift, component.noise)[here]
        for k, name in enumerate(raw, start=1):
            columns[name][here] = white[here, k]
        known |= here
    seen = np.isfinite(pooled.residual) & np.isfinite(objects.features).all(axis=-1)
    return Residuals(
        z, known, seen & ~pooled.known, total, raw, columns, pooled, samples.drive, samples.t, samples.step
    )


def variables(samples: TrainingSamples, objects: ObjectErrors) -> dict[str, Floats]:
    """Give what errors may depend on (R, T), by name."""
    late, features = objects.latency.speed, objects.features
    begin = np.array([np.nanmin(samples.t[samples.drive == d]) for d in samples.drive.tolist()])
    return {
        **{name: features[..., k] for k, name in enumerate(FEATURES)},
        **_beyond_lines(features),
        "speed": samples.speeds(late, objects.averaging.speed),
        "ego_speed": samples.ego[3],
        "braking": np.where(features[..., 3] < SEEN_BRAKING, 1.0, 0.0),
        "time": samples.t - begin[:, None],
    }


def _beyond_lines(features: Floats) -> dict[str, Floats]:
    """Give what a straight line by a feature leaves out (R, T): of range, how far its square is off the line that is
    nearest to it [m²]; of bearing, on which side it is, half in front of the other."""
    off = features[..., 0] - np.nanmean(features[..., 0])
    variance = np.nanmean(off**2)
    line = variance + np.nanmean(off**3) / max(variance, 1e-9) * off
    return {"range_bend": off**2 - line, "bearing_side": 0.5 * np.sign(features[..., 1])}


def _braking(samples: TrainingSamples, late: float) -> dict[str, Floats]:
    """Give who brakes (R, T) at other latencies: one that braking is taken for is wrong for braking itself."""
    times = {f"braking{by:+g}": late + by for by in EARLIER if late + by >= 0.0}
    return {
        name: np.where(np.isfinite(a), np.where(a < SEEN_BRAKING, 1.0, 0.0), np.nan)
        for name, a in ((name, samples.accelerations(time)) for name, time in times.items())
    }


def _lags(samples: TrainingSamples, fitted: FittedQuantity, quantity: str) -> dict[str, Floats]:
    """How what is expected changes with the latency, and with the square of the averaging time, where there is one."""

    def expected(late: float, over: float) -> Floats:
        if quantity == "speed":
            return samples.speeds(late, over)
        if quantity == "heading":
            return samples.headings(late, over)
        return samples.positions(late)[quantity == "lateral"]

    late, over = fitted.aligned.late, fitted.aligned.over
    now = expected(late, over)
    out = {"latency": (expected(late + _D_LATE, over) - now) / _D_LATE}
    if over > 0.0:
        shorter = max(over - 0.05, 0.0)
        out["averaging"] = (now - expected(late, shorter)) / (over**2 - shorter**2)
    return out


@dataclass(frozen=True, eq=False)
class Regression:
    """Least squares of y on columns, by drive: normal (D, C, C), right (D, C); variance of y by the model."""

    names: tuple[str, ...]
    normal: Floats
    right: Floats
    variance: float

    @classmethod
    def of(cls, y: Floats, columns: Mapping[str, Floats], of: Residuals, variance: float) -> Regression:
        """Set up from (R, T) arrays, where `of` is known."""
        rows = of.known.any(axis=1)
        x = np.where(of.known[..., None], np.stack(list(columns.values()), axis=-1), 0.0)[rows]
        y = np.where(of.known, y, 0.0)[rows]
        normal = by_drive(np.einsum("rti,rtj->rij", x, x), of.drive[rows])
        right = by_drive(np.einsum("rti,rt->ri", x, y), of.drive[rows])
        return cls(tuple(columns), normal, right, variance)

    def judged(self, base: Sequence[str], name: str) -> tuple[Floats, Floats] | None:
        """Give coefficients and standard errors of `base` and, last, `name`; None where base explains it."""
        at = [self.names.index(n) for n in (*base, name)]
        normal, right = self.normal[:, at][:, :, at], self.right[:, at]
        total = normal.sum(axis=0)
        scale = np.sqrt(np.diag(total))
        if scale[-1] <= 1e-6:
            return None
        scale[scale <= 1e-6] = 1.0  # a column of the base that is 0 throughout, as latency where nobody turns
        values, vectors = np.linalg.eigh(total / np.outer(scale, scale))
        inverse = (vectors / np.maximum(values, 1e-9)) @ vectors.T / np.outer(scale, scale)
        if 1.0 / (inverse[-1, -1] * total[-1, -1]) < LEAST_OWN:
            return None
        found = inverse @ right.sum(axis=0)
        covariance = larger(self.variance * inverse, between_drives(right - normal @ found, normal))
        return found, np.sqrt(np.diag(covariance))


def of_mean(r: Residuals) -> tuple[Regression, list[str]]:
    """Give the regression of errors, and the columns that the model has."""
    bias = r.fitted.aligned.biases[r.fitted.component]
    base = [n for n in ("constant", "latency", "averaging") if n in r.columns]
    base += [name for k, name in enumerate(FEATURES, start=1) if bias[k] != 0.0]
    return Regression.of(r.z, r.columns, r, 1.0), base


def of_spread(r: Residuals, objects: ObjectErrors) -> tuple[Regression, list[str]]:
    """Give the regression of squared errors less 1, and the columns that the model has; "latency" stands for what
    errors are squared where the latency changes."""
    sizes = sizes_of(objects.features)
    columns = {
        n: v
        for n, v in r.raw.items()
        if n not in ("averaging", *FEATURES, *BEYOND) and not n.startswith("braking")
    }
    columns |= {"braking": r.raw["braking"]}
    columns |= {name: sizes[..., k] for k, name in enumerate(FEATURES)}
    columns["latency"] = r.columns["latency"] ** 2
    spreads, base = r.fitted.spreads, ["constant"]
    if spreads is not None:
        base += [FEATURES[k] for k in sorted({*spreads.drift_by, *spreads.noise_by})]
    return Regression.of(r.z**2 - 1.0, columns, r, 2.0), base
