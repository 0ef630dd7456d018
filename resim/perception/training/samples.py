"""The matched samples of all drives as arrays: what was perceived, and the truth at any latency."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Bools, Floats, to_frame, wrap_angle
from resim.perception.model import Averaging, Latency
from resim.perception.runtime.world import features
from resim.perception.training.drive import TrainingDrive
from resim.perception.training.matching import Matching, paired
from resim.perception.training.truth import HEADING, TrueMotion, V
from resim.scenario.maneuvers import momentary

LONGEST = 400
"""Samples in a row; a longer track is cut, and its parts are taken for independent."""


class _TrueEgo(NamedTuple):
    v: Floats


@dataclass(frozen=True, eq=False)
class TrainingSamples:
    """R rows of up to T samples, NaN beyond their end; each row one object in one drive, or a part of that.

    drive: (R,). t [s], x, y [m], heading [rad], v [m/s]: (R, T) as perceived, in the EGO's frame. ego: (4, R, T) true
    x, y, heading, v of the EGO at t. truth: of each row.
    """

    drive: NDArray[np.intp]
    t: Floats
    x: Floats
    y: Floats
    heading: Floats
    v: Floats
    ego: Floats
    truth: tuple[TrueMotion, ...]

    @property
    def seen(self) -> Bools:
        """Where something was perceived, (R, T)."""
        return np.isfinite(self.x)

    @property
    def step(self) -> float:
        """Usual time [s] between two samples."""
        steps = np.diff(self.t, axis=1)
        return float(np.median(steps[np.isfinite(steps)]))

    def positions(self, late: float) -> tuple[Floats, Floats]:
        """Give the true x, y (R, T) [m] of `late` seconds ago in the EGO's frame of now."""
        states = self._of_rows(lambda truth, t: truth.states(t - late)[:2], 2)
        return to_frame(states[0], states[1], *self.ego[:3])

    def speeds(self, late: float, over: float) -> Floats:
        """Give the true speeds (R, T) [m/s] of `late` seconds ago, the mean over `over` seconds."""
        return np.asarray(self._of_rows(lambda truth, t: truth.mean(V, t - late, over)[None], 1)[0])

    def headings(self, late: float, over: float) -> Floats:
        """Give the true headings (R, T) [rad, not wrapped] of then against the EGO's of now."""
        then = self._of_rows(lambda truth, t: truth.mean(HEADING, t - late, over)[None], 1)[0]
        return np.asarray(then - self.ego[2])

    def features(self, latency: Latency, averaging: Averaging) -> Floats:
        """Give (R, T, 4) what errors depend on: range and bearing at the position's latency, speeds at the speed's."""
        x, y = self.positions(latency.position)
        heading = self.headings(latency.heading, averaging.heading)
        v, a = self.speeds(latency.speed, averaging.speed), self.accelerations(latency.speed)
        return features(_TrueEgo(self.ego[3]), x, y, heading, v, a)

    def accelerations(self, late: float) -> Floats:
        """Give the true accelerations (R, T) [m/s²] of `late` seconds ago."""
        return np.asarray(self._of_rows(lambda truth, t: truth.states(t - late)[4:], 1)[0])

    def maneuvers(self, late: float) -> NDArray[np.intp]:
        """Give (R, T) what the objects did `late` seconds ago, as index into MANEUVERS; -1 where it is not known."""
        heading, v, a = self._of_rows(lambda truth, t: truth.states(t - late)[2:], 3)
        known = np.isfinite(v)
        return np.where(
            known,
            momentary(
                np.where(known, heading - self.ego[2], 0.0), np.where(known, v, 0.0), np.where(known, a, 0.0)
            ),
            -1,
        )

    def _of_rows(self, value: Callable[[TrueMotion, Floats], Floats], columns: int) -> Floats:
        out = np.full((columns, *self.t.shape), np.nan)
        for r, truth in enumerate(self.truth):
            n = int(np.isfinite(self.t[r]).sum())
            out[:, r, :n] = value(truth, self.t[r, :n])
        return out


def samples_of(drives: Sequence[TrainingDrive], matchings: Sequence[Matching]) -> TrainingSamples:
    """Gather the rows, in the order of drives and objects."""
    rows = list(_rows(drives, matchings))
    longest = max((values.shape[1] for _, _, values in rows), default=0)
    table = np.full((9, len(rows), longest), np.nan)
    for r, (_, _, values) in enumerate(rows):
        table[:, r, : values.shape[1]] = values
    drive = np.array([d for d, _, _ in rows], dtype=np.intp)
    t, x, y, heading, v = table[:5]
    return TrainingSamples(drive, t, x, y, heading, v, table[5:], tuple(truth for _, truth, _ in rows))


def _rows(
    drives: Sequence[TrainingDrive], matchings: Sequence[Matching]
) -> Iterator[tuple[int, TrueMotion, Floats]]:
    for d, (drive, matching) in enumerate(zip(drives, matchings, strict=True)):
        perceived = paired(drive, matching.row)
        for n, truth in enumerate(drive.truth):
            known = np.flatnonzero(matching.row[n] >= 0)
            if len(known) < 2:
                continue
            span = slice(int(known[0]), int(known[-1]) + 1)
            values = np.stack([drive.t[span], *(c[n, span] for c in perceived), *drive.ego[:4, span]])
            cuts = range(0, values.shape[1], LONGEST)
            for low, high in pairwise([*cuts, values.shape[1]]):
                if high - low > 1:
                    yield d, truth, values[:, low:high]


def heading_error(perceived: Floats, true: Floats) -> Floats:
    """Give perceived less true heading [rad], within a half turn; NaN where one is not known."""
    return np.asarray(wrap_angle(perceived - true))
