"""By how much a whole sensor is off its ground truth: a lever arm that the mapping does not say, and a lag."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats
from resim.core.tracks import Tracks

LEAST, SOONEST = 0.3, 0.03
"""Offset [m] and lag [s] from which on they are told."""
MOVES = 1.0
"""Standard deviation [m/s] of relative speeds from which on they tell a lag from an offset."""
FEWEST = 20
"""Samples that tell anything."""
ROUNDS, WIDTH = 20, 1.5
"""Rounds of the robust fit; errors beyond WIDTH times their median count less (Huber)."""


def sensor_bias(truth: Tracks, sd: Tracks, gt_id: NDArray[np.str_], ego: str) -> str:
    """Say by how much the sensor's objects lie ahead, to the left and late of their ground truth; "" where little.

    In the EGO's frame, over all samples of objects that have a ground truth: error = offset - lag * relative velocity,
    by robust least squares. truth: the GT at the times of the SD; gt_id: (N_sd,) "" where an SD object has none.
    """
    error, velocity = _errors(truth, sd, gt_id, ego)
    if len(error) < FEWEST:
        return ""
    lags = float(np.std(velocity.real)) > MOVES
    offset, lag = _fitted(error, velocity, lags=lags)
    late = lag > SOONEST
    ahead, left = (value if abs(value) > LEAST else 0.0 for value in (offset.real, offset.imag))
    if not (ahead or left or late):
        return ""
    told = [f"{abs(value):.2f} m {words[value < 0.0]}" for value, words in (
        (ahead, ("ahead", "behind")), (left, ("to the left", "to the right"))) if value]  # fmt: skip
    told += [f"{lag:.2f} s late"] if late else []
    rest = float(np.median(np.abs(error - offset + lag * velocity)))
    text = f"its objects are {', '.join(told)} of the ground truth ({np.median(np.abs(error)):.2f} m in the median"
    text += f", {rest:.2f} m after removing it)"
    if ahead or left:
        text += "; is that where x and y count from? Then say so by frame and mounting"
    return text


def _errors(
    truth: Tracks, sd: Tracks, gt_id: NDArray[np.str_], ego: str
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Errors of places (K,) [m] and relative velocities (K,) [m/s] of all matched samples, in the EGO's frame."""
    own = truth.index(ego)
    turned = np.exp(-1j * truth.heading[own])
    moving = truth.v * np.exp(1j * truth.heading)
    errors, velocities = [], []
    for n, name in enumerate(gt_id.tolist()):
        if name in ("", ego):
            continue
        m = truth.index(name)
        both = sd.valid[n] & truth.valid[m] & truth.valid[own]
        off = (sd.x[n] - truth.x[m]) + 1j * (sd.y[n] - truth.y[m])
        errors.append((off * turned)[both])
        velocities.append(((moving[m] - moving[own]) * turned)[both])
    none = np.zeros(0, dtype=complex)
    return np.concatenate([none, *errors]), np.concatenate([none, *velocities])


def _fitted(
    error: NDArray[np.complex128], velocity: NDArray[np.complex128], *, lags: bool
) -> tuple[complex, float]:
    """Offset [m] and lag [s] of errors and relative velocities (K,); lags: whether a lag is sought."""
    k = len(error)
    design = np.zeros((2 * k, 3))
    design[:k, 0] = design[k:, 1] = 1.0
    design[:, 2] = np.concatenate([-velocity.real, -velocity.imag]) if lags else 0.0
    right = np.concatenate([error.real, error.imag])
    weight = np.ones(k)
    found: Floats = np.zeros(3)
    for _ in range(ROUNDS):
        both = np.sqrt(np.concatenate([weight, weight]))
        found = np.linalg.lstsq(design * both[:, None], right * both, rcond=None)[0]
        left = right - design @ found
        away = np.hypot(left[:k], left[k:])
        weight = 1.0 / np.maximum(away / max(WIDTH * float(np.median(away)), 1e-9), 1.0)
    return complex(found[0], found[1]), float(found[2])
