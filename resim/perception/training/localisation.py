"""Errors of the EGO's own state, and of the sizes of objects: what needs no alignment."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Bools, Floats, to_frame, wrap_angle
from resim.perception.model import Error, Response, Spread, TrainedParameter
from resim.perception.parts.ego import EgoStateError, Localisation
from resim.perception.training.clusters import quantile
from resim.perception.training.drive import TrainingDrive
from resim.perception.training.lists import around
from resim.perception.training.matching import Matching
from resim.perception.training.samples import LONGEST
from resim.perception.training.spread import SpreadProblem, Spreads, fit_spreads
from resim.perception.training.whiten import whiten

LEAST = {"longitudinal": 1e-3, "lateral": 1e-3, "heading": 1e-4, "speed": 1e-3}
"""Spread [m, m, rad, m/s] below which an error is none."""
LASTING = 1000.0
"""Correlation time [s] of what does not change as long as an object is seen: its size."""


def fit_localisation(drives: Sequence[TrainingDrive]) -> tuple[Localisation, dict[str, TrainedParameter]]:
    """Give bias, drift and noise of the EGO's own state, of the drives that recorded it."""
    known = [(k, d) for k, d in enumerate(drives) if d.own is not None]
    if not known:
        return Localisation(), {}
    parts: dict[str, list[Floats]] = {name: [] for name in LEAST}
    steps, group = [], []
    for k, drive in known:
        assert drive.own is not None
        x, y = to_frame(drive.own[0], drive.own[1], *drive.ego[:3])
        errors = (x, y, wrap_angle(drive.own[2] - drive.ego[2]), drive.own[3] - drive.ego[3])
        step = np.round(np.diff(drive.t, prepend=2.0 * drive.t[0] - drive.t[min(1, len(drive.t) - 1)]), 6)
        for low in range(0, len(drive.t), LONGEST):
            span = slice(low, low + LONGEST)
            for name, error in zip(LEAST, errors, strict=True):
                parts[name].append(error[span])
            steps.append(step[span])
            group.append(k)
    fitted: dict[str, EgoStateError] = {}
    estimates: dict[str, TrainedParameter] = {}
    for name in LEAST:
        fitted[name], found = _own(name, _padded(parts[name], np.nan), _padded(steps, 0.04), np.array(group))
        estimates |= {f"ego.{name}.{part}": e for part, e in found.items()}
    return Localisation(**fitted), estimates


def _padded(rows: Sequence[Floats], value: float) -> Floats:
    out = np.full((len(rows), max(map(len, rows))), value)
    for row, values in zip(out, rows, strict=True):
        row[: len(values)] = values
    return out


def _own(
    name: str, error: Floats, steps: Floats, group: NDArray[np.intp]
) -> tuple[EgoStateError, dict[str, TrainedParameter]]:
    known = np.isfinite(error)
    n, groups = int(known.sum()), len(np.unique(group))
    if n < 3:
        return EgoStateError(), {}
    bias, se, spread = float(np.mean(error[known])), 0.0, None
    for final in (False, True):
        if float(np.std(error[known])) < LEAST[name]:
            break
        problem = SpreadProblem(error - bias, known, steps, np.zeros((*error.shape, 0)), group)
        spread = fit_spreads(problem, select=False, final=final)
        if spread is None:
            break
        bias, se = _mean(error, known, steps, spread)
    if spread is None:
        return EgoStateError(bias=bias), {
            "bias": around(bias, float(np.std(error[known])) / np.sqrt(n), n, groups)
        }
    drift, noise = (0.0 if level is None else float(np.exp(level)) for level in (spread.drift, spread.noise))
    own = EgoStateError(bias=bias, drift=drift, noise=noise, correlation_time=spread.tau)
    found = {"bias": around(bias, se, n, groups)}
    return own, found | spread_estimates(spread, n, groups)


def _mean(error: Floats, known: Bools, steps: Floats, spread: Spreads) -> tuple[float, float]:
    """Give the mean by generalised least squares, and its standard error."""
    drift, noise = spread.levels(np.zeros((*error.shape, 0)))
    noise = np.maximum(noise, 1e-6 + 0.01 * drift)
    table = np.stack([np.where(known, error, 0.0), np.where(known, 1.0, 0.0)], axis=-1)
    white = whiten(table, known, steps, drift, noise, spread.tau)
    y, x = white[..., 0].ravel(), white[..., 1].ravel()
    weight = float(x @ x)
    return float(x @ y) / weight, weight**-0.5


def spread_estimates(spread: Spreads, samples: int, groups: int) -> dict[str, TrainedParameter]:
    """Give the estimates "drift", "noise" and "correlation_time", intervals from logarithms."""
    out = {}
    levels = {"drift": spread.drift, "noise": spread.noise}
    levels["correlation_time"] = None if spread.drift is None else float(np.log(spread.tau))
    for name, log in levels.items():
        if log is not None:
            half = quantile(groups) * spread.se["tau" if name == "correlation_time" else name]
            low, value, high = (float(np.exp(np.clip(log + s, -50.0, 50.0))) for s in (-half, 0.0, half))
            out[name] = TrainedParameter(value=value, low=low, high=high, samples=samples)
    return out


def fit_size(
    drives: Sequence[TrainingDrive], matchings: Sequence[Matching], size: str
) -> tuple[Error, dict[str, TrainedParameter]]:
    """Give the error of "length" or "width". A recording has one size per perceived object: bias is their mean error,
    drift, that lasts, how they vary; dependences on features and noise within a track do not show."""
    errors = []
    for drive, matching in zip(drives, matchings, strict=True):
        perceived, true = (
            (drive.length, drive.gt_length) if size == "length" else (drive.width, drive.gt_width)
        )
        pairs = {(n, m) for n, row in enumerate(matching.row) for m in np.unique(row[row >= 0]).tolist()}
        errors += [perceived[m] - true[n] for n, m in sorted(pairs)]
    values = np.array(errors)[np.isfinite(errors)]
    if not len(values):
        return Error(), {}
    n, bias = len(values), float(values.mean())
    spread = float(values.std(ddof=1)) if n > 1 else 0.0
    error = Error(bias=Response(constant=bias))
    found = {"bias.constant": around(bias, spread / np.sqrt(n), n, n)}
    if spread > 1e-6:
        error = error.model_copy(update={"drift": Spread(constant=spread), "correlation_time": LASTING})
        found["drift.constant"] = around(spread, spread / np.sqrt(2.0 * n), n, n, least=0.0)
    return error, {f"errors.{size}.{name}": e for name, e in found.items()}
