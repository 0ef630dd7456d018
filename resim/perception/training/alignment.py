"""Latency, averaging and bias at once: what is to be aligned, where to begin, and what does not belong.

perceived = truth(t - late, mean over `over`) + bias(features) + drift + noise. The estimation is in gauss_newton.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Bools, Floats
from resim.perception.training.whiten import whiten

PRIOR = 1.0
"""Latency [s] that is usual, as standard deviation: it decides where the data say nothing."""
LATEST, GRID = 2.0, 0.1
"""Latencies [s] that are tried at first."""

Expected = Callable[[float, float], list[Floats]]
"""The truth of `late` seconds ago, mean over `over` seconds: one (R, T) per component."""


@dataclass(frozen=True, eq=False)
class Component:
    """One measured quantity (R, T), and how its errors spread (R, T)."""

    measured: Floats
    drift: Floats
    noise: Floats
    tau: float
    turns: bool = False


@dataclass(frozen=True, eq=False)
class AlignmentResult:
    """late, over [s]; biases: per component, the constant and slopes (1 + F,), 0 where there is none, with
    standard errors se, and se_mean that of the bias at the mean of the features.

    residual: per component, (R, T), NaN where nothing is known. covariance rows that are not estimated are 0.
    """

    late: float
    over: float
    se_late: float
    over_limits: tuple[float, float]
    biases: tuple[Floats, ...]
    se: tuple[Floats, ...]
    se_mean: tuple[float, ...]
    residual: tuple[Floats, ...]


@dataclass(frozen=True, eq=False)
class AlignmentProblem:
    """What to align: components with one latency, what their biases may depend on (R, T, F), steps [s] (R, T) between
    samples, drives (R,) of the rows. averages: whether an averaging time is sought; fixed: whether lags are given."""

    components: Sequence[Component]
    expected: Expected
    features: Floats
    steps: Floats
    group: NDArray[np.intp]
    averages: bool = False
    fixed: bool = False

    def errors(self, late: float, over: float) -> list[Floats]:
        """Give measured less expected, of each component."""
        out = []
        for component, truth in zip(self.components, self.expected(late, over), strict=True):
            error = component.measured - truth
            out.append(np.arctan2(np.sin(error), np.cos(error)) if component.turns else error)
        return out


def first_guess(task: AlignmentProblem) -> float:
    """Give the latency [s] on a grid at which the truth, with an offset, fits best.

    All are judged on the same samples: those whose truth is known for the latest.
    """
    span = float(np.nanmedian(task.steps.sum(axis=1)))
    lags = np.arange(0.0, min(LATEST, 0.4 * span) + 1e-9, GRID)
    errors = [task.errors(float(late), 0.0) for late in lags]
    total = np.zeros(len(lags))
    for c, component in enumerate(task.components):
        table = np.stack([e[c] for e in errors], axis=-1)
        known: Bools = np.asarray(np.isfinite(table).all(axis=-1))
        if known.sum() < 3:
            return 0.0
        table = np.where(known[..., None], table, 0.0)
        one = np.ones((*known.shape, 1))
        white = whiten(
            np.concatenate([table, one], axis=-1),
            known,
            task.steps,
            component.drift,
            component.noise,
            component.tau,
        )
        flat = white.reshape(-1, len(lags) + 1)
        y, x = flat[:, :-1], flat[:, -1]
        left = y - np.outer(x, (x @ y) / max(float(x @ x), 1e-12))
        total += (left**2).sum(axis=0)
    return float(lags[np.argmin(total + (lags / PRIOR) ** 2)])


def trusted(known: Bools, component: Component, residual: Floats, steps: Floats) -> Bools:
    """Say which samples are no outliers: whose innovation is within 6 standard deviations."""
    white = whiten(
        np.where(known, residual, 0.0)[..., None],
        known,
        steps,
        component.drift,
        component.noise,
        component.tau,
    )[..., 0]
    return known & (np.abs(white) < 6.0)


def without(component: Component, keep: Bools) -> Component:
    """Give the component with the other samples gone."""
    return replace(component, measured=np.where(keep, component.measured, np.nan))
