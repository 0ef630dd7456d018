"""Repairs of single samples: off the track, standing still, or with a spike in speed or heading."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pandas as pd

from resim.core.finding import Finding
from resim.core.geometry import Bools
from resim.recordings import RecordingTables
from resim.recordings.checks.identity import REACH
from resim.recordings.checks.samples import frozen_runs
from resim.recordings.checks.tracks import Track, Values, runs
from resim.recordings.repairs.filters import moving_average_outliers, robust_outliers
from resim.recordings.repairs.frames import frame_of, rows_of, table, track, with_frame
from resim.recordings.repairs.gaps import filled
from resim.recordings.repairs.settings import Filter, RepairOptions
from resim.recordings.tables import VALUES

WINDOW, FEWEST = 0.4, 9
"""Time [s] that the filters look at, and samples at least: three that are off must not be half of them."""
SIGMAS = 4.0
"""Scaled median deviations from which on the robust filter takes a value for an outlier."""
LEAST = {"OUTLIER": REACH, "ACCELERATION": 0.5, "YAW_RATE": 0.1}
"""What a value must be off at least to be one, and the moving average's threshold: [m], [m/s], [rad]."""
BRIEF = 3
"""Samples in a row that are outliers; more of them are another motion."""
REST = 1e-9


def outlier(tables: RecordingTables, finding: Finding, how: RepairOptions) -> RecordingTables:
    """Give the object's track without the samples off it; interpolated, at its ends left empty.

    The filter looks at what is left of the positions when the way that speed and heading tell is taken off.
    """
    return _replaced(tables, finding, how, ("x", "y"))


def spikes(tables: RecordingTables, finding: Finding, how: RepairOptions) -> RecordingTables:
    """Give the object's speeds, or headings, without single values off their course: interpolated."""
    return _replaced(tables, finding, how, ("v",) if finding.code == "ACCELERATION" else ("heading",))


def repeated_samples(tables: RecordingTables, finding: Finding, how: RepairOptions) -> RecordingTables:
    """Give the object's track with the samples that stand still interpolated: of speed and heading where these
    stand as well."""
    frame = frame_of(tables, finding.source)
    if (found := track(frame, rows_of(frame, finding.object))) is None:
        return tables
    own, labels = found
    missing = np.zeros((len(frame), len(VALUES)), dtype=bool)
    place = frame.index.get_indexer(labels)
    for a, b in frozen_runs(own):
        stands = slice(a, b + 2)
        same = all(np.ptp(values[stands]) < REST for values in (own.heading, own.v))
        missing[place[a + 1 : b + 2]] = [True, True, same, same]
    return with_frame(
        tables, finding.source, filled(frame, finding.object, missing, finding.code, how.max_gap)
    )


def _replaced(
    tables: RecordingTables, finding: Finding, how: RepairOptions, columns: tuple[str, ...]
) -> RecordingTables:
    frame = frame_of(tables, finding.source)
    if (found := track(frame, rows_of(frame, finding.object))) is None:
        return tables
    own, labels = found
    step = table(tables, finding.source).step
    off = np.zeros(len(own), dtype=bool)
    for piece in _pieces(own, finding, how):
        off[piece] = _off(own.at(piece), finding.code, how.outliers, step)
    within = (own.t >= finding.start - 0.5 - REST) & (own.t <= finding.end + 0.5 + REST)
    rows = np.isin(frame.index, labels[off & within])
    missing = rows[:, None] & np.isin(VALUES, columns)
    return with_frame(tables, finding.source, _interpolated(frame, finding, missing, how))


def _interpolated(frame: pd.DataFrame, finding: Finding, missing: Bools, how: RepairOptions) -> pd.DataFrame:
    return filled(frame, finding.object, missing, finding.code, how.max_gap) if missing.any() else frame


def _pieces(own: Track, finding: Finding, how: RepairOptions) -> list[slice]:
    """The track between its jumps for good."""
    cuts = {int(np.searchsorted(own.t, f.end - REST)) for f in how.torn(finding)}
    edges = [0, *sorted(cuts - {0, len(own)}), len(own)]
    return [slice(a, b) for a, b in pairwise(edges)]


def _off(own: Track, code: str, chosen: Filter, step: float) -> Bools:
    """Which samples (K,) the filter takes for outliers, in runs of at most BRIEF."""
    values: Values = {"ACCELERATION": own.v, "YAW_RATE": own.heading}.get(code, own.v)
    if code == "OUTLIER":
        velocity = own.velocity()
        way = np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(own.t))
        values = own.p - np.concatenate([[0.0], way])
    window = 2 * max(round(0.5 * WINDOW / step), FEWEST // 2) + 1
    if chosen == "moving-average":
        return moving_average_outliers(values, window, LEAST[code])
    off = robust_outliers(values, window, SIGMAS, least=LEAST[code])
    for a, b in runs(off):
        if b - a >= BRIEF:
            off[a : b + 1] = False
    return off
