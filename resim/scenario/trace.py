"""From splines of speed and heading to positions: one conversion for fit, simulation and assessment.

Wagner 2021, Section 5.2.2.2: "the conversion between velocity and heading to position point is performed
the same way every time it is necessary", by the movement model of Eq. 5.4 and trapezoidal integration.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PPoly

from resim.core.geometry import Floats

STEP = 0.02
"""Width [s] of the trapezoids. Fixed, so that a position does not depend on the times that are asked for."""

_TOLERANCE = 1e-6  # s; a time this far outside a trace still belongs to it


@dataclass(frozen=True)
class Quadrature:
    """The trapezoid rule from `start` to times t (T,), as a linear map of the integrand at `nodes`.

    Nodes are the fixed grid start + k STEP and after it the times themselves: a time between two grid
    points is reached by a shorter trapezoid from the grid point before it.
    """

    nodes: Floats
    grid: int
    before: np.ndarray[tuple[int], np.dtype[np.intp]]
    rest: Floats

    @classmethod
    def over(cls, start: float, t: Floats) -> Quadrature:
        """Set up the rule from start [s] to times t (T,) [s], none of them before start."""
        since = np.maximum(t - start, 0.0)
        before = np.floor(since / STEP + 1e-9).astype(np.intp)
        grid = start + STEP * np.arange((before.max() if len(before) else 0) + 1)
        return cls(np.concatenate([grid, t]), len(grid), before, since - STEP * before)

    def __call__(self, integrand: Floats) -> Floats:
        """Give the integrals (T, ...) of integrands sampled at the nodes (len(nodes), ...)."""
        f = integrand[: self.grid]
        whole = np.zeros_like(f)
        np.cumsum((0.5 * STEP) * (f[1:] + f[:-1]), axis=0, out=whole[1:])
        half = (0.5 * self.rest).reshape(-1, *([1] * (f.ndim - 1)))
        return whole[self.before] + half * (f[self.before] + integrand[self.grid :])


@dataclass(frozen=True, eq=False)
class Trace:
    """One object's motion: start position [m] in the map frame, cubic splines of speed and heading.

    v [m/s] and heading [rad] are `scipy.interpolate.PPoly` over time [s]: coefficients highest power first
    in the time since a segment's start, as in a JSCEN file.
    """

    x0: float
    y0: float
    v: PPoly
    heading: PPoly

    @property
    def start(self) -> float:
        """First time [s]."""
        return float(self.v.x[0])

    @property
    def end(self) -> float:
        """Last time [s]."""
        return float(self.v.x[-1])

    def states(self, t: ArrayLike) -> States:
        """Give the states at times t (T,) [s], NaN where the trace does not reach."""
        t = np.asarray(t, dtype=float)
        inside = (t >= self.start - _TOLERANCE) & (t <= self.end + _TOLERANCE)
        values = np.full((6, len(t)), np.nan)
        values[:, inside] = self._inside(np.clip(t[inside], self.start, self.end))
        return States(*values)

    def _inside(self, t: Floats) -> Floats:
        rule = Quadrature.over(self.start, t)
        v, heading = self.v(rule.nodes), self.heading(rule.nodes)
        own = slice(rule.grid, None)
        return np.stack(
            [
                self.x0 + rule(v * np.cos(heading)),
                self.y0 + rule(v * np.sin(heading)),
                heading[own],
                v[own],
                self.v(t, 1),
                self.heading(t, 1),
            ]
        )


@dataclass(frozen=True, eq=False)
class States:
    """States along a trace, each (T,): x, y [m], heading [rad, not wrapped], v [m/s], a [m/s²],
    yaw_rate [rad/s]."""

    x: Floats
    y: Floats
    heading: Floats
    v: Floats
    a: Floats
    yaw_rate: Floats
