"""The loops of the Kalman filter of `resim.perception.training.whiten`, compiled by numba.

What is compiled is kept on disk by the source of this module alone, so it takes nothing from others that may change.
"""

# mypy: ignore-errors

from __future__ import annotations

import numpy as np

from resim.core.compiled import entry


@entry()
def whiten(y, known, keep, sd, variance, out):
    """Fill the innovations (R, T, C) of known samples; keep, sd, variance: (R, T)."""
    rows, samples, columns = y.shape
    mean = np.zeros(columns)
    for r in range(rows):
        mean[:] = 0.0
        p = 1.0
        for k in range(samples):
            square = keep[r, k] * keep[r, k]
            p = square * p + 1.0 - square
            s = sd[r, k] * sd[r, k] * p + variance[r, k]
            gain = sd[r, k] * p / s if known[r, k] else 0.0
            scale = 1.0 / np.sqrt(s)
            for c in range(columns):
                mean[c] *= keep[r, k]
                innovation = y[r, k, c] - sd[r, k] * mean[c]
                if known[r, k]:
                    out[r, k, c] = innovation * scale
                mean[c] += gain * innovation
            p -= gain * sd[r, k] * p


@entry()
def predict(y, known, kept, which, sd, noise, variance, squared):
    """Fill the variance of each innovation (B, R, T), and its square over it. kept: (U, R, T), by `which` (B,)."""
    for b in range(sd.shape[0]):
        for r in range(sd.shape[1]):
            mean, p = 0.0, 1.0
            for k in range(sd.shape[2]):
                keep, drift = kept[which[b], r, k], sd[b, r, k]
                mean *= keep
                square = keep * keep
                p = p * square + (1.0 - square)
                gained = drift * p
                s = drift * gained + noise[b, r, k]
                innovation = y[r, k] - drift * mean
                variance[b, r, k] = s
                squared[b, r, k] = innovation * innovation / s
                if known[r, k]:
                    gain = gained / s
                    mean += gain * innovation
                    p -= gain * gained


@entry()
def add(terms, known, total):
    """Fill minus the sum (B, R) of the terms (B, R, T) of known samples, in their order."""
    for b in range(terms.shape[0]):
        for r in range(terms.shape[1]):
            total[b, r] = 0.0
            for k in range(terms.shape[2]):
                if known[r, k]:
                    total[b, r] -= terms[b, r, k]
