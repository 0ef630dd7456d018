"""Slopes and limits of noisy values: over as many samples as their own noise asks for.

Wagner's threshold of 0.03 m/s means nothing to positions with 0.1 m of noise, differenced at 25 Hz: they fall below it
in 0.7 % of samples. So noise is measured, of each piece of a track by its own fourth differences, in which motion is
next to nothing, and the line is through as many samples as bring the slope's standard deviation down to a precision:
clean data get three samples, and keep their moments exactly; noisy ones up to LONGEST to each side. Noise that lasts
longer than that is motion. So with limits: a distance just above what is required would fall below it in every other
sample. What is held against a limit is read off a cubic (Savitzky and Golay 1964), which follows peaks, and at the ends
of a track goes on to its last sample.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Bools, Floats
from resim.mining.runs import bounds, stretches

LONGEST = 0.75
"""s to each side that a line reaches at most (our choice): over less than who rests for a moment between two lane
changes, and with 5 cm of noise at 25 Hz still to 0.02 m/s."""
FINE, AVERAGED = 0.01, 0.75
"""Standard deviation (of the values' unit) to which values are averaged, and s to each side at most (our choice)."""
DEGREE = 3
EVEN = 1.5
"""Usual steps of time up to which samples follow one another; an average reaches over none that is longer."""
BEYOND = 1.5
"""Standard deviations of an average beyond which it is below a limit, or above it again (our choice: misses and false
labels are as many)."""
FEWEST = 8
"""Samples of which noise can be told."""
NORMAL = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""


def slope(t: Floats, values: Floats, piece: NDArray[np.integer], precision: float) -> Floats:
    """Give the slopes (K,) of values (K,) over t (K,) [s], to a standard deviation of about `precision` [1/s].

    piece (K,): what belongs together, in order. NaN in pieces of one sample.
    """
    # compiled: numba is imported where it is used only
    from resim.mining import kernel

    if not len(t):
        return np.zeros(0)
    first = bounds(piece)
    half = half_widths(t, values, first, precision)
    return np.asarray(kernel.slopes(t - t[0], values, first, half))


def half_widths(
    t: Floats, values: Floats, first: NDArray[np.integer], precision: float
) -> NDArray[np.integer]:
    """Give to how many samples (P,) on each side a line has to reach in each piece.

    A line through n samples dt apart with noise sigma has a slope with the standard deviation sigma sqrt(12 / n³) / dt.
    """
    half = np.ones(len(first) - 1, dtype=np.intp)
    for p, (low, high) in enumerate(zip(first[:-1].tolist(), first[1:].tolist(), strict=True)):
        if high - low < FEWEST:
            continue
        sigma = _noise(values[low:high])
        dt = float(np.median(np.diff(t[low:high])))
        wanted = np.cbrt(12.0 * (sigma / (precision * dt)) ** 2)
        half[p] = min(max(int(np.ceil(0.5 * (wanted - 1.0))), 1), max(int(LONGEST / dt), 1))
    return half


def below(
    t: Floats,
    values: Floats,
    piece: NDArray[np.integer],
    limit: Floats | float = 0.0,
    fine: float = FINE,
    beyond: float = BEYOND,
) -> Bools:
    """Say in which samples (K,) values (K,) are below a limit, noise apart: of exact ones just those that are.

    Values are averaged to a deviation of `fine`, and are below from where their average is surely so to where it
    surely is no more: by `beyond` of its standard deviations.
    piece (K,): what belongs together, in order; values are finite in all of a piece, or in none, where they are never
    below. limit: one, or (K,), which may have steps that values have not.
    """
    low, sure = np.zeros(len(t), dtype=bool), np.zeros(len(t), dtype=bool)
    if not len(t):
        return low
    limits = np.broadcast_to(limit, t.shape)
    first = bounds(piece)
    for begin, end in zip(first[:-1].tolist(), first[1:].tolist(), strict=True):
        own, of = values[begin:end], slice(begin, end)
        if not np.isfinite(own[0]) or not (own < limits[of]).any():
            continue
        mean, deviation = _averaged(t[of], own, fine)
        band = beyond * deviation
        low[of], sure[of] = mean < limits[of] + band, mean < limits[of] - band
    out = np.zeros(len(t), dtype=bool)
    for begin, last in zip(*stretches(low, piece), strict=True):
        out[begin : last + 1] = sure[begin : last + 1].any()
    return out


def averaged(t: Floats, values: Floats, piece: NDArray[np.integer], fine: float) -> Floats:
    """Give averages (K,) of finite values (K,) to a deviation of `fine`: exact ones stay as they are.

    piece (K,): what belongs together, in order.
    """
    out, first = values.copy(), bounds(piece)
    for begin, end in zip(first[:-1].tolist(), first[1:].tolist(), strict=True):
        out[begin:end], _ = _averaged(t[begin:end], values[begin:end], fine)
    return out


def _noise(values: Floats) -> float:
    """The standard deviation of the white noise in values (K,), by their fourth differences."""
    return NORMAL * float(np.median(np.abs(np.diff(values, 4)))) / float(np.sqrt(70.0))


def _averaged(t: Floats, values: Floats, fine: float) -> tuple[Floats, Floats]:
    """Averages (K,) of values (K,) to a deviation of `fine`, and the standard deviation (K,) of each."""
    mean, deviation = values.copy(), np.zeros(len(values))
    if len(values) < FEWEST:
        return mean, deviation
    sigma, step = _noise(values), np.diff(t)
    dt = float(np.median(step))
    deviation[:] = sigma
    wanted = int(
        np.ceil(0.5 * (2.25 * (sigma / fine) ** 2 - 1.0))
    )  # a cubic in n values has sigma sqrt(9 / 4n)
    cuts = np.concatenate([[0], np.flatnonzero(step > EVEN * dt) + 1, [len(values)]])
    for begin, end in zip(cuts[:-1].tolist(), cuts[1:].tolist(), strict=True):
        half = min(wanted, int(AVERAGED / dt), (end - begin - 1) // 2)
        if 2 * half <= DEGREE:
            continue
        weights, own = _cubic(half), values[begin:end] - values[begin]
        inner = slice(begin + half, end - half)
        mean[inner] = np.convolve(own, weights[half], "valid")
        mean[begin : begin + half] = weights[:half] @ own[: 2 * half + 1]
        mean[end - half : end] = weights[half + 1 :] @ own[-2 * half - 1 :]
        mean[begin:end] += values[begin]
        spread = sigma * np.sqrt(np.diag(weights))
        deviation[inner] = spread[half]
        deviation[begin : begin + half], deviation[end - half : end] = spread[:half], spread[half + 1 :]
    return mean, deviation


@lru_cache(maxsize=64)
def _cubic(half: int) -> Floats:
    """The weights (n, n) by which n = 2 half + 1 values in a row give those of the cubic of least squares."""
    basis, _ = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, 2 * half + 1), DEGREE + 1))
    return np.asarray(basis @ basis.T)
