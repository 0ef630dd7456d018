"""Agreement of SD and GT: clocks, reference points, and sensor objects that are nobody."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from resim.check.codes import Found, found
from resim.check.derived import motion
from resim.check.tracks import Table, Track
from resim.core.finding import Severity, Source
from resim.core.geometry import Floats

BIN = 1.0
"""Time [s] over which offsets are taken in the median: white noise goes, slow sensor errors stay."""
SLOW_ERROR = 0.5
"""Slowly varying position error of a sensor [m]: 0.25 in Wagner 2021, Section 5.2.1, more at Mcity."""
LONG = 3.0
"""Time [s] that an object is seen before its delay can be said to grow."""
CONSTANT = 1.5
"""Constant position error of a sensor [m] that is usual."""
DELAY, DRIFT = 2.0, 1.0
"""Delays and drifts over the recording [s] that are looked for, one standard deviation."""
LATENCY = 0.05
"""Delay [s] from which on it is worth a note, where it is sure."""
USUAL = 0.3
"""Delay [s] that sensors have; with more, stamps are wrong."""
DRIFTED = 0.12
"""Growth of the delay [s] over the recording that no sensor has: 3 m at 25 m/s."""
SURE = 3.0
"""Standard deviations by which a delay differs from none."""
DRIVES = 3.0
"""Speed [m/s] from which on a delay shows in the positions."""
POINT = 0.35
"""Distance [m] by which an offset misses the half length or width and still is it."""
FIXED = 0.35
"""Spread [m] (scaled median deviation) of an offset that is a point of the vehicle."""
SIDE = 0.6
"""Offset [m] across the box from which on a corner is asked for: a car's half width less the noise."""
CLEAR = 1.0
"""Offset [m] along the box from which on a reference point is asked for: Mcity's sensor is 1.1 m off at most."""
MISTAKEN = 0.3
"""Part of its distance from the object that it names at which an SD object lies on another."""
APART = 10.0
"""Median distance [m] from the GT object that an SD object names, beyond which it is another."""


@dataclass(frozen=True, eq=False)
class Pair:
    """An SD object beside its GT at K common times: t (K,) s, offset (K,) m SD less GT, in GT's own frame (x ahead,
    y left), v (K,) m/s."""

    sd: Track
    gt: Track
    t: Floats
    along: Floats
    across: Floats
    v: Floats


@dataclass(frozen=True)
class Delay:
    """Delay [s] of SD, its standard deviation, its growth over the recording [s] and that one's deviation;
    left [m]: spread of the offsets that it does not explain."""

    delay: float
    spread: float
    drift: float
    drift_spread: float
    left: float


def pairs(gt: Table, sd: Table) -> list[Pair]:
    """Give every SD object that has GT at common times."""
    truth = {k.id: k for k in gt.tracks}
    named = [(k, truth[name]) for k in sd.tracks if (name := sd.gt_id.get(k.id, "")) in truth]
    return [pair for track, own in named if (pair := _beside(track, own)) is not None]


def _beside(track: Track, own: Track, shift: float = 0.0) -> Pair | None:
    """The SD track, its times shifted [s], beside its GT; None with fewer than three common times."""
    t = track.t + shift
    there = (t >= own.t[0]) & (t <= own.t[-1])
    if len(own) < 2 or there.sum() < 3:
        return None
    t = t[there]
    off = track.p[there] - np.interp(t, own.t, own.p)
    off = off * np.exp(-1j * np.interp(t, own.t, own.heading))
    return Pair(track, own, t, off.real, off.imag, np.interp(t, own.t, own.v))


def misnamed(gt: Table, known: list[Pair]) -> tuple[list[Pair], list[Found]]:
    """Give the pairs that are one object, and findings of SD objects that lie on another one than they name."""
    right, out = [], []
    for pair in known:
        far = float(np.median(np.hypot(pair.along, pair.across)))
        others = [p for k in gt.tracks if k.id != pair.gt.id and (p := _beside(pair.sd, k)) is not None]
        nearest = min(others, key=lambda p: float(np.median(np.hypot(p.along, p.across))), default=None)
        near = np.inf if nearest is None else float(np.median(np.hypot(nearest.along, nearest.across)))
        if nearest is None or near > min(MISTAKEN * far, CONSTANT + CLEAR):
            right.append(pair)
            continue
        text = (
            f"is named {pair.gt.id!r} of GT, {far:.1f} m away, and lies on {nearest.gt.id!r} ({near:.1f} m)"
        )
        span = (float(pair.t[0]), float(pair.t[-1]))
        out.append(
            found("SD_WITHOUT_GT", "sd", pair.sd.id, span, far, "m", text, limit=CONSTANT, severity="error")
        )
    return right, out


def delay_of(pair: Pair) -> Delay | None:
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
        if abs(fit[1]) < 0.01 or (later := _beside(pair.sd, pair.gt, -delay)) is None:
            break
        now = later
    spread = np.sqrt(np.diag(covariance))
    return Delay(delay, float(spread[1]), float(fit[2]), float(spread[2]), left)


def _binned(pair: Pair) -> tuple[Floats, Floats, Floats]:
    """Offset ahead [m], speed and time of each bin, in the median."""
    number = np.floor((pair.t - pair.t[0]) / BIN).astype(int)
    edges = np.flatnonzero(np.diff(number)) + 1
    parts = [np.split(values, edges) for values in (pair.along, pair.v, pair.t)]
    e, v, t = (np.array([np.median(part) for part in values]) for values in parts)
    return e, v, t


def clocks(gt: Table, sd: Table, known: list[Pair]) -> tuple[list[Found], set[str]]:
    """Give drift and delay between the clocks, or of single objects; and the SD objects that these explain."""
    fits = {p.sd.id: fit for p in known if (fit := delay_of(p)) is not None}
    if not fits:
        return [], set()
    by_id = {p.sd.id: p for p in known}
    long = [f for n, f in fits.items() if by_id[n].t[-1] - by_id[n].t[0] >= LONG]
    if long:
        drifts = np.array([f.drift for f in long])
        noise = np.array([f.drift_spread for f in long])
        drift = float(np.average(drifts, weights=noise**-2.0))
        agree = np.abs(drifts - drift) < np.maximum(0.4 * abs(drift), SURE * noise)
        if abs(drift) > max(DRIFTED, SURE * float(noise.min())) and agree.all():
            longest = max(known, key=lambda p: p.t[-1] - p.t[0])
            span = (float(longest.t[0]), float(longest.t[-1]))
            source = _whose_clock(gt, sd, drift / (span[1] - span[0]))
            if source != "recording" or (len(long) > 1 and abs(drift) > 2.0 * DRIFTED):
                return [_drifting(source, span, drift)], set(fits)
    return _offsets(gt, sd, fits, by_id)


def _drifting(source: Source, span: tuple[float, float], drift: float) -> Found:
    text = f"the delay of SD against GT grows by {drift:+.3f} s from {span[0]:.2f} to {span[1]:.2f} s"
    known = source != "recording"
    return found(
        "CLOCK_DRIFT", source, "", span, drift, "s", text + (f", and the speeds of {source} with it" if known else ""),
        limit=DRIFTED, repair=None if known else "",
    )  # fmt: skip


def _offsets(
    gt: Table, sd: Table, fits: dict[str, Delay], by_id: dict[str, Pair]
) -> tuple[list[Found], set[str]]:
    """The delay that all share, else those of single objects."""
    delays = np.array([f.delay for f in fits.values()])
    spreads = np.array([f.spread for f in fits.values()])
    common = float(np.average(delays, weights=spreads**-2.0))
    allowed = np.maximum(max(0.1, 0.2 * abs(common)), 2.0 * spreads)
    if len(fits) > 1 and (np.abs(delays - common) < allowed).all() and _sure(common, float(spreads.min())):
        return [_delayed("sd", "", sd.span, common, "all its objects")], set(fits)
    out, explained = [], set()
    for name, fit in fits.items():
        pair = by_id[name]
        shifted = _stamped(gt, pair.gt, -fit.delay), _stamped(sd, pair.sd, fit.delay)
        if not any(shifted) and (_is_point(pair) or not _sure(fit.delay, fit.spread)):
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


def _delayed(source: Source, name: str, span: tuple[float, float], delay: float, who: str) -> Found:
    when = "late" if delay > 0.0 else "early"
    text = f"{who} comes {abs(delay):.2f} s too {when} against the other source"
    usual = abs(delay) <= USUAL
    severity: Severity = "error" if not usual else "note" if delay > 0.0 and source == "sd" else "warning"
    return found("CLOCK_OFFSET", source, name, span, delay, "s", text, limit=LATENCY, severity=severity)


def _stamped(table: Table, track: Track, delay: float) -> bool:
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


def _whose_clock(gt: Table, sd: Table, rate: float) -> Source:
    """The source whose speeds are off its positions by the rate of the drift; "recording" where none is."""
    off: dict[Source, float] = {}
    for table, expected in ((gt, -rate), (sd, rate)):
        ratios = []
        for track in table.tracks:
            m = motion(track, table.step)
            fast = np.abs(m.moved) > DRIVES
            if fast.sum() > 5:
                ratios.append(float(np.median(np.abs(m.told[fast]) / np.abs(m.moved[fast]))))
        off[table.source] = float(np.min(np.abs(np.array(ratios) - 1.0 - expected))) if ratios else np.inf
    best = min(off, key=lambda s: off[s])
    return best if off[best] < 0.4 * abs(rate) else "recording"


def _is_point(pair: Pair, peers: float = 0.0) -> bool:
    """Whether the offset is constant, and at a front, a rear or a corner of the box.

    peers: offset ahead [m] that other objects of the sensor have as well.
    """
    along, across = float(np.median(pair.along)), float(np.median(pair.across))
    for values, middle in ((pair.along, along), (pair.across, across)):
        if 1.4826 * float(np.median(np.abs(values - middle))) > FIXED:
            return False
    half, side = 0.5 * pair.gt.length, abs(abs(across) - 0.5 * pair.gt.width)
    if abs(abs(along - peers) - half) < POINT and peers != 0.0 and min(abs(across), side) < POINT:
        return True
    if (
        max(half - POINT, CLEAR) < abs(along) < half + CONSTANT + 2.0 * POINT
        and min(abs(across), side) < POINT
    ):
        return True
    at_side = side < POINT and abs(across) > SIDE
    return at_side and abs(abs(along) - half) < CONSTANT + POINT


def _peers(pair: Pair, known: list[Pair], ego: str) -> float:
    """Offset ahead [m] that other objects of the sensor share, 0 where that is not known."""
    others = [float(np.median(p.along)) for p in known if p is not pair and p.gt.id != ego]
    if len(others) < 2 or pair.gt.id == ego or np.ptp(others) > 2.0 * POINT:
        return 0.0
    return float(np.median(others))


def reference_points(known: list[Pair], explained: set[str], ego: str) -> Iterator[Found]:
    """Give SD objects that lie by a constant offset of half a box off their GT; either may be the wrong one."""
    for pair in known:
        if pair.sd.id in explained or not _is_point(pair, _peers(pair, known, ego)):
            continue
        along, across = float(np.median(pair.along)), float(np.median(pair.across))
        corner = abs(abs(across) - 0.5 * pair.gt.width) < abs(across)
        text = (
            f"SD is {along:+.2f} m ahead and {across:+.2f} m left of GT throughout, half the box is "
            f"{0.5 * pair.gt.length:.2f} x {0.5 * pair.gt.width:.2f} m: one of the two names its "
            f"{'front' if along > 0.0 else 'rear'} {'corner' if corner else 'bumper'}, or SD is "
            f"{-along / max(float(np.median(pair.v)), 0.1):.2f} s late"
        )
        yield found(
            "REFERENCE_POINT", "recording", pair.sd.id, (float(pair.t[0]), float(pair.t[-1])),
            abs(complex(along, across)), "m", text, limit=0.5 * pair.gt.length,
        )  # fmt: skip


def strangers(sd: Table, known: list[Pair], explained: set[str], parts: set[str]) -> Iterator[Found]:
    """Give SD objects without GT, together where they are many, and those far from the GT that they name.

    explained: SD ids whose distance a clock explains; parts: ids under which broken tracks go on.
    """
    nobody = [k for k in sd.tracks if not sd.gt_id.get(k.id, "") and k.id not in parts]
    names = list(dict.fromkeys(k.id for k in nobody))
    if len(names) > 3:
        some = ", ".join(names[:5]) + ", ..."
        text = f"{len(names)} of {len({k.id for k in sd.tracks})} objects have no ground truth: {some}"
        yield found("SD_WITHOUT_GT", "sd", "", sd.span, len(names), "objects", text, limit=1.0)
    else:
        for name in names:
            own = [k for k in nobody if k.id == name]
            text = f"no ground truth is named for it ({sum(map(len, own))} samples)"
            span = (own[0].t[0], own[-1].t[-1])
            yield found("SD_WITHOUT_GT", "sd", name, span, sum(map(len, own)), "samples", text, limit=1.0)
    for pair in known:
        far = float(np.median(np.hypot(pair.along, pair.across)))
        if far > APART and pair.sd.id not in explained:
            text = f"is named {pair.gt.id!r} of the ground truth, and is {far:.1f} m from it in the median"
            yield found(
                "SD_WITHOUT_GT",
                "sd",
                pair.sd.id,
                (float(pair.t[0]), float(pair.t[-1])),
                far,
                "m",
                text,
                limit=APART,
                severity="error",
            )
