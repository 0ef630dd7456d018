"""What is of lists, not of one object: their times, id switches, and objects that are not there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import gamma

from resim.core.geometry import Floats
from resim.perception.model import TrainedParameter, Update
from resim.perception.parts.false_objects import FalseObjects
from resim.perception.training.clusters import quantile
from resim.perception.training.drive import TrainingDrive
from resim.perception.training.false_places import false_tracks
from resim.perception.training.matching import Matching

REGULAR = 0.02
"""Share of the period below which its variation is none: clocks and rounding."""


def fit_update(drives: Sequence[TrainingDrive]) -> tuple[Update, dict[str, TrainedParameter]]:
    """Give period and jitter of the lists; gaps of more than one and a half periods are lists that are missing."""
    steps = np.concatenate([np.diff(d.t) for d in drives])
    if not len(steps):
        return Update(), {}
    steps = steps[steps < 1.5 * np.median(steps)]
    period, jitter, n = float(steps.mean()), float(steps.std()), len(steps)
    jitter = jitter if jitter > REGULAR * period else 0.0
    period = period if jitter else float(np.round(np.median(steps), 6))
    return Update(period=period, jitter=jitter), {
        "update.period": around(period, jitter / np.sqrt(n), n),
        "update.jitter": around(jitter, jitter / np.sqrt(2.0 * n), n),
    }


def fit_switches(matchings: Sequence[Matching], step: float) -> tuple[float, dict[str, TrainedParameter]]:
    """Give the rate of id switches, 1/s of the time that objects are detected, with those across drop-outs."""
    count = sum(m.switches for m in matchings)
    samples = sum(int((m.row >= 0).sum()) for m in matchings)
    rate = count / max(samples * step, 1e-9)
    return rate, {"id_switch": counted(rate, count, samples)}


def fit_false(
    drives: Sequence[TrainingDrive], matchings: Sequence[Matching], step: float
) -> tuple[FalseObjects, dict[str, TrainedParameter]]:
    """Give how objects that are nobody come, live and go; where they are and how fast, as they were seen first."""
    births = deaths = risk = 0
    for drive, matching in zip(drives, matchings, strict=True):
        for m in np.flatnonzero(matching.stranger.any(axis=1)):
            lists = np.flatnonzero(matching.stranger[m])
            begin, end = int(lists[0]), int(lists[-1])
            births += begin > 0
            deaths += end < len(drive.t) - 1
            risk += end - begin + (end < len(drive.t) - 1)
    tracks = false_tracks(drives, matchings)
    if not len(tracks):
        return FalseObjects(), {}
    lifetime = -step / float(np.log1p(-min((deaths + 0.5) / (risk + 1.0), 0.99)))
    noticed = (
        lifetime / step * -float(np.expm1(-step / lifetime))
    )  # who comes and goes between two lists is not seen
    time = sum(float(d.t[-1] - d.t[0]) for d in drives)
    rate, n = births / max(time * noticed, 1e-9), len(tracks)
    distance, bearing, _, v, length, width, _ = tracks.T
    bearing = np.abs(bearing)
    beyond = (n + 1.0) / n  # the largest of n falls short of the end by so much
    spread = float(v.std(ddof=1)) if n > 1 else 0.0
    false = FalseObjects(
        rate=rate, lifetime=lifetime, range=max(float(distance.max()) * beyond, 0.1),
        bearing=float(np.clip(bearing.max() * beyond, 0.01, np.pi)), speed=float(v.mean()), speed_spread=spread,
        length=float(length.mean()), width=float(width.mean()),
    )  # fmt: skip
    sure = {
        "rate": counted(rate, births, n),
        "lifetime": around(lifetime, lifetime / np.sqrt(max(deaths, 1)), n),
        "range": _largest(false.range, distance),
        "bearing": _largest(false.bearing, bearing),
        "speed": around(false.speed, spread / np.sqrt(n), n),
        "speed_spread": around(spread, spread / np.sqrt(2.0 * n), n),
    }  # fmt: skip
    return false, {f"false_objects.{name}": e for name, e in sure.items()}


def _largest(value: float, seen: Floats) -> TrainedParameter:
    """Give the estimate of the end of a uniform distribution."""
    low, n = float(seen.max()), len(seen)
    return TrainedParameter(value=value, low=low, high=low * 0.025 ** (-1.0 / n), samples=n)


def around(
    value: float, se: float, samples: int, groups: int = 1000, least: float = -np.inf
) -> TrainedParameter:
    """Give an estimate with the interval that its standard error makes."""
    half = quantile(groups) * float(se)
    return TrainedParameter(value=value, low=max(value - half, least), high=value + half, samples=samples)


def counted(rate: float, count: int, samples: int) -> TrainedParameter:
    """Give the estimate of a rate of `count` events, with Jeffreys' interval."""
    per = rate / count if count else 0.0
    high = float(gamma.ppf(0.975, count + 0.5))
    low = float(gamma.ppf(0.025, count + 0.5)) if count else 0.0
    return TrainedParameter(value=rate, low=low * per, high=high * per, samples=samples)
