"""How well a perception model tells what sensors do in drives that it has not seen: figures, no pictures.

Errors are perceived less true at the same time, latency and all, as the AD function gets them. The model's are those
of its own runtime over the same drives.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from zlib import crc32

import numpy as np
from scipy.stats import wasserstein_distance

from resim.core.errors import InputError
from resim.core.geometry import Bools, Floats, wrap_angle
from resim.core.tracks import Strings
from resim.perception.model import PerceptionModel, Update
from resim.perception.parts.false_objects import FalseObjects
from resim.perception.training import train
from resim.perception.training.drive import TrainingDrive, drive_of
from resim.perception.training.matching import match, paired
from resim.recordings.recording import Recording
from resim.simulation.function.interface import EgoState
from resim.simulation.perception import World

QUANTITIES = ("longitudinal", "lateral", "speed", "heading")
UNITS = ("m", "m", "m/s", "rad")
LAGS = (0.1, 0.2, 0.4, 0.8, 1.2, 1.6, 2.0, 3.0)
"""Lags [s] of the autocorrelation."""
SHARES = tuple(round(0.025 * k, 3) for k in range(1, 40))
"""Of the errors, of which the quantiles are told."""
WARM = 1.5
"""Time [s] after an object's first truth, or the first list, in which it is not judged: the model does not know what
was before."""


FOLDS = 5
"""Parts of the drives, each of which is judged by a model that was trained on the others."""


@dataclass(frozen=True)
class Agreement:
    """One quantity, in its unit: means and standard deviations of errors measured and of the model, the Wasserstein
    distance between both, that between two halves of the measured drives (None for one drive), and autocorrelations
    at LAGS (None where no pair is so far apart)."""

    unit: str
    samples: int
    mean: tuple[float, float]
    deviation: tuple[float, float]
    quantiles_measured: tuple[float, ...]
    quantiles_model: tuple[float, ...]
    wasserstein: float
    yardstick: float | None
    autocorrelation_measured: tuple[float | None, ...]
    autocorrelation_model: tuple[float | None, ...]


@dataclass(frozen=True)
class Report:
    """Agreement by quantity; lags [s]; share of time that objects were detected, and lengths [s] of drop-outs, measured
    and of the model; latencies [s] by name, one for each fold's training. `dataclasses.asdict` of it is JSON-able."""

    drives: int
    folds: int
    quantities: dict[str, Agreement]
    lags: tuple[float, ...]
    detected: tuple[float, float]
    dropouts_measured: tuple[float, ...]
    dropouts_model: tuple[float, ...]
    latencies: dict[str, tuple[float, ...]]


@dataclass(frozen=True, eq=False)
class DriveErrors:
    """Errors of one drive: values (4, N, K), NaN where not perceived; there: (N, K) where an object was and is judged;
    t (K,) s."""

    t: Floats
    values: Floats
    there: Bools


def cross_validate(
    recordings: Sequence[Recording],
    *,
    folds: int = FOLDS,
    seeds: int = 3,
    progress: Callable[[str], None] = lambda stage: None,
) -> Report:
    """Train on all but one fold of the drives, judge on that one, for each fold; fewer drives than folds: one each.

    seeds: how often the model perceives each drive. progress: is told of each fold as it begins. Raises InputError for
    fewer than two drives, and as `train`.
    """
    if len(recordings) < 2:
        problem = (
            f"{len(recordings)} drive, expected two or more: one to validate with, the others to train on"
        )
        raise InputError("validation", problem)
    folds = min(folds, len(recordings))
    measured: list[DriveErrors | None] = [None] * len(recordings)
    perceived: list[DriveErrors] = []
    models = []
    for fold in range(folds):
        progress(f"validate {fold + 1} of {folds}")
        held = range(fold, len(recordings), folds)
        rest = [r for k, r in enumerate(recordings) if k not in held]
        models.append(train(rest, name=f"fold {fold + 1}"))
        drives = [drive_of(recordings[k]) for k in held]
        for k, found in zip(held, measured_errors(drives), strict=True):
            measured[k] = found
        perceived += [model_errors(models[-1], d, seed) for d in drives for seed in range(seeds)]
    return _report([m for m in measured if m is not None], perceived, models, folds)


def judge(model: PerceptionModel, recordings: Sequence[Recording], *, seeds: int = 10) -> Report:
    """Judge a model on drives that it was not trained on."""
    drives = [drive_of(recording) for recording in recordings]
    perceived = [model_errors(model, drive, seed) for drive in drives for seed in range(seeds)]
    return _report(measured_errors(drives), perceived, [model], 1)


def measured_errors(drives: Sequence[TrainingDrive]) -> list[DriveErrors]:
    """Give what the sensors were off by."""
    out = []
    for drive, matching in zip(drives, match(drives), strict=True):
        out.append(_errors(drive, np.stack(paired(drive, matching.row))))
    return out


def model_errors(model: PerceptionModel, drive: TrainingDrive, seed: int) -> DriveErrors:
    """Give what the model is off by over the same drive, in lists at the same times."""
    # compiles, or reads what it compiled: only when a model is run; reports import this module
    from resim.perception.runtime.sensor import Sensor

    plain = model.model_copy(update={"update": Update(), "id_switch": 0.0, "false_objects": FalseObjects()})
    sensor = Sensor(plain)
    sensor.reset(np.random.default_rng([seed, crc32(drive.name.encode())]))
    seen = np.full((4, len(drive.truth), len(drive.t)), np.nan)
    row = {name: n for n, name in enumerate(drive.gt_ids.tolist())}
    for k, world in enumerate(_worlds(drive)):
        perceived = sensor.perceive(world)
        rows = [row[name] for name in perceived.ids.tolist()]
        seen[:, rows, k] = perceived.x_ego, perceived.y_ego, perceived.heading_ego, perceived.v
    return _errors(drive, seen)


def _worlds(drive: TrainingDrive) -> Sequence[World]:
    out: list[World] = []
    here = np.isfinite(drive.states[:, 0])
    known: dict[
        bytes, tuple[Strings, Strings]
    ] = {}  # who is there: the same array as long as it is the same ones
    kind = np.full(len(drive.truth), "car")
    for k, t in enumerate(drive.t.tolist()):
        rows = np.flatnonzero(here[:, k])
        ids, kinds = known.setdefault(rows.tobytes(), (drive.gt_ids[rows], kind[rows]))
        x, y, heading, v, _ = drive.states[rows, :, k].T
        ego = EgoState(*drive.ego[:4, k].tolist())
        out.append(
            World(t, ego, ids, kinds, x + 1j * y, heading, v, drive.gt_length[rows], drive.gt_width[rows])
        )
    return out


def _errors(drive: TrainingDrive, seen: Floats) -> DriveErrors:
    """Errors of x, y, heading, v (4, N, K) as seen, in the order of QUANTITIES."""
    x, y, heading = drive.in_frame(drive.states)
    values = np.stack([seen[0] - x, seen[1] - y, seen[3] - drive.states[:, 3], wrap_angle(seen[2] - heading)])
    first = np.maximum([truth.start for truth in drive.truth], drive.t[0])
    there = np.isfinite(x) & (drive.t >= first[:, None] + WARM)
    return DriveErrors(drive.t, np.where(there, values, np.nan), there)


def _report(
    measured: Sequence[DriveErrors],
    perceived: Sequence[DriveErrors],
    models: Sequence[PerceptionModel],
    folds: int,
) -> Report:
    step = float(np.median(np.concatenate([np.diff(e.t) for e in measured])))
    quantities = {
        name: _agreement(unit, [e.values[q] for e in measured], [e.values[q] for e in perceived], step)
        for q, (name, unit) in enumerate(zip(QUANTITIES, UNITS, strict=True))
    }
    latencies = {
        name: tuple(float(getattr(m.latency, name)) for m in models)
        for name in ("position", "speed", "heading")
    }
    return Report(
        drives=len(measured),
        folds=folds,
        quantities=quantities,
        lags=LAGS,
        detected=(_detected(measured), _detected(perceived)),
        dropouts_measured=_dropouts(measured),
        dropouts_model=_dropouts(perceived),
        latencies=latencies,
    )


def _agreement(unit: str, measured: list[Floats], model: list[Floats], step: float) -> Agreement:
    one, other = (np.concatenate([e[np.isfinite(e)] for e in errors]) for errors in (measured, model))
    if not len(one) or not len(other):
        raise InputError(
            "validation", "no object is perceived long enough to validate with", "Give longer drives."
        )
    halves = [np.concatenate([e[np.isfinite(e)] for e in measured[k::2]] or [one[:0]]) for k in (0, 1)]
    return Agreement(
        unit=unit,
        samples=len(one),
        mean=(float(one.mean()), float(other.mean())),
        deviation=(float(one.std()), float(other.std())),
        quantiles_measured=tuple(np.quantile(one, SHARES).tolist()),
        quantiles_model=tuple(np.quantile(other, SHARES).tolist()),
        wasserstein=float(wasserstein_distance(one, other)),
        yardstick=float(wasserstein_distance(*halves)) if all(len(h) for h in halves) else None,
        autocorrelation_measured=_autocorrelation(measured, step),
        autocorrelation_model=_autocorrelation(model, step),
    )


def _autocorrelation(errors: list[Floats], step: float) -> tuple[float | None, ...]:
    """Of tracks (N, K), about the mean of all."""
    every = np.concatenate([e[np.isfinite(e)] for e in errors])
    mean, variance = float(every.mean()), float(every.var())
    out: list[float | None] = []
    for lag in LAGS:
        k = max(round(lag / step), 1)
        parts = [(e[:, k:] - mean) * (e[:, :-k] - mean) for e in errors if e.shape[1] > k]
        products = np.concatenate([p[np.isfinite(p)] for p in parts] or [every[:0]])
        out.append(float(products.mean()) / variance if len(products) and variance > 0.0 else None)
    return tuple(out)


def _detected(errors: Sequence[DriveErrors]) -> float:
    """Share of the time of objects in which they are perceived."""
    there = sum(int(e.there.sum()) for e in errors)
    return sum(int(np.isfinite(e.values[0]).sum()) for e in errors) / max(there, 1)


def _dropouts(errors: Sequence[DriveErrors]) -> tuple[float, ...]:
    """Lengths [s] of the times between loss and regain."""
    out: list[float] = []
    for e in errors:
        for row in np.isfinite(e.values[0]):
            seen = np.flatnonzero(row)
            gone = np.flatnonzero(np.diff(seen) > 1)
            out += (e.t[seen[gone + 1]] - e.t[seen[gone] + 1]).tolist()
    return tuple(out)
