"""Slopes of noisy values: a straight line through as many samples as their own noise asks for.

Wagner's threshold of 0.03 m/s means nothing to positions with 0.1 m of noise, differenced at 25 Hz: they fall below it
in 0.7 % of samples. So noise is measured, of each piece of a track by its own fourth differences, in which motion is
next to nothing, and the line is through as many samples as bring the slope's standard deviation down to a precision:
clean data get three samples, and keep their moments exactly; noisy ones up to LONGEST to each side. Noise that lasts
longer than that is motion.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats

LONGEST = 1.0
"""s to each side that a line reaches at most (our choice): a quarter of a lane change."""
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
    first = np.concatenate([[0], np.flatnonzero(np.diff(piece)) + 1, [len(t)]])
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
        if high - low < 8:
            continue
        fourth = np.diff(values[low:high], 4)
        sigma = NORMAL * float(np.median(np.abs(fourth))) / np.sqrt(70.0)
        dt = float(np.median(np.diff(t[low:high])))
        wanted = np.cbrt(12.0 * (sigma / (precision * dt)) ** 2)
        half[p] = min(max(int(np.ceil(0.5 * (wanted - 1.0))), 1), max(int(LONGEST / dt), 1))
    return half
