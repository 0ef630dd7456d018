"""From splines of speed and heading to positions: one conversion for fit, simulation and assessment.

Wagner 2021, Section 5.2.2.2: "the conversion between velocity and heading to position point is performed
the same way every time it is necessary", by the movement model of Eq. 5.4 and trapezoidal integration.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PPoly

from resim.core.geometry import Floats

STEP = 0.02
"""Width [s] of the trapezoids. Fixed, so that a position does not depend on the times that are asked for."""

Indices = NDArray[np.intp]
AnyNumbers = TypeVar("AnyNumbers", Floats, NDArray[np.complex128])

_SAME = 1e-12  # s; a time that near to a point of the grid is that point
_TOLERANCE = 1e-6  # s; a time this far outside a trace still belongs to it


@dataclass(frozen=True, eq=False)
class Quadrature:
    """The trapezoid rule from `start` to times t (T,), as a linear map of the integrand at `nodes`.

    Nodes are the fixed grid start + k STEP and after it the times between: each is reached by a shorter trapezoid from
    the grid point before it. own: (T,), which of the nodes the times are.
    """

    nodes: Floats
    own: Indices
    grid: int
    before: Indices
    half: Floats

    @classmethod
    def over(cls, start: float, t: Floats) -> Quadrature:
        """Set up the rule from start [s] to times t (T,) [s], none of them before start."""
        since = np.maximum(t - start, 0.0)
        before = np.floor(since / STEP + 1e-9).astype(np.intp)
        grid = start + STEP * np.arange((before.max() if len(before) else 0) + 1)
        rest = since - STEP * before
        between = rest > _SAME
        own = np.where(between, len(grid) - 1 + np.cumsum(between), before)
        return cls(np.concatenate([grid, t[between]]), own, len(grid), before, 0.5 * rest)

    def __call__(self, integrand: AnyNumbers) -> AnyNumbers:
        """Give the integrals (..., T) of integrands sampled at the nodes (..., len(nodes))."""
        # the trapezoids are the sum of all samples, less half of the first and of the last
        whole = np.cumsum(integrand[..., : self.grid], axis=-1).take(self.before, axis=-1)
        first, last = integrand.take(self.before, axis=-1), integrand.take(self.own, axis=-1)
        return STEP * (whole - 0.5 * integrand[..., :1]) + (self.half - 0.5 * STEP) * first + self.half * last


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

    def states(self, t: ArrayLike) -> TraceStates:
        """Give the states at times t (T,) [s], NaN where the trace does not reach."""
        t = np.asarray(t, dtype=float)
        inside = (t >= self.start - _TOLERANCE) & (t <= self.end + _TOLERANCE)
        values = np.full((6, len(t)), np.nan)
        values[:, inside] = self._inside(np.clip(t[inside], self.start, self.end))
        return TraceStates(*values)

    def _inside(self, t: Floats) -> Floats:
        rule = Quadrature.over(self.start, t)
        v, heading = self.v(rule.nodes), self.heading(rule.nodes)
        x, y = rule(v * np.stack([np.cos(heading), np.sin(heading)]))
        return np.stack(
            [
                self.x0 + x,
                self.y0 + y,
                heading[rule.own],
                v[rule.own],
                self.v(t, 1),
                self.heading(t, 1),
            ]
        )


@dataclass(frozen=True, eq=False)
class TraceStates:
    """States along a trace, each (T,): x, y [m], heading [rad, not wrapped], v [m/s], a [m/s²],
    yaw_rate [rad/s]."""

    x: Floats
    y: Floats
    heading: Floats
    v: Floats
    a: Floats
    yaw_rate: Floats
