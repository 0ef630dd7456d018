"""Motion: speed and heading against the positions, and what no vehicle can do."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from resim.core.geometry import Bools, Floats, unwrap_angle, wrap_angle
from resim.recordings.checks.codes import RankedFinding, found
from resim.recordings.checks.derived import WINDOW, Motion, motion
from resim.recordings.checks.tracks import PEDESTRIAN, CheckedTable, Complex, Track, runs

SPEED_RUN, SPEED_SHARE = 0.5, 0.01
"""Difference of speeds [m/s], and part of the speed, beyond which it must not stay for RUN."""
SPEED_BIAS, BIAS_SHARE = 0.3, 0.03
"""Median difference [m/s], and part of the speed, that a whole track may have."""
RUN = 0.4
"""Time [s] that a difference lasts before it is no noise."""
HEADING_RUN, HEADING_BIAS = 0.1, 0.035
"""Difference of heading and course [rad], for RUN and in the median: 2 degrees over a whole track."""
LEAP = 0.1
"""Change of heading [rad] in one step that no skid has, unless all steps are like it."""
POSITION_NOISE = 0.15
"""Noise of the way over a window [m]: turns the course of slow objects."""
FAST = 2.0
"""Speed [m/s] from which on there is a course."""
DELAYS = 2.0
"""Longest delay [s] that is looked for."""
EXPLAINS = 0.5
"""Part of the difference that may be left when a delay explains it."""
STEADY = 0.2
"""Time [s] over which acceleration and yaw rate are taken: shorter peaks are noise and move nothing."""
STRONGEST = {"pedestrian": 8.0, "bicycle": 8.0, "truck": 11.0, "bus": 11.0, "trailer": 11.0}
STRONGEST_VEHICLE = 13.0
"""Acceleration [m/s²] that none reaches: the best tyres brake at 11, trucks at 8, men and bicycles at 6."""
LATERAL = 14.0
"""Lateral acceleration [m/s²] that none reaches."""
NOISE = 6.0
"""Times the usual yaw rate of its own track by which one has to exceed the limit."""
SHOWN = 0.5
"""Part of the change that the positions show over a window when the object really did it."""
REVERSES = 8.0
"""Speed [m/s] from which on nobody drives backwards, and a heading against the course is turned."""
TURNING = 2.0
"""Yaw rate [rad/s] that no vehicle has at any speed at which it can turn."""


def speed(table: CheckedTable) -> Iterator[RankedFinding]:
    """Give, per object, the worst disagreement of speed and positions, with the delay that would explain it."""
    for track in table.tracks:
        m = motion(track, table.step)
        if not len(m.t):
            continue
        off = np.abs(m.told) - np.abs(m.moved)
        if track.kind == PEDESTRIAN:
            off = np.interp(m.t, track.t, np.abs(track.v)) - np.abs(m.moved)
        size = np.abs(m.moved)
        bad = np.abs(off) > SPEED_RUN + SPEED_SHARE * size
        span = _worst_run(bad, m.t, off, RUN - 0.5 * table.step)
        bias = float(np.median(off))
        lasting = span is not None
        biased = (
            abs(bias) > SPEED_BIAS + BIAS_SHARE * float(np.median(size)) and len(m.t) * table.step > WINDOW
        )
        if not lasting and not biased:
            continue
        if lasting and span is not None:
            within = (m.t >= span[0]) & (m.t <= span[1])
            value = float(off[within][np.argmax(np.abs(off[within]))])
        else:
            span, value = (float(m.t[0]), float(m.t[-1])), bias
        text = f"its speed is up to {value:+.2f} m/s off its positions, {bias:+.2f} m/s in the median"
        delay, left = _delay(m.t, np.abs(m.told), np.abs(m.moved))
        text, repair = _explained(text, delay, left, "m/s")
        limit = SPEED_RUN if lasting else SPEED_BIAS
        late = (
            table.source == "sd" and delay > 0.0 and left < SPEED_RUN
        )  # so is the sensor: there is no fault
        yield found(
            "SPEED_DISAGREES", table.source, track.id, span, value, "m/s", text, limit=limit,
            severity="note" if late else None, repair="" if late else repair,
        )  # fmt: skip


def heading(table: CheckedTable) -> Iterator[RankedFinding]:
    """Give, per vehicle, the worst disagreement of heading and course, with the delay that would explain it."""
    for track in table.tracks:
        m = motion(track, table.step)
        fast = (np.abs(m.moved) > FAST) & (np.abs(m.told) > FAST)
        if track.kind == PEDESTRIAN or not fast.any():
            continue
        t, off = m.t[fast], np.angle(m.told[fast] * np.conj(m.moved[fast]))
        loose = _looseness(track, m)[fast]
        span = _worst_run(np.abs(off) > HEADING_RUN + loose, t, off, RUN - 0.5 * table.step)
        bias = float(np.median(off))
        lasting = span is not None
        biased = abs(bias) > HEADING_BIAS + float(np.median(loose)) and len(t) * table.step > WINDOW
        if not lasting and not biased:
            continue
        if lasting and span is not None:
            within = (t >= span[0]) & (t <= span[1])
            value = float(off[within][np.argmax(np.abs(off[within]))])
        else:
            span, value = (float(t[0]), float(t[-1])), bias
        text = f"its heading is up to {value:+.3f} rad off its course, {bias:+.3f} rad in the median"
        course = unwrap_angle(np.angle(m.moved[fast]))
        delay, left = _delay(t, unwrap_angle(np.angle(m.told[fast])), course)
        if float(np.ptp(course)) < HEADING_RUN:
            delay = 0.0  # a straight course says nothing of when
        text, repair = _explained(text, delay, left, "rad")
        if np.abs(wrap_angle(bias - np.pi)) < 0.3:
            text += "; it drives backwards with a speed above 0, or its heading is turned"
        if abs(wrap_angle(value - np.pi)) < 0.3 and float(np.median(np.abs(m.moved[fast]))) < REVERSES:
            repair = ""
        if lasting and not biased and delay == 0.0 and not _leaps(track, span):
            text, repair = f"{text}; or it is right, and it skids", ""
        limit = HEADING_RUN if lasting else HEADING_BIAS
        yield found(
            "HEADING_DISAGREES", table.source, track.id, span, value, "rad", text, limit=limit, repair=repair
        )


def _leaps(track: Track, span: tuple[float, float]) -> bool:
    """Whether the heading leaps in one step around the span, as that of nobody who skids does."""
    near = (track.t >= span[0] - WINDOW) & (track.t <= span[1] + WINDOW)
    steps = np.abs(np.diff(track.heading[near]))
    return bool(len(steps) and steps.max() > max(LEAP, 3.0 * float(np.median(steps))))


def _worst_run(mask: Bools, t: Floats, off: Floats, lasts: float) -> tuple[float, float] | None:
    """Start and end [s] of the run, of those that last, in which it is farthest off; None where none lasts."""
    every = [(a, b) for a, b in runs(mask) if t[b] - t[a] >= lasts]
    if not every:
        return None
    a, b = max(every, key=lambda run: float(np.abs(off[run[0] : run[1] + 1]).max()))
    return float(t[a]), float(t[b])


def _looseness(track: Track, m: Motion) -> Floats:
    """Angle [rad] that noise of the positions and a box centre off the axle that steers nothing explain."""
    size = np.maximum(np.abs(m.moved), 0.1)
    return np.asarray(POSITION_NOISE / (WINDOW * size) + 0.5 * track.length * np.abs(m.turn) / size)


def _delay(t: Floats, told: Floats, moved: Floats) -> tuple[float, float]:
    """The delay [s] of what is told that explains most, and the rms that is left; 0 where it explains too little."""
    if len(t) < 5 or np.ptp(moved) < 1e-9:
        return 0.0, np.nan
    step = float(np.median(np.diff(t)))
    rms0 = float(np.sqrt(np.mean((told - moved) ** 2)))
    best, left = 0.0, rms0
    for delay in np.arange(-DELAYS, DELAYS + 1e-9, max(step, 0.04)):
        both = (t + delay >= t[0]) & (t + delay <= t[-1])
        if both.sum() < max(5, 0.6 * len(t)):
            continue
        off = np.interp(t[both] + delay, t, told) - moved[both]
        rms = float(np.sqrt(np.mean(off**2)))
        if rms < left:
            best, left = float(delay), rms
    return (best, left) if left < EXPLAINS * rms0 and abs(best) > step else (0.0, rms0)


def _explained(text: str, delay: float, left: float, unit: str) -> tuple[str, str | None]:
    if delay == 0.0:
        return text, None
    when = "late" if delay > 0.0 else "early"
    return f"{text}; {abs(delay):.2f} s {when} would explain it ({left:.2g} {unit} left)", None


class _Rates(NamedTuple):
    """Accelerations [m/s²] or yaw rates [rad/s] at times [s], and the most that somebody reaches; (K,) each."""

    t: Floats
    value: Floats
    most: Floats


def limits(table: CheckedTable) -> Iterator[RankedFinding]:
    """Give, per object, acceleration and yaw rate that none of its kind reaches."""
    for track in table.tracks:
        m = motion(track, table.step)
        if len(m.t) < 3:
            continue
        most = STRONGEST.get(track.kind, STRONGEST_VEHICLE)
        t, a, _ = _rates(track, track.v, STEADY, table.step)
        rates = _Rates(t, a, np.full(len(t), most))
        yield from _beyond(table, track, "ACCELERATION", rates, _shown(m, np.abs))
        if track.kind == PEDESTRIAN:
            continue
        for over in (0.5 * STEADY, STEADY):
            t, rate, v = _rates(track, track.heading, over, table.step)
            noise = 1.4826 * NOISE * float(np.median(np.abs(rate - np.median(rate)))) if len(rate) else 0.0
            may = np.minimum(TURNING, LATERAL / np.maximum(v, 0.1) + 0.15) + noise
            yield from _beyond(table, track, "YAW_RATE", _Rates(t, rate, may), _shown(m, _course))


def _shown(m: Motion, part: Callable[[Complex], Floats]) -> tuple[Floats, Floats, Floats]:
    """Times, and speed or course by the positions and as told."""
    return m.t, part(m.moved), part(m.told)


def _rates(track: Track, values: Floats, over: float, step: float) -> tuple[Floats, Floats, Floats]:
    """Times [s], rates of change of the values over so long [s], and the larger speed [m/s] at their ends."""
    hop = min(max(round(over / step), 1), len(track) - 1)
    dt = track.t[hop:] - track.t[:-hop]
    whole = dt < 1.5 * hop * step
    v = np.maximum(np.abs(track.v[hop:]), np.abs(track.v[:-hop]))
    return (
        (0.5 * (track.t[hop:] + track.t[:-hop]))[whole],
        (values[hop:] - values[:-hop])[whole] / dt[whole],
        v[whole],
    )


def _beyond(
    table: CheckedTable, track: Track, code: str, rates: _Rates, shown: tuple[Floats, Floats, Floats]
) -> Iterator[RankedFinding]:
    """The finding where a rate exceeds the most; its own where the positions show a good part of it."""
    t, value, most = rates
    over = np.abs(value) > most
    if not over.any():
        return
    k = int(np.argmax(np.where(over, np.abs(value) / most, 0.0)))
    spans = runs(over)
    verb, unit = ("accelerates by", "m/s²") if code == "ACCELERATION" else ("turns at", "rad/s")
    text = f"{verb} {value[k]:+.3g} {unit} at {t[k]:.2f} s (none reaches {most[k]:.3g}), {len(spans)} time(s)"
    moved, told = (
        np.diff(np.interp([t[k] - 0.6 * WINDOW, t[k] + 0.6 * WINDOW], shown[0], c))[0] for c in shown[1:]
    )
    own = bool(told * value[k] > 0.0 and moved / told > SHOWN)
    span = (t[spans[0][0]], t[spans[-1][1]])
    repair = "" if own else None  # the positions show it: it is no spike
    yield found(
        code, table.source, track.id, span, value[k], unit, text, limit=float(most[k]), own=own, repair=repair
    )


def _course(velocity: Complex) -> Floats:
    return np.asarray(np.unwrap(np.angle(velocity)))
