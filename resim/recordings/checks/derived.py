"""What the positions say of the motion, over a window, beside what speed and heading say over the same."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resim.core.geometry import Floats
from resim.recordings.checks.tracks import Complex, Track

WINDOW = 0.8
"""Time [s] over which motion is compared: 0.1 m of position noise are then under 0.2 m/s."""
SMOOTHING = 0.2
"""Time [s] over which the positions at both ends are averaged."""
FEWEST = 5
"""Samples that a comparison needs."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Velocity at K window centres t (K,) s: moved (K,), by the positions; told (K,), by speed and heading [m/s].

    turn: (K,) rad/s, rate of the heading over the window.
    """

    t: Floats
    moved: Complex
    told: Complex
    turn: Floats


def motion(track: Track, step: float) -> Motion:
    """Compare the way over each window with the integral of speed along heading over it, exact on curves.

    Windows that hold a hole are left out. Gives no windows where the track is too short.
    """
    half = max(round(0.5 * WINDOW / step), 1)
    if len(track) < max(2 * half + 1, FEWEST):
        half = max((len(track) - 1) // 2, 0)
    if half == 0 or len(track) < FEWEST:
        nothing = np.zeros(0)
        return Motion(nothing, nothing.astype(complex), nothing.astype(complex), nothing)
    velocity, dt = track.velocity(), np.diff(track.t)
    way = np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * dt)])
    # what is left of the positions when the told way is taken off varies slowly: it can be averaged
    rest = _averaged(track.p - way, max(round(0.5 * SMOOTHING / step), 0))
    a, b = np.arange(len(track) - 2 * half), np.arange(2 * half, len(track))
    lasts = track.t[b] - track.t[a]
    whole = lasts < 1.5 * 2 * half * step
    told = (way[b] - way[a]) / lasts
    moved = told + (rest[b] - rest[a]) / lasts
    turn = (track.heading[b] - track.heading[a]) / lasts
    return Motion(track.t[half : len(track) - half][whole], moved[whole], told[whole], turn[whole])


def _averaged(values: Complex, half: int) -> Complex:
    """The centred mean over 2 half + 1 samples, of fewer at the ends."""
    sums = np.concatenate([[0.0], np.cumsum(values)])
    k = np.arange(len(values))
    a, b = np.maximum(k - half, 0), np.minimum(k + half + 1, len(values))
    return np.asarray((sums[b] - sums[a]) / (b - a))
