"""Drift plus white noise as a likelihood: the Kalman filter of all objects at once.

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
    y = np.ascontiguousarray(np.moveaxis(np.where(known[..., None], values, 0.0), 1, 0))
    keep = np.exp(-steps / tau).T
    sd, variance, ok = drift.T, (noise**2).T, known.T
    mean, p = np.zeros(y.shape[1:]), np.ones(y.shape[1])
    out = np.zeros_like(y)
    for k in range(len(y)):
        mean *= keep[k, :, None]
        p = keep[k] ** 2 * p + 1.0 - keep[k] ** 2
        s = sd[k] ** 2 * p + variance[k]
        gain = np.where(ok[k], sd[k] * p / s, 0.0)
        innovation = y[k] - sd[k, :, None] * mean
        out[k] = innovation * (ok[k] / np.sqrt(s))[:, None]
        mean += gain[:, None] * innovation
        p = p - gain * sd[k] * p
    return np.moveaxis(out, 0, 1)


def log_likelihood(
    values: Floats, known: Bools, steps: Floats, drift: Floats, noise: Floats, tau: Floats
) -> Floats:
    """Give (B, R) the log-likelihood of rows for B sets of parameters.

    values, known, steps: (R, T). drift, noise: (B, R, T). tau: (B,).
    """
    if float(drift.max(initial=0.0)) < 1e-6 * float(noise.max(initial=0.0)):  # white: no loop
        s = noise**2
        return np.asarray(-0.5 * np.where(known, np.log(s) + values**2 / s, 0.0).sum(axis=2))
    y, ok = np.where(known, values, 0.0).T, known.T
    sd, variance = np.moveaxis(drift, 2, 0), np.moveaxis(noise, 2, 0) ** 2
    total, mean, p = np.zeros(drift.shape[:2]), np.zeros(drift.shape[:2]), np.ones(drift.shape[:2])
    taus, which = np.unique(tau, return_inverse=True)
    kept = np.exp(-steps.T[None] / taus[:, None, None])
    squares = kept**2
    which = which if len(taus) > 1 else np.zeros(1, dtype=np.intp)
    for k in range(len(y)):
        mean *= kept[which, k]
        square = squares[which, k]
        p = p * square + (1.0 - square)
        gained = sd[k] * p
        s = sd[k] * gained + variance[k]
        innovation = y[k] - sd[k] * mean
        gain = gained / s * ok[k]
        total -= ok[k] * (np.log(s) + innovation * innovation / s)
        mean += gain * innovation
        p -= gain * gained
    return 0.5 * total
