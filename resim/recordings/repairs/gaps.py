"""Gaps filled along the track: single values, single samples, and gaps up to a stated length."""

from __future__ import annotations

import numpy as np
import pandas as pd

from resim.core.clock import TICK
from resim.core.finding import Finding
from resim.core.geometry import Bools, Floats, wrap_angle
from resim.core.schema import EXISTENCE, OPTIONAL_COLUMNS
from resim.recordings import RecordingTables
from resim.recordings.checks.samples import HOLE, SHORT
from resim.recordings.checks.tracks import PEDESTRIAN, Complex, Track
from resim.recordings.repairs.frames import (
    changed,
    frame_of,
    inserted,
    rows_of,
    table,
    track,
    with_frame,
)
from resim.recordings.repairs.settings import RepairOptions
from resim.recordings.tables import VALUES

SLOW = 0.5
"""Speed [m/s] below which a path has no direction that is worth more than the headings at its ends."""
NEAR = 0.25
"""Part of a step by which a new sample may move onto a time that other objects have."""


def bridge(known: Track, t: Floats) -> tuple[Complex, Floats, Floats]:
    """Give position (K,) x + iy [m], heading [rad] and speed [m/s] at times t (K,) s between known samples.

    With u = (t - a) / h between the samples at a and b = a + h, positions p and velocities w = v e^(i heading),
    the cubic Hermite p(u) = (1 + 2u)(1-u)² p_a + u(1-u)² h w_a + u²(3 - 2u) p_b + u²(u-1) h w_b: it keeps
    positions and speeds at both ends. Heading and speed are those of its derivative; for slow objects and in
    short holes, where noise of the positions would turn them, they are linear between the ends. So is
    everything for pedestrians.
    """
    k = np.clip(np.searchsorted(known.t, t, side="right") - 1, 0, len(known) - 2)
    h = known.t[k + 1] - known.t[k]
    u = (t - known.t[k]) / h
    linear = (1.0 - u) * known.heading[k] + u * known.heading[k + 1]
    v = (1.0 - u) * known.v[k] + u * known.v[k + 1]
    p, way = known.p[k], known.p[k + 1] - known.p[k]
    if known.kind == PEDESTRIAN:
        return p + u * way, linear, v
    w, z = known.velocity()[k], known.velocity()[k + 1]
    at = p + u**2 * (3.0 - 2.0 * u) * way + h * (u * (1.0 - u) ** 2 * w + u**2 * (u - 1.0) * z)
    rate = 6.0 * u * (1.0 - u) * way / h + (1.0 - u) * (1.0 - 3.0 * u) * w + u * (3.0 * u - 2.0) * z
    ahead = np.where(v < 0.0, -1.0, 1.0)
    off = wrap_angle(np.angle(ahead * rate) - linear)
    drives = (np.abs(rate) > SLOW) & (known.v[k] * known.v[k + 1] > 0.0) & (h > SHORT)
    # against the heading of both ends it went back in truth: the path says less than they do
    drives &= np.abs(off) < 0.5 * np.pi
    return at, linear + np.where(drives, off, 0.0), np.where(drives, ahead * np.abs(rate), v)


def filled(frame: pd.DataFrame, name: str, missing: Bools, code: str, max_gap: float) -> pd.DataFrame:
    """Give the table with the object's missing values interpolated and marked.

    missing: (K, 4), of VALUES. In gaps of more than max_gap [s], and at the ends of the track, they are left empty:
    that there is a row without them tells that somebody was there.
    """
    own = rows_of(frame, name)
    lost = own & missing.any(axis=1)
    if (found := track(frame, own & ~missing.any(axis=1))) is None:
        return frame  # nothing is known of it
    known, _ = found
    t = frame["t"].to_numpy(float)[lost]
    reach = np.full(len(t), np.inf)
    if len(known) > 1:
        k = np.searchsorted(known.t, t)
        inside = (k > 0) & (k < len(known))
        reach[inside] = known.t[k[inside]] - known.t[k[inside] - 1]
    keep = reach <= max_gap + TICK
    new = np.full((len(frame), len(VALUES)), np.nan)
    if keep.any():
        at, heading, v = bridge(known, t[keep])
        new[np.flatnonzero(lost)[keep]] = np.stack([at.real, at.imag, wrap_angle(heading), v], axis=1)
    values = np.where(missing, new, frame[list(VALUES)].to_numpy(float))
    return changed(frame, lost, code, **{c: values[:, n] for n, c in enumerate(VALUES)})


def missing_values(tables: RecordingTables, finding: Finding, how: RepairOptions) -> RecordingTables:
    """Give the object's missing values as the track around them has them."""
    frame = frame_of(tables, finding.source)
    missing = ~np.isfinite(frame[list(VALUES)].to_numpy(float))
    missing &= rows_of(frame, finding.object)[:, None]
    return with_frame(
        tables, finding.source, filled(frame, finding.object, missing, finding.code, how.max_gap)
    )


def holes(tables: RecordingTables, finding: Finding, how: RepairOptions) -> RecordingTables:
    """Give the samples that miss in the object, or in all, in holes of the finding's kind up to max_gap."""
    whole = table(tables, finding.source)
    names = [finding.object] if finding.object else [k.id for k in whole.tracks]
    frame = frame_of(tables, finding.source)
    for name in dict.fromkeys(names):
        frame = _object(frame, finding, name, how, whole.step)
    return with_frame(tables, finding.source, frame)


def _object(
    frame: pd.DataFrame, finding: Finding, name: str, how: RepairOptions, step: float
) -> pd.DataFrame:
    """The table with the object's holes filled."""
    if (found := track(frame, rows_of(frame, name))) is None:
        return frame
    known, labels = found
    others = np.unique(frame["t"].to_numpy(float))
    torn = [(f.start, f.end) for f in how.torn(finding)]
    parts, after = [], []
    for k in np.flatnonzero(np.diff(known.t) > HOLE * step).tolist():
        a, b = float(known.t[k]), float(known.t[k + 1])
        is_gap = b - a > SHORT + 0.5 * step
        its = finding.code == ("GAP" if is_gap else "MISSING_SAMPLES")
        here = finding.start - TICK <= a and b <= finding.end + TICK
        if not (its and here) or b - a > how.max_gap + TICK:
            continue
        if any(start <= a + TICK and b - TICK <= end for start, end in torn):
            continue  # what jumped in there was driven by nobody
        t = _grid(a, b, step, others)
        rows = frame.loc[[labels[k]] * len(t)].copy()
        p, heading, v = bridge(known, t)
        rows = rows.assign(t=t, x=p.real, y=p.imag, heading=wrap_angle(heading), v=v, repaired=finding.code)
        between = dict.fromkeys((c for c in (*OPTIONAL_COLUMNS, EXISTENCE) if c in rows), np.nan)
        if "z" in rows:
            ends = frame.loc[[labels[k], labels[k + 1]], "z"].to_numpy(float)
            between["z"] = ends[0] + (t - a) / (b - a) * (ends[1] - ends[0])
        parts.append(rows.assign(**between))
        after += [labels[k]] * len(t)
    return inserted(frame, pd.concat(parts), after) if parts else frame


def _grid(a: float, b: float, step: float, others: Floats) -> Floats:
    """The times [s] at which samples between a and b miss; on those that other objects have."""
    count = max(round((b - a) / step) - 1, 1)
    t = np.round(a + (b - a) * np.arange(1, count + 1) / (count + 1), 9)
    k = np.clip(np.searchsorted(others, t), 1, len(others) - 1)
    nearest = np.where(t - others[k - 1] < others[k] - t, others[k - 1], others[k])
    return np.asarray(np.where(np.abs(nearest - t) < NEAR * step, nearest, t))
