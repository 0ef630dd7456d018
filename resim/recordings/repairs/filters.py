"""Outlier filters: the moving average with a threshold, and Hampel's, whose middle single samples cannot move."""

from __future__ import annotations

import numpy as np

from resim.core.geometry import Bools
from resim.recordings.checks.tracks import Values, medians

SIGMA = 1.4826
"""Standard deviations of a normal distribution in its median absolute deviation."""


def moving_average_outliers(values: Values, window: int, threshold: float) -> Bools:
    """Say which values (K,) are farther than the threshold from the moving average: |x_k - m_k| > threshold.

    m_k is the mean of the `window` values around k, itself among them, of fewer at the ends. Real values, or
    complex ones (x + iy), in the unit of the threshold. A spike of height h lifts the averages around it by
    h / window: from threshold times window on its neighbours count as outliers as well. Kaefer, Section
    4.5.2.3, which then interpolates over them (`resim.recordings.repairs.gaps`).
    """
    around, inside = _windows(values, window)
    mean = np.where(inside, around, 0.0).sum(axis=1) / inside.sum(axis=1)
    return np.asarray(np.abs(values - mean) > threshold)


def robust_outliers(values: Values, window: int, n_sigma: float = 3.0, *, least: float = 0.0) -> Bools:
    """Say which values (K,) are far from the median around them: |x_k - m_k| > max(n_sigma s_k, least).

    m_k is the median of the `window` values x_j around k, s_k = 1.4826 median |x_j - m_j| their scaled median
    absolute deviation, each from its own median, so that a ramp spreads nothing; least: in the unit of the
    values, for data that repeat. Complex values (x + iy) have their median by part. After Hampel, "The influence
    curve and its role in robust estimation", J. Am. Stat. Assoc. 69 (1974): up to half of a window may be wrong.
    """
    middle = medians(*_windows(values, window))
    apart = np.abs(values - middle)
    spread = SIGMA * medians(*_windows(apart, window))
    return np.asarray(apart > np.maximum(n_sigma * spread, least))


def _windows(values: Values, window: int) -> tuple[Values, Bools]:
    """The values (K, W) around each, and which of them exist."""
    if window < 3 or window % 2 == 0:
        raise ValueError(f"window is {window}: expected an odd number of samples from 3 on")
    place = np.arange(len(values))[:, None] + np.arange(-(window // 2), window // 2 + 1)
    inside = (place >= 0) & (place < len(values))
    return np.asarray(values)[np.clip(place, 0, max(len(values) - 1, 0))], np.asarray(inside)
