"""Speed and heading taken from the positions, where these tell another motion."""

from __future__ import annotations

import numpy as np
import pandas as pd

from resim.core.finding import Finding
from resim.core.geometry import Bools, Floats, wrap_angle
from resim.recordings import RecordingTables
from resim.recordings.checks.derived import WINDOW, Motion, motion
from resim.recordings.checks.motion import (
    BIAS_SHARE,
    FAST,
    HEADING_BIAS,
    HEADING_RUN,
    SPEED_BIAS,
    SPEED_RUN,
    SPEED_SHARE,
)
from resim.recordings.checks.samples import HOLE
from resim.recordings.checks.tracks import PEDESTRIAN, Complex, Track, runs
from resim.recordings.repairs.frames import changed, frame_of, rows_of, table, track, with_frame
from resim.recordings.repairs.settings import RepairOptions

EDGE = 0.3
"""Part of the limit down to which a disagreement reaches."""
ASTRAY = 0.35
"""Angle [rad] between heading and course from which on the heading is not asked for the speed."""


def speed_disagrees(tables: RecordingTables, finding: Finding, how: RepairOptions) -> RecordingTables:
    """Give the object the speed of its positions where its own is another, in all of it where it is so on the whole."""
    found = _own(tables, finding, how)
    if found is None:
        return tables
    own, labels, m, step = found
    off = np.abs(m.told) - np.abs(m.moved)
    limit = SPEED_RUN + SPEED_SHARE * np.abs(m.moved)
    bias = abs(float(np.median(off))) > SPEED_BIAS + BIAS_SHARE * float(np.median(np.abs(m.moved)))
    here = np.ones(len(own), dtype=bool) if bias else _where(own, m, np.abs(off) / limit, step)
    velocity = velocity_of(own.t, own.p, step)
    along = (velocity * np.exp(-1j * own.heading)).real
    astray = np.abs(np.angle(velocity * np.exp(-1j * own.heading) * np.sign(along))) > ASTRAY
    size = np.where(astray | (own.kind == PEDESTRIAN), np.abs(velocity), np.abs(along))
    v = np.where(along < 0.0, -size, size) if own.kind != PEDESTRIAN else size
    return _set(tables, finding, labels[here], "v", v[here])


def heading_disagrees(tables: RecordingTables, finding: Finding, how: RepairOptions) -> RecordingTables:
    """Give the object's heading without the constant by which it is off its course, else its course where it is off.

    Where it is too slow to have a course, the heading is linear in between.
    """
    found = _own(tables, finding, how)
    if found is None:
        return tables
    own, labels, m, step = found
    fast = (np.abs(m.moved) > FAST) & (np.abs(m.told) > FAST)
    if not fast.any():
        return tables
    off = np.angle(m.told * np.conj(m.moved))
    bias = float(np.angle(np.mean(np.exp(1j * off[fast]))))
    bias += float(np.median(wrap_angle(off[fast] - bias)))
    rest = np.abs(wrap_angle(off - bias))
    if abs(bias) > HEADING_BIAS and float(np.quantile(rest[fast], 0.9)) < HEADING_RUN:
        return _set(tables, finding, labels, "heading", wrap_angle(own.heading - bias))
    here = _where(own, m, np.where(fast, np.abs(off), 0.0) / HEADING_RUN, step)
    velocity = velocity_of(own.t, own.p, step)
    turned = np.where(own.v < 0.0, np.pi, 0.0)
    course = np.angle(velocity * np.exp(-1j * (own.heading + turned)))
    heading = own.heading + course
    slow = here & (np.abs(velocity) < FAST)
    if (~slow).any():
        kept = np.unwrap(np.where(here, heading, own.heading)[~slow])
        heading = np.where(slow, np.interp(own.t, own.t[~slow], kept), heading)
    return _set(tables, finding, labels[here], "heading", wrap_angle(heading[here]))


def velocity_of(t: Floats, p: Complex, step: float) -> Complex:
    """Give the velocity (K,) [m/s] of positions p (K,) [m] at t (K,) [s]: the slope, at each, of the parabola
    through the positions within WINDOW of it, by least squares (Savitzky and Golay 1964), none across a hole."""
    half = max(round(0.5 * WINDOW / step), 1)
    place = np.arange(len(t))[:, None] + np.arange(-half, half + 1)
    piece = np.cumsum(np.diff(t, prepend=t[0]) > HOLE * step)
    inside = (place >= 0) & (place < len(t))
    place = np.clip(place, 0, len(t) - 1)
    inside &= piece[place] == piece[:, None]
    tau = (t[place] - t[:, None]) / (half * step)
    powers = np.stack([np.ones_like(tau), tau, tau**2], axis=-1) * inside[..., None]
    few = inside.sum(axis=1) < 3  # then a line, or nothing
    powers[few, :, 2] = 0.0
    square = np.einsum("kwi,kwj->kij", powers, powers) + 1e-9 * np.eye(3)
    values = np.where(inside, p[place] - p[:, None], 0.0)
    right = np.einsum("kwi,kw->ki", powers, values)
    return np.asarray(np.linalg.solve(square, right[..., None])[:, 1, 0] / (half * step))


def _own(
    tables: RecordingTables, finding: Finding, how: RepairOptions
) -> tuple[Track, np.ndarray, Motion, float] | None:
    """The object's track, its rows' labels, its motion and the step; None where it is torn, or too short."""
    frame = frame_of(tables, finding.source)
    found = track(frame, rows_of(frame, finding.object))
    if found is None or how.torn(finding):
        return None
    step = table(tables, finding.source).step
    m = motion(found[0], step)
    return (found[0], found[1].to_numpy(), m, step) if len(m.t) else None


def _where(own: Track, m: Motion, off: Floats, step: float) -> Bools:
    """The samples of the windows in which it is off by the limit, out to where it is off by little of it."""
    out = np.zeros(len(own), dtype=bool)
    for a, b in runs(off > EDGE):
        if off[a : b + 1].max() > 1.0:
            reach = 0.5 * WINDOW + step
            out |= (own.t > m.t[a] - reach) & (own.t < m.t[b] + reach)
    return out


def _set(
    tables: RecordingTables, finding: Finding, labels: np.ndarray, column: str, values: Floats
) -> RecordingTables:
    frame = frame_of(tables, finding.source)
    new = frame[column].to_numpy(float).copy()
    place = frame.index.get_indexer(pd.Index(labels))
    new[place] = values
    rows = np.zeros(len(frame), dtype=bool)
    rows[place] = True
    return with_frame(tables, finding.source, changed(frame, rows, finding.code, **{column: new}))
