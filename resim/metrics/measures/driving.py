"""How it feels inside: acceleration and jerk along tracks, without making noise louder than the window lets through."""

from __future__ import annotations

import numpy as np

from resim.core.clock import TICK
from resim.core.geometry import Bools, Floats, unwrap_angle
from resim.core.tracks import Tracks
from resim.metrics.measures.definition import MeasureDefinition
from resim.metrics.measures.values import MeasureValues, State

WINDOW = 0.5  # s
LOPSIDED = (
    0.05  # share of the window that the mean time of its samples may lie off its middle: one may be missing
)
LEAST = 3  # samples in a window


LONGITUDINAL_ACCELERATION = MeasureDefinition(
    name="longitudinal acceleration",
    unit="m/s²",
    worst="both",
    kind="quantitative",
    source="ISO 15622 (adaptive cruise control), which limits it",
    meaning="of the EGO; forward is positive",
    own=lambda tracks, network: longitudinal_acceleration(tracks),
    alone=True,
)


def longitudinal_acceleration(tracks: Tracks, *, window: float = WINDOW) -> MeasureValues:
    """Give dv/dt (N, T) [m/s²], forward positive: as measured (`tracks.a`), else `slope` of v over `window` [s].

    NOT_DEFINED where the window is not filled (ends of a track, gaps); NOT_COMPUTED where there is no sample.
    """
    if tracks.a is not None:
        return _values(LONGITUDINAL_ACCELERATION, tracks.a, tracks.valid)
    return _values(LONGITUDINAL_ACCELERATION, slope(tracks.t, tracks.v, window=window), tracks.valid)


LATERAL_ACCELERATION = MeasureDefinition(
    name="lateral acceleration",
    unit="m/s²",
    worst="both",
    kind="quantitative",
    source="UN regulation 79 (steering), which limits it",
    meaning="of the EGO; left is positive",
    own=lambda tracks, network: lateral_acceleration(tracks),
    alone=True,
)


def lateral_acceleration(tracks: Tracks, *, window: float = WINDOW) -> MeasureValues:
    """Give v dheading/dt (N, T) [m/s²], to the left positive; sideslip left out. States as above.

    The yaw rate is as measured (`tracks.yaw_rate`), else the `slope` of the heading over `window` [s].
    """
    return _values(LATERAL_ACCELERATION, _lateral(tracks, window), tracks.valid)


LONGITUDINAL_JERK = MeasureDefinition(
    name="longitudinal jerk",
    unit="m/s³",
    worst="both",
    kind="quantitative",
    source="ISO 15622 (adaptive cruise control), which limits it",
    meaning="of the EGO; forward is positive",
    own=lambda tracks, network: longitudinal_jerk(tracks),
    alone=True,
)


def longitudinal_jerk(tracks: Tracks, *, window: float = WINDOW) -> MeasureValues:
    """Give d²v/dt² (N, T) [m/s³]: the `slope` over `window` [s] of the longitudinal acceleration. States as above.

    Where no acceleration was measured two windows stand in a row: 1 s of v with the default.
    """
    a = longitudinal_acceleration(tracks, window=window).value
    return _values(LONGITUDINAL_JERK, slope(tracks.t, a, window=window), tracks.valid)


LATERAL_JERK = MeasureDefinition(
    name="lateral jerk",
    unit="m/s³",
    worst="both",
    kind="quantitative",
    source="UN regulation 79 (steering), which limits it",
    meaning="of the EGO; left is positive",
    own=lambda tracks, network: lateral_jerk(tracks),
    alone=True,
)


def lateral_jerk(tracks: Tracks, *, window: float = WINDOW) -> MeasureValues:
    """Give the `slope` over `window` [s] of the lateral acceleration (N, T) [m/s³]. States as above."""
    a = _lateral(tracks, window)
    return _values(LATERAL_JERK, slope(tracks.t, a, window=window), tracks.valid)


def slope(t: Floats, y: Floats, *, window: float) -> Floats:
    """Give dy/dt (N, T): the slope of the straight line of least squares through the samples within window / 2 of each.

    Exact for parabolas where samples lie evenly on both sides. Noise of standard deviation s, sampled every dt, comes
    out as about s sqrt(12 dt / window³). NaN with under 3 samples in the window, or more on one side than on the other.
    t: (T,) s; y: (N, T), NaN where unknown.
    """
    y = np.asarray(y, dtype=float)
    known, half, n = np.isfinite(y), 0.5 * window + TICK, len(t)
    most = int((np.searchsorted(t, t + half, side="right") - np.arange(n)).max(initial=1)) - 1
    count, st, sy, stt, sty = (np.zeros_like(y) for _ in range(5))
    for k in range(-most, most + 1):
        i = np.arange(max(0, -k), min(n, n - k))
        dt = t[i + k] - t[i]
        use = (np.abs(dt) <= half) & known[:, i + k] & known[:, i]
        dy = np.where(use, y[:, i + k] - y[:, i], 0.0)
        dt = np.where(use, dt, 0.0)
        count[:, i] += use
        st[:, i] += dt
        sy[:, i] += dy
        stt[:, i] += dt * dt
        sty[:, i] += dt * dy
    spread = count * stt - st * st
    good = (count >= LEAST) & (np.abs(st) <= LOPSIDED * window * count) & (spread > 0.0)
    return np.where(good, (count * sty - st * sy) / np.where(good, spread, 1.0), np.nan)


def yaw_rate(tracks: Tracks, *, window: float = WINDOW) -> Floats:
    """Give the yaw rate (N, T) [rad/s] as measured, else the `slope` of the heading, NaN where no window is filled."""
    if tracks.yaw_rate is not None:
        return tracks.yaw_rate
    return slope(tracks.t, unwrap_angle(tracks.heading), window=window)


def _lateral(tracks: Tracks, window: float) -> Floats:
    return np.asarray(tracks.v * yaw_rate(tracks, window=window))


def _values(of: MeasureDefinition, value: Floats, valid: Bools) -> MeasureValues:
    """Both signs are uncomfortable: the worst is the strongest in either direction."""
    state = np.where(np.isfinite(value), State.VALUE, State.NOT_DEFINED)
    state = np.where(valid, state, State.NOT_COMPUTED).astype(np.uint8)
    return of.values(np.where(state == State.VALUE, value, np.nan), state)
