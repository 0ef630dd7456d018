"""Speed over time, or over the way: the way, speed and acceleration at any time in closed form."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from scipy.interpolate import PchipInterpolator, PPoly

from resim.core.errors import ResimError
from resim.core.geometry import Floats

LASTS = 1e5
"""Time [s] for which the last speed stays."""


class SpeedProfile(Protocol):
    """How fast an object is."""

    def states(self, t: Floats) -> Floats:
        """Give way [m] since it appeared, speed [m/s] and acceleration [m/s²] (3, K) at times t (K,) [s]."""
        ...

    def time_at(self, way: float) -> float:
        """Give the first time [s] at which it has gone so far [m]; inf where it never does."""
        ...


class SpeedOverTime:
    """Speeds v (K,) [m/s] at times t (K,) [s], monotone cubics between (no overshoot), constant before and after.

    The acceleration is continuous, and zero where the speed has its peaks.
    """

    def __init__(self, t: Floats, v: Floats, appears: float) -> None:
        _refuse_unordered("times", t, v)
        # a constant piece at either end: the acceleration begins and ends with 0
        around = np.concatenate([[min(t[0], appears) - 1.0], t, [t[-1] + LASTS]])
        pieces = PchipInterpolator(around, np.concatenate([v[:1], v, v[-1:]]))
        self._v = PPoly(pieces.c, pieces.x)
        self._way, self._a = self._v.antiderivative(), self._v.derivative()
        self._start, self._appears = float(self._way(appears)), appears

    def states(self, t: Floats) -> Floats:
        """Give way, speed and acceleration (3, K) at times t (K,) [s]."""
        v = np.maximum(self._v(t), 0.0)
        return np.stack([self._way(t) - self._start, v, np.where(v > 0.0, self._a(t), 0.0)])

    def time_at(self, way: float) -> float:
        """Give the first time [s] at which it has gone so far [m]; inf where it never does."""
        t = self._way.solve(way + self._start, extrapolate=False)
        t = t[np.isfinite(t) & (t >= self._appears - 1e-9)]
        return float(t.min()) if len(t) else np.inf


class SpeedOverWay:
    """Speeds v (K,) [m/s] at ways s (K,) [m] along the route, constant acceleration between: v² is linear in s.

    Who comes to 0 m/s stays there.
    """

    def __init__(self, s: Floats, v: Floats, appears: float) -> None:
        _refuse_unordered("places", s, v)
        if s[0] > 0.0:
            s, v = np.concatenate([[0.0], s]), np.concatenate([v[:1], v])
        mean = 0.5 * (v[1:] + v[:-1])
        stuck = np.flatnonzero(mean <= 0.0)
        if len(stuck):  # it stands there for ever
            s, v, mean = s[: stuck[0] + 1], v[: stuck[0] + 1], mean[: stuck[0]]
        self._s, self._v = s, v
        self._t = appears + np.concatenate([[0.0], np.cumsum(np.diff(s) / mean)])
        self._a = np.concatenate([np.diff(v) / np.maximum(np.diff(self._t), 1e-12), [0.0]])

    def states(self, t: Floats) -> Floats:
        """Give way, speed and acceleration (3, K) at times t (K,) [s]."""
        row = np.clip(np.searchsorted(self._t, t, side="right") - 1, 0, len(self._t) - 1)
        dt, a, v = t - self._t[row], self._a[row], self._v[row]
        return np.stack([self._s[row] + v * dt + 0.5 * a * dt * dt, np.maximum(v + a * dt, 0.0), a])

    def time_at(self, way: float) -> float:
        """Give the first time [s] at which it has gone so far [m]; inf where it never does."""
        row = int(np.clip(np.searchsorted(self._s, way, side="right") - 1, 0, len(self._s) - 1))
        far, v, a = way - float(self._s[row]), float(self._v[row]), float(self._a[row])
        if far <= 0.0:
            return float(self._t[row])
        root = np.sqrt(max(v * v + 2.0 * a * far, 0.0))
        return float(self._t[row]) + 2.0 * far / (v + root) if v + root > 0.0 else np.inf


def _refuse_unordered(name: str, at: Floats, v: Floats) -> None:
    if len(at) != len(v) or not len(at):
        raise ResimError(f"speed: {name} and values are lists of one length, found {len(at)} and {len(v)}")
    if (np.diff(at) <= 0.0).any():
        raise ResimError(f"speed: {name} must increase, found {at.tolist()}")
