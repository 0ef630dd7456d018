"""Whether a sensor's left is right: its list, turned over in the EGO's frame, lies where road users are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats

ASIDE = 1.5
"""Distance [m] to the left or right of the EGO from which on a detection tells its side."""
FEWEST = 20
"""Detections that tell it."""
FAR, CLEAR = 2.0, 0.5
"""Median distance [m] from the nearest road user from which on a list is doubted, and the share of it that may stay."""
MOST_TIMES = 300
"""Times that are looked at, evenly spread."""


def sides_swapped(ego: NDArray[np.complex128], heading: Floats, seen: NDArray[np.complex128],
                  truth: NDArray[np.complex128]) -> str:  # fmt: skip
    """Say how a sensor's objects fit better with left and right swapped; "" where they do not, or nothing tells.

    ego, heading: (T,) the EGO's place in the map [m] and heading [rad]; seen: (N, T) places of the sensor's objects;
    truth: (M, T) of all road users but the EGO. NaN where nobody is.
    """
    few = slice(None, None, max(len(ego) // MOST_TIMES, 1))
    ego, turn, seen, truth = ego[few], np.exp(-1j * heading[few]), seen[:, few], truth[:, few]
    own, known = (seen - ego) * turn, (truth - ego) * turn
    as_is, turned = [np.zeros(0)], [np.zeros(0)]
    for k in range(len(ego)):
        there, here = known[np.isfinite(known[:, k]), k], own[np.isfinite(own[:, k]), k]
        here = here[np.abs(here.imag) > ASIDE]
        if len(there) and len(here):
            as_is.append(np.abs(here[:, None] - there).min(axis=1))
            turned.append(np.abs(np.conj(here)[:, None] - there).min(axis=1))
    far, near = np.concatenate(as_is), np.concatenate(turned)
    if len(far) < FEWEST or not (np.median(far) > FAR and np.median(near) < CLEAR * np.median(far)):
        return ""
    return (
        f"left and right of the EGO are swapped: its objects are {np.median(far):.1f} m from the nearest road user in "
        f"the median, and {np.median(near):.1f} m on the other side"
    )
