"""Can a classifier tell variations from measured traces? One variation of each held-out trace, gradient boosting.

It sees statistics of speeds, accelerations and jerk, along and across the lane, of 50 equitemporal points each: of the
values themselves a classifier also learns which ones a recording prefers (NGSIM's speeds dwell at whole 5 ft/s), which
tells of who recorded and not of who drove. `apart_by_series` does that. Traces of one origin
are in one fold, so that it never has seen a trace's own variation. Measured and varied go the same way: each is put
between stretches of steady speed, joined as a variation is, and its points are taken from that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.stats import rankdata

from resim.core.geometry import Floats
from resim.core.halton import halton
from resim.variations.features import POINTS, feature_vector, parts
from resim.variations.joining import BLEND, ManeuverChange, joined_motion
from resim.variations.kernels import ManeuverKernel
from resim.variations.lane_motion import STEP, LaneMotion

PLANTED = 0.05
"""m, the standard deviation of noise on positions that the same test must tell."""
ALIKE, TOLD = 0.6, 0.9
"""AUC up to which variations are like measured traces, and above which planted noise is told."""
FOLDS, DRAWS = 5, 1000
"""Folds of the test, and draws of origins for its interval."""
STATISTICS = ("mean", "spread", "least", "largest", "roughness")


@dataclass(frozen=True)
class Likeness:
    """How well a classifier tells two groups of traces.

    Attributes:
        traces: How many of each group.
        auc: Area under the curve, over all folds; 0.5 is chance.
        low: Lower end of its 95 % interval.
        high: Its upper end.
        by: The features that tell most, each by itself, with the AUC that it has alone.
    """

    traces: int
    auc: float
    low: float
    high: float
    by: Mapping[str, float]


def varied_traces(kernel: ManeuverKernel, held_out: Floats, box: float) -> tuple[Floats, Floats]:
    """Give the features (M, 3 points) of held-out traces as they are taken here, and of a variation of each."""
    offsets = (2.0 * halton(1, len(held_out), kernel.count) - 1.0) * box * kernel.box
    moved = offsets @ kernel.axes
    same = np.zeros(3 * POINTS)
    pairs = [
        (_retaken(row, same), _retaken(row, change)) for row, change in zip(held_out, moved, strict=True)
    ]
    first, second = zip(*pairs, strict=True)
    return np.array(first), np.array(second)


def with_noise(features: Floats, rng: np.random.Generator) -> Floats:
    """Give features (M, 3 points) with noise on their places."""
    noise = np.zeros_like(features)
    noise[:, POINTS:] = rng.normal(0.0, PLANTED, (len(features), 2 * POINTS))
    return features + noise


def _retaken(row: Floats, moved: Floats) -> Floats:
    """A trace between stretches of steady speed, varied, and its features."""
    t, s, d = parts(row)
    grid = np.arange(-BLEND - 1.0, t[-1] + BLEND + 1.0, STEP)
    places = [_extended(t, values, grid) for values in (s, d)]
    motion = LaneMotion(None, grid, *places)  # type: ignore[arg-type]  # nobody asks for its path
    change = ManeuverChange(0.0, float(t[-1]), moved)
    found = joined_motion(motion, change)
    return feature_vector(found, 0.0, float(t[-1] + moved[POINTS - 1]))


def _extended(t: Floats, values: Floats, grid: Floats) -> Floats:
    """A cubic through values, beyond whose ends it keeps its speed."""
    spline = CubicSpline(t, values)
    inside = np.clip(grid, t[0], t[-1])
    return np.asarray(spline(inside) + (grid - inside) * spline(inside, 1))


def signals(features: Floats) -> dict[str, Floats]:
    """Give what the classifier sees (M,), by name: statistics of speed, acceleration and jerk along and across."""
    out: dict[str, Floats] = {}
    for name, series in series_of(features).items():
        figures = (
            series.mean(axis=1), series.std(axis=1), series.min(axis=1), series.max(axis=1),
            np.abs(np.diff(series, axis=1)).mean(axis=1),
        )  # fmt: skip
        out |= {f"{statistic} {name}": value for statistic, value in zip(STATISTICS, figures, strict=True)}
    return out


def series_of(features: Floats) -> dict[str, Floats]:
    """Give speed, acceleration and jerk, along and across, at the points of each trace (M, points - order), by name."""
    t, s, d = parts(features)
    step = (t[:, -1:] / (POINTS - 1)).clip(1e-6)
    return {
        f"{name} {where}": np.diff(values, order, axis=1) / step**order
        for where, values in (("along", s), ("across", d))
        for order, name in enumerate(("speed", "acceleration", "jerk"), start=1)
    }


def tell_apart(one: Floats, other: Floats, seed: int = 0) -> Likeness:
    """Try to tell the traces of two groups (M, 3 points), row by row of the same origin."""
    names = [*signals(one[:1])]
    x = np.concatenate([np.column_stack([*signals(group).values()]) for group in (one, other)])
    y = np.repeat([0, 1], len(one))
    alone = {name: area(x[:, k], y) for k, name in enumerate(names)}
    most = sorted(alone, key=lambda name: -abs(alone[name] - 0.5))[:3]
    return Likeness(len(one), *_apart(x, seed), {name: alone[name] for name in most})


def apart_by_series(one: Floats, other: Floats, seed: int = 0) -> dict[str, Likeness]:
    """Try to tell two groups (M, 3 points) by the values at each point: of each series by itself, and of "all"."""
    found = [series_of(group) for group in (one, other)]
    x = {name: np.concatenate([group[name] for group in found]) for name in found[0]}
    every = x | {"all": np.concatenate([*x.values()], axis=1)}
    return {name: Likeness(len(one), *_apart(values, seed), {}) for name, values in every.items()}


def _apart(x: Floats, seed: int) -> tuple[float, float, float]:
    """The area, and the ends of its interval, for what is seen (2 M, K) of two groups of the same origins."""
    from sklearn.ensemble import GradientBoostingClassifier  # takes long to load
    from sklearn.model_selection import GroupKFold

    count = len(x) // 2
    y = np.repeat([0, 1], count)
    origin = np.tile(np.arange(count), 2)
    score = np.empty(len(y))
    for train, test in GroupKFold(FOLDS).split(x, y, origin):
        model = GradientBoostingClassifier(n_estimators=100, max_depth=3, subsample=0.7, random_state=seed)
        score[test] = model.fit(x[train], y[train]).predict_proba(x[test])[:, 1]
    rng = np.random.default_rng(seed)
    drawn = [_redrawn(score, y, rng.integers(0, count, count)) for _ in range(DRAWS)]
    low, high = np.quantile(drawn, [0.025, 0.975]).tolist()
    return area(score, y), low, high


def _redrawn(score: Floats, y: NDArray[np.integer], origins: NDArray[np.integer]) -> float:
    """The area of drawn origins, each with both of its traces."""
    half = len(y) // 2
    rows = np.concatenate([origins, origins + half])
    return area(score[rows], y[rows])


def area(score: Floats, y: NDArray[np.integer]) -> float:
    """Give the area under the curve of scores (K,): the share of pairs in which that of class 1 is the larger."""
    positive = int(y.sum())
    ranks = rankdata(score)
    return float((ranks[y == 1].sum() - 0.5 * positive * (positive + 1)) / (positive * (len(y) - positive)))
