"""The Markov chain of detection, between rates [1/s] and probabilities of a time step, for any step exactly."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from resim.core.geometry import Floats


def probabilities(loss: ArrayLike, gain: ArrayLike, dt: ArrayLike) -> tuple[Floats, Floats]:
    """Give the probabilities to be lost, and to be regained, dt [s] later, at these rates [1/s].

    loss / (loss + gain) (1 - exp(-(loss + gain) dt)), and the other way round: what was lost may be back within dt.
    """
    loss, gain = np.asarray(loss, dtype=float), np.asarray(gain, dtype=float)
    both = loss + gain
    part = -np.expm1(-both * np.asarray(dt, dtype=float)) / np.where(both > 0.0, both, 1.0)
    return loss * part, gain * part


def rates(p_loss: ArrayLike, p_gain: ArrayLike, dt: float) -> tuple[Floats, Floats]:
    """Give the rates [1/s] of loss and gain that make these probabilities of a step of dt [s]; of both, under 1."""
    p_loss, p_gain = np.asarray(p_loss, dtype=float), np.asarray(p_gain, dtype=float)
    both = p_loss + p_gain
    per = -np.log1p(-both) / dt / np.where(both > 0.0, both, 1.0)
    return p_loss * per, p_gain * per


def detected_share(loss: ArrayLike, gain: ArrayLike) -> Floats:
    """Give the share of time in which an object is detected in the long run; 1 where nothing is ever lost or gained."""
    loss, gain = np.asarray(loss, dtype=float), np.asarray(gain, dtype=float)
    both = loss + gain
    return np.where(both > 0.0, gain / np.where(both > 0.0, both, 1.0), 1.0)
