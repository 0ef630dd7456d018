"""One object's motion, varied: beside its path, with other speeds, and smooth (Kaefer 2022, 4.5.3.1).

Base is the object's trace, which is free of the recording's noise. Along its way w the new path lies e(w) to the left,
and the way is driven at v(t) + n(t). With the base's heading ψ and curvature κ the new heading is
ψ + atan2(e', 1 - κ e).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from resim.core.geometry import Floats
from resim.scenario.augmentation.settings import PathNoise, SpeedNoise
from resim.scenario.trace import Trace

FINE = 0.01
"""Time [s] of the grid on which ways are integrated."""
SLOW = 2.0
"""Speed [m/s] below which the noise of the speed fades."""
_STANDS = 1e-3


@dataclass(frozen=True, eq=False)
class VariedMotion:
    """An object's new states at times t (K,) [s]: x, y, heading, v (4, K).

    moments: (2, M) times of the base [s] and when the varied object is at the same place.
    """

    t: Floats
    states: Floats
    moments: Floats


def vary_motion(
    trace: Trace, times: Floats, path: PathNoise | None, speed: SpeedNoise | None, rng: np.random.Generator
) -> VariedMotion:
    """Draw a variation of an object's motion; times: (K,) of its samples [s]. It ends where the base's path ends."""
    grid = np.append(np.arange(trace.start, trace.end, FINE), trace.end)
    base = trace.states(grid)
    direction = np.where(base.v < 0.0, -1.0, 1.0)
    pace = np.abs(base.v)
    way = _integral(grid, pace)
    beside = _beside(way[-1], path, rng)
    faster = pace if speed is None else _noisy(grid, pace, speed, rng)
    driven = _integral(grid, faster)
    t = times[np.interp(times, grid, driven) <= way[-1] + 1e-9]
    at = np.interp(np.interp(t, grid, driven), way, grid)  # when the base is there
    here = trace.states(np.clip(at, trace.start, trace.end))
    w = np.interp(at, grid, way)
    off, slope = beside(w), beside(w, 1)
    moving = np.maximum(np.abs(here.v), _STANDS)
    bend = 1.0 - np.sign(here.v) * here.yaw_rate / moving * off
    sign = np.interp(at, grid, direction)
    heading = here.heading + np.arctan2(sign * slope, np.maximum(bend, 0.1))
    v = np.interp(t, grid, faster) * np.hypot(bend, slope) * np.where(sign < 0.0, -1.0, 1.0)
    x, y = here.x - off * np.sin(here.heading), here.y + off * np.cos(here.heading)
    reached = np.interp(way, driven, grid, right=np.inf)
    return VariedMotion(t, np.stack([x, y, heading, v]), np.stack([grid, reached]))


def _integral(t: Floats, v: Floats) -> Floats:
    return np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))])


def _beside(length: float, path: PathNoise | None, rng: np.random.Generator) -> CubicSpline:
    """How far [m] to the left, as a cubic spline of the way [m]."""
    if path is None:
        return CubicSpline([0.0, max(length, 1.0)], [0.0, 0.0])
    count = max(int(np.ceil(length / path.spacing)) + 1, 4)
    points = path.offset.draw(rng, 1) + _smoothed(path.noise.draw(rng, count), path.smoothing / path.spacing)
    return CubicSpline(path.spacing * np.arange(count), points, bc_type="natural")


def _noisy(t: Floats, v: Floats, speed: SpeedNoise, rng: np.random.Generator) -> Floats:
    count = max(int(np.ceil((t[-1] - t[0]) / speed.spacing)) + 1, 4)
    points = _smoothed(speed.noise.draw(rng, count), speed.smoothing / speed.spacing)
    noise = CubicSpline(t[0] + speed.spacing * np.arange(count), points, bc_type="natural")(t)
    return np.asarray(np.maximum(v + noise * np.minimum(v / SLOW, 1.0), 0.0))


def _smoothed(noise: Floats, sigma: float) -> Floats:
    """The noise, smoothed by a Gaussian of so many points: slow sway stays, sharp turns go."""
    return np.asarray(gaussian_filter1d(noise, sigma, mode="nearest"))
