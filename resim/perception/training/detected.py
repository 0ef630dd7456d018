"""Does the chain of detection fit? The share of time in which objects are detected, measured and expected of the chain.

A chain knows of an object whether it was detected a step ago and where it is, nothing else. Of sensors that know more
(that confirm who was seen for long, say) it may keep every transition and yet see far more than was seen.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from resim.core.geometry import Bools, Floats
from resim.perception.model import Detection, FailedAssumption, FieldOfView
from resim.perception.runtime.chain import probabilities
from resim.perception.training.clusters import FEWEST, between_drives, by_drive, drive_effect
from resim.perception.training.detection import DetectionSamples

LEAST_SHARE = 0.03
"""Least difference between shares of time that is told."""
GROUPS = 5
"""Groups of samples by each thing that detection may depend on: of as many samples each."""
MOTION = ("bearing", "speed", "relative_speed", "acceleration")
WORDS = {
    "range": "at {:.3g} to {:.3g} m",
    "bearing": "at a bearing of {:.3g} to {:.3g} rad",
    "occlusion": "hidden by {:.0%} to {:.0%}",
    "speed": "at {:.3g} to {:.3g} m/s",
    "relative_speed": "{:.3g} to {:.3g} m/s faster than the EGO",
    "acceleration": "accelerating by {:.3g} to {:.3g} m/s²",
    "time": "{:.3g} to {:.3g} s after they appeared",
}
"""What groups are called."""
TOGETHER = (
    "objects of one list are lost and found together ({:+.2f}), in the model each by itself: the sensor may be blind "
    "to all of them at once, the model hardly ever is"
)
BY_DRIVE = (
    "the share of time in which objects are detected differs from drive to drive by {:.1%}, as by weather; in the "
    "model all drives are alike"
)


class DetectedShare:
    """The share seen less that expected, 0 in a model that fits: of all samples, and by all that it may depend on."""

    def __init__(self, s: DetectionSamples, view: FieldOfView, detection: Detection) -> None:
        self.found: list[tuple[str, str, Bools, float]] = []
        if detection.loss:  # else all are always detected, as all were
            inside = s.inside(view)
            expected, since = (part[inside] for part in expected_share(s, inside, detection))
            self.drive, self.seen, self.expected = s.drive[inside], s.seen[inside], expected
            groups = [("", "", np.ones(len(expected), dtype=bool))]
            values = {
                "range": s.place[:, 0],
                "occlusion": s.place[:, 2],
                **dict(zip(MOTION, s.motion.T, strict=True)),
            }
            for on, value in {**{on: one[inside] for on, one in values.items()}, "time": since}.items():
                groups += [(on, *group) for group in _groups(value, WORDS[on])]
            kind = s.kind[inside]
            groups += [("kind", f"of kind {one}", kind == one) for one in np.unique(kind).tolist()]
            told = [(*group, self._p(group[2])) for group in groups]
            self.found = [(on, where, among, p) for on, where, among, p in told if p is not None]
        self.count = len(self.found)

    def _p(self, among: Bools) -> float | None:
        """How likely the difference among these is by chance; None where drives are too few to tell."""
        off, drive = (self.seen - self.expected)[among], self.drive[among]
        if len(np.unique(drive)) < FEWEST:
            return None
        mean = float(off.mean())
        by, weigh = by_drive(off - mean, drive), by_drive(np.ones(len(off)), drive)
        se = float(np.sqrt(between_drives(by[:, None], weigh[:, None, None])[0, 0]))
        return 2.0 * float(student.sf(abs(mean) / max(se, 1e-12), len(by) - 1))

    def failures(self, level: float) -> Iterator[FailedAssumption]:
        """Give of each kind of group the largest difference that is surely there."""
        kinds: dict[str, FailedAssumption] = {}
        for on, where, among, p in self.found:
            seen, expected = float(self.seen[among].mean()), float(self.expected[among].mean())
            size = abs(seen - expected)
            if p < level and size > max(LEAST_SHARE, kinds[on].size if on in kinds else 0.0):
                text = f"objects {where} are" if where else "objects are"
                text += f" detected {seen:.1%} of the time, in the model {expected:.1%}"
                text += (
                    ": it sees more than the sensor" if expected > seen else ": it sees less than the sensor"
                )
                kinds[on] = FailedAssumption(
                    quantity="detection", assumption="detected", on=on, size=size, unit="", p=p, text=text
                )
        yield from kinds.values()


class DetectedTogether:
    """Are objects of one list lost and found together? Products of what each list says that the chain could not know,
    0 in a model in which each object has a chain of its own; and do drives differ in the share that is detected?"""

    def __init__(self, s: DetectionSamples, view: FieldOfView, detection: Detection) -> None:
        self.found: list[tuple[str, float, float]] = []
        if detection.loss:
            inside = s.inside(view)
            self._ask_lists(s, inside, detection)
            self._ask_drives(s, inside, detection)
        self.count = len(self.found)

    def _ask_lists(self, s: DetectionSamples, inside: Bools, detection: Detection) -> None:
        goes_on = inside[s.pairs].all(axis=1)
        before, now = s.pairs[goes_on].T
        lost, gained = _chain(s, detection, now, s.steps[goes_on])
        p = np.where(s.seen[before], 1.0 - lost, gained)
        off, spread = s.seen[now] - p, np.sqrt(p * (1.0 - p))
        lists = np.unique(s.list[now], return_inverse=True)[1]
        drive = np.zeros(int(lists.max(initial=-1)) + 1, dtype=np.intp)
        drive[lists] = s.drive[now]
        products, most = (_pairs(lists, one) for one in (off, spread))
        if len(np.unique(drive)) < FEWEST or most.sum() <= 0.0:
            return
        value = float(products.sum() / most.sum())
        by, weigh = by_drive(products - value * most, drive), by_drive(most, drive)
        se = float(np.sqrt(between_drives(by[:, None], weigh[:, None, None])[0, 0]))
        self.found.append(("together", value, float(student.sf(value / max(se, 1e-12), len(by) - 1))))

    def _ask_drives(self, s: DetectionSamples, inside: Bools, detection: Detection) -> None:
        off = (s.seen - expected_share(s, inside, detection)[0])[inside]
        tracks, index = np.unique(s.track[inside], return_inverse=True)
        number = np.bincount(index).astype(float)
        drive = np.zeros(len(tracks), dtype=np.intp)
        drive[index] = s.drive[inside]
        told = drive_effect(np.bincount(index, off) / number, number, drive)
        if told is not None:
            self.found.append(("one drive", float(np.sqrt(told[1])), told[0]))

    def failures(self, level: float) -> Iterator[FailedAssumption]:
        """Give what is surely there, and large enough."""
        for on, size, p in self.found:
            if p >= level or size < LEAST_SHARE:
                continue
            text = TOGETHER.format(size) if on == "together" else BY_DRIVE.format(size)
            yield FailedAssumption(
                quantity="detection", assumption="detected", on=on, size=size, unit="", p=p, text=text
            )


def _pairs(lists: NDArray[np.intp], values: Floats) -> Floats:
    """The sum over the pairs of samples of each list of the products of their values."""
    return np.asarray(0.5 * (np.bincount(lists, values) ** 2 - np.bincount(lists, values**2)), dtype=float)


def _chain(
    s: DetectionSamples, detection: Detection, rows: NDArray[np.intp], step: Floats
) -> tuple[Floats, Floats]:
    """How likely each of these samples is lost, or gained, after a step [s]."""
    at = _cells(s, detection)
    loss, gain = (np.array(table)[at][rows] for table in (detection.loss, detection.gain))
    lost, gained = probabilities(loss, gain, step)
    return np.asarray(lost), np.asarray(gained)


def _cells(s: DetectionSamples, detection: Detection) -> tuple[NDArray[np.intp], ...]:
    """In which cell of the chain's tables each sample lies."""
    edges = (detection.range_edges, detection.bearing_edges, detection.occlusion_edges)
    return tuple(
        np.clip(np.searchsorted(one, s.place[:, c], side="right") - 1, 0, len(one) - 2)
        for c, one in enumerate(edges)
    )


def expected_share(s: DetectionSamples, inside: Bools, detection: Detection) -> tuple[Floats, Floats]:
    """Give the probability (S,) to be detected by the chain, whatever was seen, and the time (S,) [s] since an object
    is there; NaN and 0 for samples that are not inside."""
    at = _cells(s, detection)
    loss, gain, first = (np.array(table)[at] for table in (detection.loss, detection.gain, detection.first))
    step, goes_on = np.zeros(len(s.seen)), inside[s.pairs].all(axis=1)
    before, after = s.pairs[goes_on].T
    step[after] = s.steps[goes_on]
    lost, gained = probabilities(loss, gain, step)
    p, since = np.where(inside, first, np.nan), np.zeros(len(s.seen))
    previous = np.full(len(s.seen), -1)
    previous[after] = before
    for now in _in_turn(previous, inside):
        was = previous[now]
        p[now] = p[was] * (1.0 - lost[now]) + (1.0 - p[was]) * gained[now]
        since[now] = since[was] + step[now]
    return p, since


def _in_turn(previous: NDArray[np.intp], inside: Bools) -> Iterator[NDArray[np.intp]]:
    """Give the samples that follow the first ones, then those that follow these, and so on."""
    following = np.full(len(previous) + 1, -1)
    following[previous[previous >= 0]] = np.flatnonzero(previous >= 0)
    now = following[np.flatnonzero(inside & (previous < 0))]
    while len(now := now[now >= 0]):
        yield now
        now = following[now]


def _groups(values: Floats, words: str) -> Iterator[tuple[str, Bools]]:
    """Give groups of as many samples each, in words; of many that are 0, the others have groups of their own."""
    zero = values == 0.0
    parts = [zero, ~zero] if 1.0 / GROUPS < zero.mean() < 1.0 else [np.ones(len(values), dtype=bool)]
    for part in parts:
        edges: list[float] = np.unique(np.quantile(values[part], np.linspace(0.0, 1.0, GROUPS + 1))).tolist()
        edges = [*edges, *edges][:2] if len(edges) == 1 else edges
        for low, high in pairwise(edges):
            last = high == edges[-1]
            among = part & (values >= low) & ((values <= high) if last else (values < high))
            yield words.format(low, high), among


DETECTED = (DetectedShare, DetectedTogether)
"""What is asked of a chain."""
