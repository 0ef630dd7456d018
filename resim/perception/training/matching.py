"""Which perceived object is which true one: optimal assignment within gates, list by list."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from resim.core.geometry import Bools, Floats, wrap_angle
from resim.perception.training.drive import Rows, TrainingDrive

ALONG, ACROSS, SPEED = 12.0, 3.0, 12.0
"""Gates of the first round [m, m, m/s], along and across the true object's heading: a latency of 0.4 s at 30 m/s."""
LEAST = (4.0, 2.0, 6.0)
"""Least gates of the second round, about the offset that the first has shown."""
LINKED, NAMED = 0.5, 0.25
"""What a pair's cost is less by, in squared thirds of the gates, that stood in the last list, that the recording
names."""


@dataclass(frozen=True, eq=False)
class Matching:
    """row: (N, K) the perceived object that is each true one in each list, -1 for none. stranger: (M, K) perceived
    objects that are nobody in any list, but where the one that the recording names is not
    known at the time. switches: how often a true object got another id."""

    row: Rows
    stranger: Bools
    switches: int


@dataclass(frozen=True)
class _Expected:
    """Where a perceived object lies from its true one: along = offset - delay v; and the gates about it."""

    offset: float = 0.0
    delay: float = 0.0
    across: float = 0.0
    gates: tuple[float, float, float] = (ALONG, ACROSS, SPEED)


def match(drives: Sequence[TrainingDrive]) -> list[Matching]:
    """Match every drive, in two rounds: the second knows the usual offset and delay of the first."""
    first = [_matched(drive, _Expected()) for drive in drives]
    expected = _learned(drives, first)
    return [_matched(drive, expected) for drive in drives]


def _offsets(drive: TrainingDrive) -> tuple[Floats, Floats, Floats]:
    """Give (N, M, K) each perceived object's offset from each true one, along and across its heading [m], and in
    speed [m/s]."""
    x, y, heading = drive.in_frame(drive.states)
    dx, dy = drive.x[None] - x[:, None], drive.y[None] - y[:, None]
    c, s = np.cos(heading)[:, None], np.sin(heading)[:, None]
    return c * dx + s * dy, c * dy - s * dx, drive.v[None] - drive.states[:, None, 3]


def _matched(drive: TrainingDrive, expected: _Expected) -> Matching:
    along, across, speed = _offsets(drive)
    along = along - (expected.offset - expected.delay * drive.states[:, None, 3])
    across = across - expected.across
    far = [np.abs(o) / gate for o, gate in zip((along, across, speed), expected.gates, strict=True)]
    fits = (far[0] <= 1.0) & (far[1] <= 1.0) & (far[2] <= 1.0)
    cost = 9.0 * (far[0] ** 2 + far[1] ** 2 + far[2] ** 2)
    cost = cost - NAMED * (drive.gt_ids[:, None] == drive.gt_id[None, :])[:, :, None]
    row = _assign(np.where(fits, cost, np.inf))
    known = np.zeros(len(drive.ids), dtype=bool)
    known[row[row >= 0]] = True
    here = np.isfinite(drive.states[:, 0])
    unknown = np.array(
        [(here | (drive.gt_ids != name)[:, None]).all(axis=0) for name in drive.gt_id.tolist()],
        dtype=bool,
    )
    stranger = drive.seen & ~known[:, None] & unknown.reshape(drive.seen.shape)
    return Matching(row, stranger, _switches(row))


def _assign(cost: Floats) -> Rows:
    """Give (N, K) the assigned column of costs (N, M, K), -1 for none. Lists without a choice need no search."""
    fits = np.isfinite(cost)
    row = (
        np.where(fits.any(axis=1), fits.argmax(axis=1), -1)
        if cost.shape[1]
        else np.full(cost[:, 0:1].sum(1).shape, -1)
    )
    choice = (fits.sum(axis=0) > 1).any(axis=0) | (fits.sum(axis=1) > 1).any(axis=0)
    for k in np.flatnonzero(choice):
        now = cost[:, :, k].copy()
        if k:
            last = np.flatnonzero(row[:, k - 1] >= 0)
            now[last, row[last, k - 1]] -= LINKED
        dear = np.where(np.isfinite(now), now, 1e6)
        one, other = linear_sum_assignment(dear)
        row[:, k] = -1
        row[one, k] = np.where(dear[one, other] < 1e6, other, -1)
    return np.asarray(row, dtype=np.intp)


def _switches(row: Rows) -> int:
    return sum(int((np.diff(r[r >= 0]) != 0).sum()) for r in row)


def _learned(drives: Sequence[TrainingDrive], matchings: Sequence[Matching]) -> _Expected:
    """Give the usual offset and delay of the matched, and gates about them by how far they spread."""
    parts = []
    for drive, matching in zip(drives, matchings, strict=True):
        n, k = np.nonzero(matching.row >= 0)
        m = matching.row[n, k]
        along, across, speed = _offsets(drive)
        parts.append(np.stack([along[n, m, k], across[n, m, k], speed[n, m, k], drive.states[n, 3, k]]))
    along, across, speed, v = np.concatenate(parts, axis=1) if parts else np.empty((4, 0))
    if len(along) < 10:
        return _Expected()
    design = np.stack([np.ones(len(v)), -v], axis=1)
    weight = np.ones(len(v))
    fit = np.zeros(2)
    for _ in range(10):  # least absolute deviations by reweighting; a delay of 0.5 s is its prior
        scaled = design * weight[:, None]
        fit = np.linalg.solve(scaled.T @ design + np.diag([1e-6, len(v) / 0.25]), scaled.T @ along)
        weight = 1.0 / np.maximum(np.abs(along - design @ fit), 0.05)
    left = along - design @ fit
    middle = float(np.median(across))
    spreads = (left, across - middle, speed)
    gates = [
        max(least, 8.0 * 1.48 * float(np.median(np.abs(s)))) for least, s in zip(LEAST, spreads, strict=True)
    ]
    return _Expected(float(fit[0]), float(fit[1]), middle, (gates[0], gates[1], gates[2]))


def paired(drive: TrainingDrive, row: Rows) -> tuple[Floats, Floats, Floats, Floats]:
    """Give (N, K) x, y [m], heading [rad] and v [m/s] as perceived of each true object, NaN where it is not."""
    if not len(drive.ids):
        none = np.full(row.shape, np.nan)
        return none, none, none, none
    k = np.arange(row.shape[1])
    x, y, heading, v = (
        np.where(row >= 0, c[np.maximum(row, 0), k], np.nan)
        for c in (drive.x, drive.y, drive.heading, drive.v)
    )
    return x, y, np.asarray(wrap_angle(heading)), v
