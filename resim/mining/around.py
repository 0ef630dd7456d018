"""The moments of a test drive that matter: peaks of a measure, or what the EGO decided, with time before and after."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import find_peaks

from resim.core.errors import InputError
from resim.core.geometry import Floats
from resim.core.spelling import unknown
from resim.mining.extraction import ExtractedScenario, window_of
from resim.mining.features import Features
from resim.mining.maneuver import LabelledManeuver
from resim.mining.runs import joined, stretches
from resim.recordings import Recording
from resim.resimulation import AssessmentOptions, assess_recording
from resim.scenario import maneuvers as definitions

DECISION = "decision"
"""Asks for what the EGO did by itself: lane changes, and the beginnings of braking."""
LEAST_BRAKING = 0.3
"""s for which a drive must brake to count as a decision (our choice): measured accelerations are noisy."""


@dataclass(frozen=True)
class AroundOptions:
    """Which moments are cut out.

    Attributes:
        what: A measure (`risk`, `TTC`, ...), a label of the EGO, or `decision`.
        before: s before a moment.
        after: s after it.
        most: How many windows at most, the worst first.
    """

    what: str
    before: float = 5.0
    after: float = 3.0
    most: int = 10


@dataclass(frozen=True)
class Moment:
    """A moment of a drive: t [s], how bad it is (larger is worse), and the value that says so, NaN for none."""

    t: float
    badness: float
    value: float


def moments_finder(
    options: AroundOptions, labels: Sequence[str]
) -> Callable[[Recording, Features, Sequence[LabelledManeuver]], list[ExtractedScenario]]:
    """Give what finds the windows of a recording's own EGO. labels: those that there are.

    Raises InputError where there is neither such a measure nor such a label.
    """
    from resim.metrics.measures.registry import MEASURES

    known = [DECISION, *labels, *(measure.name for measure in MEASURES)]
    if options.what not in known:
        raise InputError("--around", unknown("measure or label", options.what, [*dict.fromkeys(known)]))

    def find(
        recording: Recording, features: Features, found: Sequence[LabelledManeuver]
    ) -> list[ExtractedScenario]:
        row = recording.gt.index(recording.ego)
        if options.what == DECISION:
            moments = _decisions(features, found, row)
        elif options.what in labels:
            own = [m for m in found if m.object == row and m.label == options.what]
            moments = [Moment(float(features.samples.t[m.at]), 0.0, np.nan) for m in own]
        else:
            moments = _peaks(recording, options.what)
        return _windows(features, row, moments, options)

    return find


def _decisions(features: Features, found: Sequence[LabelledManeuver], row: int) -> list[Moment]:
    """Lane changes, and when the EGO begins to brake (`resim.scenario.maneuvers.REACTED`)."""
    samples = features.samples
    own = [m for m in found if m.object == row and m.label in ("lane_change_left", "lane_change_right")]
    out = [Moment(float(samples.t[m.start]), 0.0, np.nan) for m in own]
    brakes = (features.a < definitions.REACTED) & (samples.owner == row)
    first, last = stretches(brakes, samples.piece_of)
    for start, end in joined(first, last, samples.t, samples.piece_of, LEAST_BRAKING, LEAST_BRAKING):
        hardest = float(features.a[start : end + 1].min())
        out.append(Moment(float(samples.t[start]), -hardest, hardest))
    return out


def _peaks(recording: Recording, name: str) -> list[Moment]:
    """The peaks of a measure over the drive, of whichever object is worst."""
    from resim.metrics.measures.registry import MEASURES

    kind = next(measure.worst for measure in MEASURES if measure.name == name)
    options = AssessmentOptions(only=(name,), path="state" if recording.plan is None else "plan")
    block = assess_recording(recording, options).blocks["GT"]
    values, t = block.measures[name].value, block.drive.t
    badness = {"high": values, "low": -values, "both": np.abs(values)}[kind]
    flat = badness.reshape(len(t), -1)
    worst = np.where(np.isfinite(flat), flat, -np.inf).max(axis=1, initial=-np.inf)
    at = peaks(worst)
    signed = -worst if kind == "low" else worst
    return [Moment(float(t[k]), float(worst[k]), float(signed[k])) for k in at.tolist()]


def peaks(values: Floats) -> np.ndarray:
    """Give the places of all peaks of values (T,), -inf where there is none; ends count, plateaus by their middle."""
    known = np.isfinite(values)
    if not known.any():
        return np.zeros(0, dtype=np.intp)
    floor = float(values[known].min()) - 1.0
    found, _ = find_peaks(np.concatenate([[floor], np.where(known, values, floor), [floor]]))
    return np.asarray(found - 1)


def _windows(
    features: Features, row: int, moments: Sequence[Moment], options: AroundOptions
) -> list[ExtractedScenario]:
    """Windows around the worst moments, those that share samples merged, the worst first."""
    samples = features.samples
    low, high = int(samples.first[row]), int(samples.first[row + 1])
    t = samples.t[low:high]
    merged: list[tuple[int, int, list[Moment]]] = []
    for moment in sorted(moments, key=lambda m: m.t):
        start = int(np.searchsorted(t, moment.t - options.before - 1e-9))
        end = int(np.searchsorted(t, moment.t + options.after + 1e-9)) - 1
        if merged and start <= merged[-1][1]:
            first, last, before = merged[-1]
            merged[-1] = first, max(last, end), [*before, moment]
        else:
            merged.append((start, end, [moment]))
    ranked = sorted(merged, key=lambda w: (-max(m.badness for m in w[2]), w[0]))[: options.most]
    out = []
    for rank, (start, end, held) in enumerate(ranked, start=1):
        triggers = []
        for moment in sorted(held, key=lambda m: (-m.badness, m.t)):
            at = low + min(int(np.searchsorted(t, moment.t - 1e-9)), len(t) - 1)
            figures = {"rank": float(rank)} | ({} if np.isnan(moment.value) else {"value": moment.value})
            triggers.append(LabelledManeuver(f"around {options.what}", row, at, at, at, figures=figures))
        out.append(window_of(features, row, (low + start, low + end), triggers))
    return out
