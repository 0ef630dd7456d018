"""Whether predicted risk is to be believed: against collisions in held-out simulated traffic, as a reliability
diagram."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from resim.core.geometry import Floats
from resim.core.intervals import CONFIDENCE
from resim.space.statistics.rates import IntervalEstimate, share

EDGES = (0.0, 1e-4, 1e-3, 1e-2, 0.03, 0.1, 0.3, 1.0)
"""Of the bins of predicted risk (our choice)."""
LEAST = 20
"""Recordings of which drives are held out in a bin, below which nothing is told (our choice): none of 20 is at most
14 %. Variations of one recording, its seeds, and windows of one drive that overlap are one draw of what traffic does,
and tell nothing of others."""
Calibrated = Literal["calibrated", "too low", "not shown"]


@dataclass(frozen=True)
class ReliabilityBin:
    """Drives with a predicted risk in a bin.

    Attributes:
        low: Lower edge.
        high: Upper edge.
        drives: How many were held out.
        recordings: Of how many recordings those of known prediction and outcome are.
        predicted: Mean predicted risk of them.
        collided: Share of them that collided, with the exact interval of all bins together.
        verdict: `too low` where the prediction of the bin, or of a kind in it, lies below the interval of known drives;
            `not shown` where it lies below that of all, and for too few recordings.
    """

    low: float
    high: float
    drives: int
    recordings: int
    predicted: float
    collided: IntervalEstimate
    verdict: Calibrated


@dataclass(frozen=True)
class ReliabilityReport:
    """The reliability diagram.

    Attributes:
        bins: By predicted risk, those with a drive.
        verdict: `too low` if any bin is; `calibrated` if all have enough recordings and none is; else `not shown`.
            Where a drive has no prediction it may be of any bin: then all that there could be have to have enough.
        drives: How many were held out.
        unknown: Held-out drives without a prediction or an outcome, which speak for nothing.
    """

    bins: tuple[ReliabilityBin, ...]
    verdict: Calibrated
    drives: int
    unknown: int


def reliability(
    predicted: Floats,
    collided: Floats,
    recording: Sequence[str] | None = None,
    kind: Sequence[str] | None = None,
) -> ReliabilityReport:
    """Compare predicted risk (K,) with collisions (K,), 1 or 0; NaN where either is not known.

    recording (K,): of which recording each is; each of its own, if None. Drives of one recording are one draw: their
    means count as one drive. kind (K,): of which kind each is; those with the same prediction are of one, if None.

    A drive without an outcome counts as a collision and without a prediction as one that was predicted as 0, and
    neither is one of the drives that a bin needs, so that what is missing never makes it better: with a collision that
    nothing predicted it is not shown. That they are too low is told of known ones alone. Predictions that are too high
    are on the safe side. Each kind is held against its own prediction, too, as one whose risk is too low would be
    hidden by others in its bin.
    """
    unknown = np.isnan(predicted) | np.isnan(collided)
    told, hit = np.nan_to_num(predicted, nan=0.0), np.nan_to_num(collided, nan=1.0)
    where = _bin(told)
    of = np.arange(len(told)) if recording is None else np.unique(recording, return_inverse=True)[1]
    kinds = np.unique(told if kind is None else np.asarray(kind), return_inverse=True)[1]
    counts = np.array([len(np.unique(of[(where == k) & ~unknown])) for k in range(len(EDGES) - 1)])
    lost = np.isnan(predicted)
    together, alone = _shared(where[~unknown]), _shared(kinds[~unknown])
    bins = []
    for k in np.unique(where).tolist():
        mine = where == k
        found = _collided(hit[mine], of[mine], together)
        mean = float(_per_draw(told[mine], of[mine]).mean())
        groups = [(mine, together), *((mine & (kinds == one), alone) for one in np.unique(kinds[mine]))]
        verdict: Calibrated = "calibrated"
        if any(_below(told, hit, of, rows & ~unknown, level) for rows, level in groups):
            verdict = "too low"
        elif any(_below(told, hit, of, rows, level) for rows, level in groups) or counts[k] < LEAST:
            verdict = "not shown"
        edges, drives = (EDGES[k], EDGES[k + 1]), int(mine.sum())
        bins.append(ReliabilityBin(*edges, drives, int(counts[k]), mean, found, verdict))
    enough = (counts >= LEAST).all()
    every = {one.verdict for one in bins}
    whole: Calibrated = (
        "too low" if "too low" in every
        else "not shown" if every != {"calibrated"} or hit[lost].any() or (lost.any() and not enough)
        else "calibrated"
    )  # fmt: skip
    return ReliabilityReport(tuple(bins), whole, len(told), int(unknown.sum()))


def _shared(groups: np.ndarray) -> float:
    """The confidence of the interval of one group, of which all together hold. groups (K,): that of each drive."""
    return 1.0 - (1.0 - CONFIDENCE) / max(len(np.unique(groups)), 1)


def _below(told: Floats, hit: Floats, of: np.ndarray, rows: np.ndarray, confidence: float) -> bool:
    """Whether the mean prediction of rows (K,) lies below the interval of the share that collides."""
    mean = float(_per_draw(told[rows], of[rows]).mean()) if rows.any() else np.inf
    return mean < _collided(hit[rows], of[rows], confidence).low


def _per_draw(values: Floats, of: np.ndarray) -> Floats:
    """The mean of values (K,) over drives of each recording, of which `of` (K,) is the number."""
    _, where, count = np.unique(of, return_inverse=True, return_counts=True)
    return np.asarray(np.bincount(where, values) / count, dtype=float)


def _collided(hit: Floats, of: np.ndarray, confidence: float) -> IntervalEstimate:
    """The share of draws that collide."""
    per_draw = _per_draw(hit, of)
    return share(float(per_draw.sum()), float(len(per_draw)), confidence)


def believed(report: ReliabilityReport | None, low: float, high: float) -> bool:
    """Say whether all bins from a predicted risk to another one are calibrated."""
    if report is None or report.verdict != "calibrated" or not np.isfinite(low + high):
        return False
    first, last = (_bin(np.array([risk]))[0] for risk in (low, high))
    return set(EDGES[first : last + 1]) <= {one.low for one in report.bins}


def drives_missing(report: ReliabilityReport | None, low: float, high: float) -> int:
    """Give how many more drives have to be held out at least until all bins from a predicted risk to another one are
    told."""
    first, last = (_bin(np.array([risk]))[0] for risk in (low, high))
    held = {} if report is None else {one.low: one.recordings for one in report.bins}
    return int(sum(max(LEAST - held.get(edge, 0), 0) for edge in EDGES[first : last + 1]))


def _bin(risk: Floats) -> np.ndarray:
    """The bins of predicted risks."""
    return np.clip(np.searchsorted(EDGES, risk, side="right") - 1, 0, len(EDGES) - 2)
