"""What positions alone say of a motion: their noise, whether it stands, and the way that it takes."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats, wrap_angle

Complexes = NDArray[np.complex128]

STANDS = 5.0
"""Times its noise that positions may lie off their middle while it stands."""
STATION = 6.0
"""Times its noise that a position has to be from the one before it to tell a direction: 0.24 rad."""
AVERAGED = 0.4
"""Time [s] over which positions are averaged before a direction is asked for."""
LEAST = 0.02
"""Distance [m] that is no motion, whatever the noise."""
MISFIT, NEAR = 6.0, 0.1
"""Times its noise, and distance [m], that a position may lie off a trace that describes it."""
SPREAD, CLOSE = 1.8, 0.05
"""Times its noise (1.4 if the trace is the truth), and distance [m], that all positions of who pauses may lie off."""
PAUSE = 1.0
"""Time [s] without a direction from which on somebody pauses."""
_RAYLEIGH = 1.1774
"""Median of the length of a vector whose two components have the standard deviation 1."""


def position_noise(t: Floats, place: Complexes) -> float:
    """Give the standard deviation [m] of each coordinate's noise, of positions x + iy (T,) at times t (T,) [s].

    By third divided differences, in which steady accelerations vanish; noise that varies slowly is not seen. 0 with
    fewer than four samples.
    """
    if len(t) < 4:
        return 0.0
    times = np.stack([t[k : len(t) - 3 + k] for k in range(4)])
    weights = np.stack(
        [1.0 / np.prod([times[k] - times[j] for j in range(4) if j != k], axis=0) for k in range(4)]
    )
    rest = sum(weights[k] * place[k : len(t) - 3 + k] for k in range(4))
    return float(np.median(np.abs(rest) / np.sqrt((weights**2).sum(axis=0)))) / _RAYLEIGH


def beyond_noise(noise: float) -> float:
    """Give the distance [m] of a position from its trace that this noise [m] of each coordinate does not explain."""
    return max(MISFIT * noise, NEAR)


def is_off_trace(distance: Floats, noise: float) -> bool:
    """Say whether distances (T,) [m] of positions from their trace are on the whole more than their noise [m]."""
    return bool(np.sqrt(np.square(distance).mean()) > max(SPREAD * noise, CLOSE))


def has_pause(t: Floats, place: Complexes, noise: float) -> bool:
    """Say whether positions x + iy (T,) [m] tell for a while no direction, so that headings there may be anything."""
    when, _, station = _seen(t, place, noise)
    return bool(np.diff(np.append(when[station], when[-1])).max() > PAUSE)


def is_standing(place: Complexes, noise: float) -> bool:
    """Say whether positions x + iy (T,) [m] with this noise [m] are those of somebody who does not move."""
    middle = np.median(place.real) + 1j * np.median(place.imag)
    return bool(np.abs(place - middle).max() <= max(STANDS * noise, LEAST))


def mean_heading(heading: Floats) -> float:
    """Give the heading [rad] about which headings (T,) lie, by their directions' mean."""
    return float(np.angle(np.exp(1j * heading).mean()))


def signed_motion(t: Floats, place: Complexes, heading: Floats, noise: float) -> tuple[Floats, Floats]:
    """Give heading (T,) [rad, unwrapped] and signed speed (T,) [m/s] of the way between positions x + iy (T,) [m].

    Directions are those between stations, positions farther from each other than noise explains: between two whose
    directions differ by more than a right angle it begins to drive the other way, as no vehicle turns on the spot.
    Whether it drives forwards is said by the measured headings (T,), of all the way together.
    """
    when, where, station = _seen(t, place, noise)
    if len(station) < 2:
        return np.full(len(t), mean_heading(heading)), np.zeros(len(t))
    chord, lasts = np.diff(where[station]), np.diff(when[station])
    course = np.angle(chord)
    turns = np.abs(wrap_angle(np.diff(course))) > 0.5 * np.pi
    sign = np.cumprod(np.concatenate([[1.0], np.where(turns, -1.0, 1.0)]))
    measured = np.array([np.exp(1j * heading[a : b + 1]).mean() for a, b in pairwise(station)])
    if float((sign * (chord * measured.conj()).real).sum()) < 0.0:
        sign = -sign
    ahead = np.unwrap(np.where(sign > 0.0, course, course + np.pi))
    middle = 0.5 * (when[station[:-1]] + when[station[1:]])
    return np.interp(t, middle, ahead), np.interp(t, middle, sign * np.abs(chord) / lasts)


def _seen(t: Floats, place: Complexes, noise: float) -> tuple[Floats, Complexes, list[int]]:
    """Times and positions, averaged, and which of them are stations."""
    half = int(0.5 * AVERAGED / float(np.median(np.diff(t))))
    when, where = _averaged(t, half).real, _averaged(place, half)
    return when, where, _stations(where, max(STATION * noise / np.sqrt(2 * half + 1), LEAST))


def _averaged(values: NDArray[Any], half: int) -> Complexes:
    """The centred mean over 2 half + 1 samples, over as many to both sides as there are at the ends."""
    sums = np.concatenate([[0.0], np.cumsum(values - values[0])])
    k = np.arange(len(values))
    reach = np.minimum(half, np.minimum(k, len(values) - 1 - k))
    return np.asarray((sums[k + reach + 1] - sums[k - reach]) / (2 * reach + 1) + values[0], dtype=complex)


def _stations(place: Complexes, far: float) -> list[int]:
    """The first position, and each that is farther than so [m] from the station before it."""
    out = [0]
    for k in range(1, len(place)):
        if abs(place[k] - place[out[-1]]) > far:
            out.append(k)
    return out
