"""Repairs of clocks: jumps taken out, a drifting clock set to the other one's rate, delays taken out."""

from __future__ import annotations

import numpy as np

from resim.core.finding import Finding, Source
from resim.core.geometry import Floats
from resim.recordings import RecordingTables
from resim.recordings.checks.clock import jump_corrections
from resim.recordings.checks.delay import LONG, delay_of
from resim.recordings.checks.matching import pairs
from resim.recordings.repairs.frames import changed, frame_of, rows_of, table, with_frame
from resim.recordings.repairs.settings import RepairOptions

ROUNDS = 4
"""Times that the rate is fitted again, with what is left of it."""
LEFT = 0.005
"""Growth of the delay [s] over the recording that is left."""
SET_AT_START = 0.1
"""Delay [s] at the start that may be the sensor's: the clocks were set there, and drifted after."""
ON_GRID = 0.1
"""Part of the step by which stamps may miss a grid that they are on."""


def clock_jump(tables: RecordingTables, finding: Finding, how: RepairOptions) -> RecordingTables:
    """Give the source's times with all its clock's jumps taken out, of each the amount beyond the usual step."""
    frame = frame_of(tables, finding.source)
    correction, _ = jump_corrections(finding.source, frame)
    return _moved(tables, finding, np.asarray(correction != 0.0), frame["t"].to_numpy(float) + correction)


def time_unit(tables: RecordingTables, finding: Finding, how: RepairOptions) -> RecordingTables:
    """Give the source's times in seconds: divided by the unit's factor."""
    t = frame_of(tables, finding.source)["t"].to_numpy(float) / float(finding.details["factor"])
    return _moved(tables, finding, np.ones(len(t), dtype=bool), t)


def clock_offset(tables: RecordingTables, finding: Finding, how: RepairOptions) -> RecordingTables:
    """Give the times of the object, or of all, without the delay.

    A single object's stamps belong on those of the others, where these have a grid: its delay is then known
    to the step.
    """
    frame = frame_of(tables, finding.source)
    shift = float(finding.details["shift"])
    rows = rows_of(frame, finding.object)
    t = frame["t"].to_numpy(float)
    if finding.object:
        shift = _onto_grid(t[rows], shift, t[~rows])
    return _moved(tables, finding, rows, t + shift)


def clock_drift(tables: RecordingTables, finding: Finding, how: RepairOptions) -> RecordingTables:
    """Give the source's times at the rate of the other source's: t' = t0 + (t - t0) / (1 + rate).

    t0 is the start where the clocks agree there as well as sensors do, else when they do agree, within the
    recording. The rate is fitted again until nothing is left of it, the delay after that.
    """
    sign = 1.0 if finding.source == "sd" else -1.0
    stamps = frame_of(tables, finding.source)["t"].to_numpy(float)
    every = np.ones(len(stamps), dtype=bool)
    first, last = float(stamps.min()), float(stamps.max())
    middle, scale, delay = 0.5 * (first + last), 1.0, 0.0
    for n in range(ROUNDS):
        moved = middle + (stamps - middle) / scale
        fit = _common(_moved(tables, finding, every, moved))
        rate, delay = fit if fit is not None else (0.0 if n else float(finding.details["rate"]), delay)
        if abs(rate) * (last - first) < LEFT or abs(rate) > 0.5:
            break
        scale *= 1.0 + sign * rate
    t0 = _agree(sign * (scale - 1.0), delay, middle, first, last)
    return _moved(tables, finding, every, t0 + (stamps - t0) / scale)


def _agree(rate: float, delay: float, middle: float, first: float, last: float) -> float:
    """The time [s] at which the clocks agreed, where their delay was that at the middle."""
    if abs(delay + rate * (first - middle)) < SET_AT_START or rate == 0.0:
        return first
    return float(np.clip(middle - delay / rate, first, last))


def _common(tables: RecordingTables) -> tuple[float, float] | None:
    """Rate of SD's delay [s/s] and the delay [s], of all objects that tell; None where none does."""
    rates, delays, noise = [], [], []
    for pair in pairs(table(tables, "gt"), table(tables, "sd")):
        lasts = float(pair.t[-1] - pair.t[0])
        fit = delay_of(pair) if lasts >= LONG else None
        if fit is not None:
            rates.append(fit.drift / lasts)
            delays.append(fit.delay)
            noise.append(fit.drift_spread / lasts)
    if not rates:
        return None
    weights = np.asarray(noise) ** -2.0
    return float(np.average(rates, weights=weights)), float(np.average(delays, weights=weights))


def _onto_grid(own: Floats, shift: float, others: Floats) -> float:
    """The shift [s] nearest to the one given that puts the stamps onto the others'; as given without a grid."""
    grid = np.unique(np.round(others, 6))
    if len(grid) < 3:
        return shift
    step = float(np.median(np.diff(grid)))
    off = (grid - grid[0]) / step
    if np.median(np.abs(off - np.round(off))) > ON_GRID:
        return shift
    phase = (own + shift - grid[0]) / step
    back = phase - np.round(phase)
    back = back - np.round(back - back[0])  # stamps half a step off go one way together
    if np.ptp(back) > 2.0 * ON_GRID:
        return shift
    return shift - step * float(np.median(back))


def _moved(tables: RecordingTables, finding: Finding, rows: np.ndarray, t: Floats) -> RecordingTables:
    source: Source = finding.source
    frame = changed(frame_of(tables, source), rows, finding.code, t=np.round(t, 9))
    by_time = bool((np.diff(frame_of(tables, source)["t"].to_numpy(float)) >= 0.0).all())
    return with_frame(tables, source, frame.sort_values("t", kind="stable") if by_time else frame)
