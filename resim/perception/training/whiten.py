"""Drift plus white noise as a likelihood: the Kalman filter of all objects.

An error is sd z + sn w: z a first-order autoregression in continuous time with unit variance and correlation time tau
(cov exp(-dt/tau)), w white noise of unit variance, sd and sn their standard deviations, which may change from sample
to sample. The filter runs over the samples of a row; rows, columns and sets of parameters are arrays.
"""

from __future__ import annotations

import numpy as np

from resim.core.geometry import Bools, Floats


def whiten(values: Floats, known: Bools, steps: Floats, drift: Floats, noise: Floats, tau: float) -> Floats:
    """Give innovations over their standard deviation, (R, T, C), 0 where not `known` (R, T).

    values: (R, T, C). steps: (R, T) s since the sample before. drift, noise: (R, T) standard deviations. Least
    squares of whitened values are generalised least squares of values.
    """
    from resim.perception.training import kernel  # compiled: numba is imported where it is used only

    y = np.where(known[..., None], values, 0.0)
    out = np.zeros(y.shape)
    kernel.whiten(*map(np.ascontiguousarray, (y, known, np.exp(-steps / tau), drift, noise**2)), out)
    return out


def log_likelihood(
    values: Floats, known: Bools, steps: Floats, drift: Floats, noise: Floats, tau: Floats
) -> Floats:
    """Give (B, R) the log-likelihood of rows for B sets of parameters.

    values, known, steps: (R, T). drift, noise: (B, R, T). tau: (B,).
    """
    if float(drift.max(initial=0.0)) < 1e-6 * float(noise.max(initial=0.0)):  # white: no filter
        s = noise**2
        return np.asarray(-0.5 * np.where(known, np.log(s) + values**2 / s, 0.0).sum(axis=2))
    from resim.perception.training import kernel

    y = np.where(known, values, 0.0)
    taus, which = np.unique(tau, return_inverse=True)
    kept = np.exp(-steps[None] / taus[:, None, None])
    variance, squared = np.empty(drift.shape), np.empty(drift.shape)
    kernel.predict(*map(np.ascontiguousarray, (y, known, kept, which, drift, noise**2)), variance, squared)
    total = np.empty(drift.shape[:2])
    kernel.add(np.log(variance) + squared, known, total)
    return 0.5 * total
