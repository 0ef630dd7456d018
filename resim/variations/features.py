"""The features of a maneuver: 50 equitemporal points of time and place, moved to the origin (Wagner 2021, 6.1.2.2)."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from resim.core.geometry import Floats
from resim.variations.lane_motion import LaneMotion

POINTS = 50
"""N_F points; three features of each."""
SAME = 1e-6
"""s."""


def feature_vector(motion: LaneMotion, start: float, end: float, points: int = POINTS) -> Floats:
    """Give the features (3 points,) of a motion from start to end [s]: all t [s], then all along, then all across [m].

    They count from the first point; the direction of the lane is the x axis, so that nothing is turned.
    """
    t = np.linspace(start, end, points)
    s, d = (CubicSpline(motion.t, values)(t) for values in (motion.s, motion.d))
    return np.concatenate([t - t[0], s - s[0], d - d[0]])


def parts(vector: Floats) -> tuple[Floats, Floats, Floats]:
    """Give t [s], along and across [m], (..., points) each, of feature vectors (..., 3 points)."""
    t, s, d = np.split(vector, 3, axis=-1)
    return t, s, d
