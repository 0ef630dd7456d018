"""Motions of P boxes at N times each, as arrays (P, N, 4): x, y [m], heading [rad], v [m/s] along the heading."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats

Rows = NDArray[np.intp]


def ctra(state: Floats, t: Floats) -> Floats:
    """Give the motion (P, N, 4) of constant turn rate and acceleration (Wagner 2021, Eq. 4.1), in closed form.

    state: (P, 6) x, y, heading, v, a [m/s²], yaw rate [rad/s]; t: (P, N) s. Who brakes to standstill stays there; who
    stands, or seems to roll back a little, does so too but drives off ahead at a > 0.
    """
    # compiled: numba is imported where it is used only
    from resim.metrics.measures import kernel

    return np.asarray(kernel.ctra(*kernel.plain(state, t)))


def straight(state: Floats, t: Floats) -> Floats:
    """Give the motion (P, N, 4) at constant velocity; state (P, >= 4) x, y, heading, v; t (P, N) s."""
    from resim.metrics.measures import kernel

    return np.asarray(kernel.straight(*kernel.plain(state, t)))


def _hermite(f: Floats, p0: Floats, m0: Floats, p1: Floats, m1: Floats) -> Floats:
    f2, f3 = f * f, f * f * f
    return np.asarray(
        (2 * f3 - 3 * f2 + 1) * p0 + (f3 - 2 * f2 + f) * m0 + (3 * f2 - 2 * f3) * p1 + (f3 - f2) * m1
    )


def sample(path: Floats, step: float, t: Floats) -> Floats:
    """Give a sampled path (P, M + 1, 4) at times t (P, N) s, by cubic Hermite; after its end straight on."""
    if len(path) != len(t):
        raise ValueError(f"pairs do not match: {path.shape}, {t.shape}")
    return sample_rows(turned(path), np.arange(len(path)), step, t)


def turned(path: Floats) -> Floats:
    """Give sampled paths (P, M + 1, 4) as `sample_rows` takes them, with what takes long in it done."""
    # compiled: numba is imported where it is used only
    from resim.metrics.measures import kernel

    _has_length(path)
    return np.asarray(kernel.turned(*kernel.plain(path)))


def sample_rows(turned: Floats, rows: Rows, step: float, t: Floats) -> Floats:
    """Give paths at times t (P, N) s, as `sample`, each that in its row (P,) of what `turned` gives."""
    from resim.metrics.measures import kernel

    if len(rows) != len(t) or (len(rows) and not 0 <= rows.min() <= rows.max() < len(turned)):
        raise ValueError(f"pairs do not match: {rows.shape} of {turned.shape}, {t.shape}")
    times = np.require(t, float, ("C", "W"))
    return np.asarray(kernel.sample(turned, np.require(rows, np.intp, ("C", "W")), step, times))


def way(path: Floats) -> Floats:
    """Give the metres (P, M + 1) driven along a sampled path until each of its points, by chords."""
    chord = np.hypot(np.diff(path[..., 0]), np.diff(path[..., 1]))
    return np.concatenate([np.zeros((len(path), 1)), np.cumsum(chord, axis=1)], axis=1)


def way_at(path: Floats, step: float, t: Floats) -> Floats:
    """Give the metres (P, N) driven along a sampled path until times t (P, N) within it."""
    s, pace = way(path), np.abs(path[..., 3]) * step
    j = np.clip((t / step).astype(int), 0, path.shape[1] - 2)
    s0, s1, m0, m1 = (np.take_along_axis(of, j + k, axis=1) for of in (s, pace) for k in (0, 1))
    return _hermite(np.clip(t / step - j, 0.0, 1.0), s0, m0, s1, m1)


def along(path: Floats, s: Floats, v: Floats) -> Floats:
    """Give poses (P, N, 4) at s (P, N) metres along a sampled path, with pace v (P, N) m/s.

    Where the path ends, or turns round after the first place, straight on in the direction it had there.
    """
    from resim.metrics.measures import kernel

    _has_length(path)
    if s.shape != v.shape:
        raise ValueError(f"way and pace do not match: {s.shape}, {v.shape}")
    return np.asarray(kernel.along(*kernel.plain(path, s, v)))


def _has_length(path: Floats) -> None:
    if path.shape[1] < 2:
        raise ValueError(f"a path {path.shape} has no length")


def paced(v: Floats, a: Floats, t: Floats) -> tuple[Floats, Floats]:
    """Give way [m] and pace [m/s] (P, N) after t (P, N) s from pace v >= 0 with acceleration a (P, 1); stops at 0."""
    stop = np.where(a < 0.0, v / np.maximum(-a, 1e-12), np.inf)
    t = np.minimum(t, stop)
    return v * t + 0.5 * a * t * t, np.maximum(v + a * t, 0.0)
