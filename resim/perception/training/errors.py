"""From matched samples to latencies and errors: alignment and spreads in turn, until both know of each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from resim.core.geometry import Bools, Floats
from resim.perception.model import FEATURES, Averaging, Error, Latency, Quantity, Response, Spread
from resim.perception.training.alignment import (
    AlignmentProblem,
    AlignmentResult,
    Component,
    first_guess,
    trusted,
    without,
)
from resim.perception.training.gauss_newton import align
from resim.perception.training.samples import TrainingSamples
from resim.perception.training.spread import SpreadProblem, Spreads, fit_spreads
from resim.perception.training.variogram import reconsidered
from resim.perception.training.whiten import whiten

NEGLIGIBLE = {"longitudinal": 0.005, "lateral": 0.005, "speed": 0.005, "heading": 5e-4}
"""Spread [m, m, m/s, rad] below which an error is none: references and splines are no better."""
SURPRISING = 3.3
"""Standard errors by which samples differ from what is expected of them to be a surprise."""
MEASURED: tuple[Quantity, ...] = ("longitudinal", "lateral", "speed", "heading")
"""What is measured anew in every list."""


@dataclass(frozen=True, eq=False)
class FittedQuantity:
    """One quantity: what it was aligned by, its spreads or none, and where it is known and no outlier (R, T)."""

    aligned: AlignmentResult
    component: int
    spreads: Spreads | None
    known: Bools

    @property
    def residual(self) -> Floats:
        """Errors less their bias (R, T)."""
        return self.aligned.residual[self.component]


@dataclass(frozen=True, eq=False)
class ObjectErrors:
    """Latencies, averaging times, and the errors of MEASURED; steps [s] and features (R, T, 4) at these latencies."""

    latency: Latency
    averaging: Averaging
    fitted: Mapping[str, FittedQuantity]
    steps: Floats
    features: Floats


def fit_objects(samples: TrainingSamples) -> ObjectErrors:
    """Estimate all of it from the matched samples, in two rounds: features depend on latencies."""
    steps = steps_of(samples)
    latency, averaging = Latency(), Averaging()
    fitted: dict[str, FittedQuantity] = {}
    for last in (False, True):
        features = samples.features(latency, averaging)
        found: dict[str, FittedQuantity] = {}
        for names in (("longitudinal", "lateral"), ("speed",), ("heading",)):
            found |= _fit(samples, names, features, steps, fitted, final=last)
        fitted = found
        at = {n: fitted[n].aligned for n in MEASURED}
        latency = Latency(
            position=at["longitudinal"].late, speed=at["speed"].late, heading=at["heading"].late
        )
        averaging = Averaging(speed=at["speed"].over, heading=at["heading"].over)
    return ObjectErrors(latency, averaging, fitted, steps, features)


def steps_of(samples: TrainingSamples) -> Floats:
    """Give (R, T) the time [s] since the sample before, the usual one where there is none."""
    steps = np.diff(samples.t, axis=1, prepend=np.nan)
    return np.asarray(np.round(np.where(np.isfinite(steps), steps, samples.step), 6), dtype=float)


def _fit(
    samples: TrainingSamples,
    names: tuple[str, ...],
    features: Floats,
    steps: Floats,
    before: Mapping[str, FittedQuantity],
    *,
    final: bool,
) -> dict[str, FittedQuantity]:
    """Fit quantities that share a latency."""
    task = _task(samples, names, features, steps)
    if not before:
        task = replace(task, components=[_guessed(task, c) for c in range(len(names))])
        late, over = first_guess(task), 0.0
    else:
        pairs = zip(names, task.components, strict=True)
        task = replace(task, components=[_spread_of(c, before[n], features) for n, c in pairs])
        late, over = before[names[0]].aligned.late, before[names[0]].aligned.over
    spreads: list[Spreads | None] = []
    kept: list[Bools] = []
    for last in (False, True) if final else (False,):
        aligned = align(task, late, over)
        late, over = aligned.late, aligned.over
        spreads, kept, components = [], [], []
        for name, component, residual in zip(names, task.components, aligned.residual, strict=True):
            known = np.isfinite(residual) & np.isfinite(features).all(axis=-1)
            spread = _spreads(
                name, SpreadProblem(residual, known, steps, sizes_of(features), samples.drive), final=last
            )
            component = with_spread(component, spread, features, name)
            known = trusted(known, component, residual, steps)
            spreads.append(spread)
            kept.append(known)
            components.append(without(component, known))
        task = replace(task, components=components)
    aligned = align(task, late, over) if final else aligned
    return {
        name: FittedQuantity(aligned, c, spreads[c], kept[c] & np.isfinite(aligned.residual[c]))
        for c, name in enumerate(names)
    }


def _task(
    samples: TrainingSamples, names: tuple[str, ...], features: Floats, steps: Floats
) -> AlignmentProblem:
    nothing = np.zeros(samples.t.shape)
    measured = {
        "longitudinal": samples.x,
        "lateral": samples.y,
        "speed": samples.v,
        "heading": samples.heading,
    }
    components = [Component(measured[n], nothing, nothing, 1.0, turns=n == "heading") for n in names]

    def expected(late: float, over: float) -> list[Floats]:
        if names == ("speed",):
            return [samples.speeds(late, over)]
        if names == ("heading",):
            return [samples.headings(late, over)]
        return list(samples.positions(late))

    if names == ("speed",):  # a speed error that goes with acceleration is a latency, to first order
        features = np.concatenate([features[..., :3], np.zeros((*features.shape[:2], 1))], axis=-1)
    averages = names[0] in ("speed", "heading")
    return AlignmentProblem(components, expected, features, steps, samples.drive, averages)


def _guessed(task: AlignmentProblem, c: int) -> Component:
    """The component with a guess of its spreads: mostly drift, by how far its errors vary without any latency."""
    error = task.errors(0.0, 0.0)[c]
    size = max(float(np.nanstd(error)), 1e-3) if np.isfinite(error).any() else 1.0
    full = np.full(error.shape, size)
    return replace(task.components[c], drift=full, noise=0.2 * full)


def _spreads(name: str, problem: SpreadProblem, *, final: bool) -> Spreads | None:
    used = problem.residual[problem.known]
    if not len(used) or float(np.std(used)) < NEGLIGIBLE[name]:
        return None
    found = fit_spreads(problem, select=final, final=final)
    return reconsidered(found, problem) if final and found is not None else found


def sizes_of(features: Floats) -> Floats:
    """Give features as spreads depend on them: range, and absolute values."""
    return np.where(np.isfinite(features), np.abs(features), 0.0)


def with_spread(component: Component, spread: Spreads | None, features: Floats, name: str) -> Component:
    """Give the component with these spreads at these features."""
    if spread is None:
        full = np.full(component.measured.shape, NEGLIGIBLE[name])
        return replace(component, drift=0.0 * full, noise=full)
    drift, noise = spread.levels(sizes_of(features))
    least = 1e-6 + 0.01 * drift
    return replace(component, drift=drift, noise=np.maximum(noise, least), tau=spread.tau)


def _spread_of(component: Component, fitted: FittedQuantity, features: Floats) -> Component:
    spread = fitted.spreads
    size = fitted.residual[fitted.known]
    if spread is None:
        full = np.full(component.measured.shape, max(float(np.std(size)) if len(size) else 0.0, 1e-4))
        return replace(component, drift=0.0 * full, noise=full)
    return with_spread(component, spread, features, "")


def refit(samples: TrainingSamples, objects: ObjectErrors, name: str, mask: Bools) -> FittedQuantity:
    """Fit bias and spreads of one quantity anew, of these samples (R, T) only, at the latencies that are known."""
    names = ("longitudinal", "lateral") if name in ("longitudinal", "lateral") else (name,)
    pooled, c = objects.fitted[name], names.index(name)
    whole = _task(samples, names, objects.features, objects.steps)
    component = without(with_spread(whole.components[c], pooled.spreads, objects.features, name), mask)
    task = AlignmentProblem(
        [component], lambda late, over: [whole.expected(late, over)[c]], whole.features, whole.steps, samples.drive,
        fixed=True,
    )  # fmt: skip
    aligned = align(task, pooled.aligned.late, pooled.aligned.over)
    known = mask & np.isfinite(aligned.residual[0])
    problem = SpreadProblem(
        aligned.residual[0], known, objects.steps, sizes_of(objects.features), samples.drive
    )
    return FittedQuantity(aligned, 0, _spreads(name, problem, final=True), known)


def deserves_own_fit(samples: TrainingSamples, objects: ObjectErrors, name: str, mask: Bools) -> bool:
    """Whether these samples (R, T) are so far off in the mean, or vary so much more or less than the fit of all
    expects, that a fit of their own is worth it. That one is judged by how drives differ."""
    pooled = objects.fitted[name]
    component = with_spread(
        Component(samples.x, samples.x, samples.x, 1.0), pooled.spreads, objects.features, name
    )
    table = np.stack([np.where(mask, pooled.residual, 0.0), np.where(mask, 1.0, 0.0)], axis=-1)
    white = whiten(table, mask, objects.steps, component.drift, component.noise, component.tau)
    y, x = white[..., 0], white[..., 1]
    offset, excess = float((x * y).sum()), float(np.where(mask, y**2 - 1.0, 0.0).sum())
    return bool(
        abs(offset) > SURPRISING * np.sqrt((x * x).sum())
        or abs(excess) > SURPRISING * np.sqrt(2.0 * mask.sum())
    )


def error_of(fitted: FittedQuantity) -> Error:
    """Give the error as the model has it."""
    bias, spread = fitted.aligned.biases[fitted.component], fitted.spreads
    names = ("constant", *FEATURES)
    response = Response(**dict(zip(names, bias.tolist(), strict=True)))
    if spread is None:
        return Error(bias=response)
    return Error(
        bias=response,
        drift=_spread(spread.drift, spread.drift_by),
        noise=_spread(spread.noise, spread.noise_by),
        correlation_time=spread.tau,
    )


def _spread(level: float | None, by: Mapping[int, float]) -> Spread:
    if level is None:
        return Spread()
    return Spread(constant=float(np.exp(level)), **{FEATURES[f]: slope for f, slope in by.items()})
