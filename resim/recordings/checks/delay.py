"""Delay and drift between the clocks of SD and GT, or of single objects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resim.core.finding import Severity, Source
from resim.core.geometry import Floats
from resim.recordings.checks.codes import RankedFinding, found
from resim.recordings.checks.derived import motion
from resim.recordings.checks.matching import MatchedTrack, beside
from resim.recordings.checks.pooled import DRIFTED, USUAL, pooled
from resim.recordings.checks.reference import CONSTANT, is_point
from resim.recordings.checks.tracks import CheckedTable, Track

BIN = 1.0
"""Time [s] over which offsets are taken in the median: white noise goes, slow sensor errors stay."""
SLOW_ERROR = 0.5
"""Slowly varying position error of a sensor [m]: 0.25 in Wagner 2021, Section 5.2.1, more at Mcity."""
LONG = 3.0
"""Time [s] that an object is seen before its delay can be said to grow."""
DELAY, DRIFT = 2.0, 1.0
"""Delays and drifts over the recording [s] that are looked for, one standard deviation."""
LATENCY = 0.05
"""Delay [s] from which on it is worth a note, where it is sure."""
SAME_RATE = 0.4
"""Part of the rate of a drift by which the speeds may miss it."""
SURE = 3.0
"""Standard deviations by which a delay differs from none."""
MOST_APART = 0.1
"""Share of the objects that may show another delay than all together."""
DRIVES = 3.0
"""Speed [m/s] from which on a delay shows in the positions."""


@dataclass(frozen=True)
class Delay:
    """Delay [s] of SD, its standard deviation, its growth over the recording [s] and that one's deviation;
    left [m]: spread of the offsets that it does not explain."""

    delay: float
    spread: float
    drift: float
    drift_spread: float
    left: float


def clocks(
    gt: CheckedTable, sd: CheckedTable, known: list[MatchedTrack], ego: str
) -> tuple[list[RankedFinding], set[str]]:
    """Give drift and delay between the clocks, or of single objects; and the SD objects that these explain."""
    fits = {p.sd.id: fit for p in known if (fit := delay_of(p)) is not None}
    if not fits:
        return [], set()
    by_id = {p.sd.id: p for p in known}
    if (drift := _drift(gt, sd, fits, by_id)) is not None:
        return [drift], set(fits)
    if (late := _shared(sd, fits)) is not None:
        return [late], set(fits)
    whole = pooled(known, ego)
    if whole.what == "drift":
        source = _whose_clock(gt, sd, whole.drift / (whole.span[1] - whole.span[0]))
        return [_drifting(source, whole.span, whole.drift)], set(by_id)
    apart = [abs(f.delay - whole.delay) > max(0.1, SURE * f.spread) for f in fits.values()]
    if whole.what and np.mean(apart) <= MOST_APART:
        return [_delayed("sd", "", sd.span, whole.delay, "every object of it", whole.point)], set(by_id)
    if sensed := _sensed(sd, known, fits, ego):
        out, more = _single(gt, sd, {name: fit for name, fit in fits.items() if name not in sensed[1]}, by_id)
        return [sensed[0], *out], sensed[1] | more
    return _single(gt, sd, fits, by_id)


def _sensed(
    sd: CheckedTable, known: list[MatchedTrack], fits: dict[str, Delay], ego: str
) -> tuple[RankedFinding, set[str]] | None:
    """The latency of all but the EGO, which is localised by another sensor, and their ids; only where it is sure.

    A bumper in place of the centre looks the same at like speeds: that stays the error that it may be.
    """
    others = [pair for pair in known if pair.gt.id != ego]
    late = pooled(known, ego, sensed=True)
    mine = [fits[p.sd.id] for p in others if p.sd.id in fits]
    apart = [abs(f.delay - late.delay) > max(0.1, SURE * f.spread) for f in mine]
    if late.what != "delay" or late.delay < LATENCY or not apart or np.mean(apart) > MOST_APART:
        return None
    found = _delayed("sd", "", sd.span, late.delay, "every object of it but the EGO")
    return found, {pair.sd.id for pair in others}


def _drift(
    gt: CheckedTable, sd: CheckedTable, fits: dict[str, Delay], by_id: dict[str, MatchedTrack]
) -> RankedFinding | None:
    """The drift that every object that is seen for long shows by itself."""
    long = [f for n, f in fits.items() if by_id[n].t[-1] - by_id[n].t[0] >= LONG]
    if not long:
        return None
    drifts = np.array([f.drift for f in long])
    noise = np.array([f.drift_spread for f in long])
    drift = float(np.average(drifts, weights=noise**-2.0))
    agree = np.abs(drifts - drift) < np.maximum(0.4 * abs(drift), SURE * noise)
    if abs(drift) <= max(DRIFTED, SURE * float(noise.min())) or not agree.all():
        return None
    longest = max(by_id.values(), key=lambda p: p.t[-1] - p.t[0])
    span = (float(longest.t[0]), float(longest.t[-1]))
    source = _whose_clock(gt, sd, drift / (span[1] - span[0]))
    if source == "recording" and (len(long) == 1 or abs(drift) <= 2.0 * DRIFTED):
        return None
    return _drifting(source, span, drift)


def delay_of(pair: MatchedTrack) -> Delay | None:
    """Fit offset = b - v (delay + drift (t - middle)) to the offsets, again and again with SD put earlier by it.

    Usual sizes are its prior. At constant speed a constant offset and a delay look the same: the spread says
    so. None where it rests.
    """
    if float(np.median(np.abs(pair.v))) < DRIVES:
        return None
    delay, fit = 0.0, np.zeros(3)
    now = pair
    for _ in range(4):  # one step of a tangent is off where speed changes within the delay
        e, v, t = _binned(now)
        u = (t - t.mean()) / max(float(now.t[-1] - now.t[0]), BIN)
        design = np.stack([np.ones(len(e)), -v, -v * u], axis=1) / SLOW_ERROR
        weight = np.array([CONSTANT, DELAY, DRIFT]) ** -2.0
        covariance = np.linalg.inv(design.T @ design + np.diag(weight))
        held = weight * np.array([0.0, delay, 0.0])  # the prior is of the whole delay
        fit = covariance @ (design.T @ (e / SLOW_ERROR) - held)
        delay += float(fit[1])
        left = float(np.std(e - design @ fit * SLOW_ERROR))
        if abs(fit[1]) < 0.01 or (later := beside(pair.sd, pair.gt, -delay)) is None:
            break
        now = later
    spread = np.sqrt(np.diag(covariance))
    return Delay(delay, float(spread[1]), float(fit[2]), float(spread[2]), left)


def _binned(pair: MatchedTrack) -> tuple[Floats, Floats, Floats]:
    """Offset ahead [m], speed and time of each bin, in the median."""
    number = np.floor((pair.t - pair.t[0]) / BIN).astype(int)
    edges = np.flatnonzero(np.diff(number)) + 1
    parts = [np.split(values, edges) for values in (pair.along, pair.v, pair.t)]
    e, v, t = (np.array([np.median(part) for part in values]) for values in parts)
    return e, v, t


def _drifting(source: Source, span: tuple[float, float], drift: float) -> RankedFinding:
    text = f"the delay of SD against GT grows by {drift:+.3f} s from {span[0]:.2f} to {span[1]:.2f} s"
    known = source != "recording"
    return found(
        "CLOCK_DRIFT", source, "", span, drift, "s", text + (f", and the speeds of {source} with it" if known else ""),
        limit=DRIFTED, repair=None if known else "", details={"rate": drift / (span[1] - span[0])},
    )  # fmt: skip


def _whose_clock(gt: CheckedTable, sd: CheckedTable, rate: float) -> Source:
    """The source in which more objects' speeds are off their positions by the rate; "recording" where none is."""
    best: tuple[int, float, Source] = (0, 0.0, "recording")
    for table, expected in ((gt, -rate), (sd, rate)):
        off = []
        for track in table.tracks:
            m = motion(track, table.step)
            fast = np.abs(m.moved) > DRIVES
            if fast.sum() > 5:
                ratio = float(np.median(np.abs(m.told[fast]) / np.abs(m.moved[fast])))
                off.append(abs(ratio - 1.0 - expected))
        fits = [o for o in off if o < SAME_RATE * abs(rate)]
        if fits:
            best = max(best, (len(fits), -min(fits), table.source))
    return best[2]


def _shared(sd: CheckedTable, fits: dict[str, Delay]) -> RankedFinding | None:
    """The delay that every object shows by itself."""
    delays = np.array([f.delay for f in fits.values()])
    spreads = np.array([f.spread for f in fits.values()])
    common = float(np.average(delays, weights=spreads**-2.0))
    allowed = np.maximum(max(0.1, 0.2 * abs(common)), 2.0 * spreads)
    if len(fits) > 1 and (np.abs(delays - common) < allowed).all() and _sure(common, float(spreads.min())):
        return _delayed("sd", "", sd.span, common, "every object of it")
    return None


def _single(
    gt: CheckedTable, sd: CheckedTable, fits: dict[str, Delay], by_id: dict[str, MatchedTrack]
) -> tuple[list[RankedFinding], set[str]]:
    """The delays of single objects, and the SD objects that these explain."""
    out, explained = [], set()
    for name, fit in fits.items():
        pair = by_id[name]
        shifted = _stamped(gt, pair.gt, -fit.delay), _stamped(sd, pair.sd, fit.delay)
        if not any(shifted) and (is_point(pair) or not _sure(fit.delay, fit.spread)):
            continue
        if abs(fit.drift) > max(DRIFTED, 0.3 * abs(fit.delay)) or fit.left > CONSTANT:
            continue  # they move apart: no clock does that
        if abs(fit.delay) < (LATENCY if fit.spread < 0.02 else 2.0 * LATENCY):
            continue
        explained.add(name)
        source: Source = "gt" if shifted[0] and not shifted[1] else "sd"
        track = pair.gt if source == "gt" else pair.sd
        amount = fit.delay if source == "sd" else -fit.delay
        out.append(_delayed(source, track.id, (float(pair.t[0]), float(pair.t[-1])), amount, "its track"))
    return out, explained


def _sure(delay: float, spread: float) -> bool:
    return abs(delay) > max(LATENCY, SURE * spread)


def _delayed(
    source: Source, name: str, span: tuple[float, float], delay: float, who: str, point: float = 0.0
) -> RankedFinding:
    """The finding of a delay; point [m]: how far off another reference point would be that explains as much."""
    when = "late" if delay > 0.0 else "early"
    text = f"{who} comes {abs(delay):.2f} s too {when} against the other source"
    if point:
        text += (
            f", or names a point {abs(point):.2f} m {'behind' if point < 0.0 else 'ahead of'} that of the other: "
            "their speeds differ too little to tell"
        )
    usual = abs(delay) <= USUAL
    late = delay > 0.0 and source == "sd" and not point
    severity: Severity = "error" if not usual else "note" if late else "warning"
    return found(
        "CLOCK_OFFSET", source, name, span, delay, "s", text, limit=LATENCY, severity=severity,
        repair="" if severity == "note" or point else None, details={"shift": -delay},
    )  # fmt: skip


def _stamped(table: CheckedTable, track: Track, delay: float) -> bool:
    """Whether the track's stamps lie off those of the table's other objects as this delay would have it."""
    others = [k for k in table.tracks if k.id != track.id and len(k) > 1]
    if not others or abs(delay) < 0.5 * table.step:
        return False
    grid = np.unique(np.concatenate([k.t for k in others]))
    near = np.clip(np.searchsorted(grid, track.t), 1, len(grid) - 1)
    away = np.minimum(np.abs(track.t - grid[near]), np.abs(track.t - grid[near - 1]))
    within = (track.t >= grid[0]) & (track.t <= grid[-1])
    if within.any() and float(np.median(away[within])) > 0.05 * table.step:
        return True
    tolerance = max(1.5 * table.step, 0.5 * abs(delay))
    return bool(
        (abs(track.t[-1] - grid[-1] - delay) < tolerance and track.t[-1] > grid[-1] + 0.5 * table.step)
        or (abs(track.t[0] - grid[0] - delay) < tolerance and track.t[0] < grid[0] - 0.5 * table.step)
    )
