"""Ground truth between its samples: least-squares splines of one object's track, exact at any time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BSpline, make_lsq_spline

from resim.core.geometry import Floats, unwrap_angle
from resim.core.tracks import Tracks

KNOTS = 0.25
"""Time [s] between knots: what vehicles do passes (accelerations build up over 0.3 s), reference noise less so."""
GAP = 0.5
"""Time [s] without samples over which nothing is interpolated."""

X, Y, HEADING, V = range(4)


@dataclass(frozen=True, eq=False)
class TrueMotion:
    """One object's motion. pieces: cubic splines of x, y [m], heading [rad, not wrapped], v [m/s] over time [s]."""

    pieces: tuple[BSpline, ...]
    rates: tuple[BSpline, ...]
    integrals: tuple[BSpline, ...]

    @classmethod
    def of(cls, tracks: Tracks, row: int) -> TrueMotion:
        """Fit the track in this row; runs of fewer than two samples say nothing."""
        known = np.flatnonzero(tracks.valid[row])
        values = np.column_stack(
            [tracks.x[row], tracks.y[row], unwrap_angle(tracks.heading[row]), tracks.v[row]]
        )
        runs = np.split(known, np.flatnonzero(np.diff(tracks.t[known]) > GAP) + 1)
        pieces = tuple(_spline(tracks.t[run], values[run]) for run in runs if len(run) > 1)
        return cls(pieces, tuple(p.derivative() for p in pieces), tuple(p.antiderivative() for p in pieces))

    @property
    def start(self) -> float:
        """First time [s], infinity for who is never there."""
        return min((float(p.t[0]) for p in self.pieces), default=np.inf)

    def states(self, t: Floats) -> Floats:
        """Give (5, K) x, y, heading, v, a at times t (K,) [s], NaN where there is no truth."""
        out = np.full((5, len(t)), np.nan)
        for piece, rate in zip(self.pieces, self.rates, strict=True):
            inside = (t >= piece.t[0] - 1e-6) & (t <= piece.t[-1] + 1e-6)
            out[:4, inside] = piece(t[inside]).T
            out[4, inside] = rate(t[inside])[:, V]
        return out

    def mean(self, column: int, t: Floats, width: float) -> Floats:
        """Give (K,) the mean of heading or v over `width` [s] around times t, NaN where that is not known whole."""
        out = np.full(len(t), np.nan)
        for piece, integral in zip(self.pieces, self.integrals, strict=True):
            low, high = t - 0.5 * width, t + 0.5 * width
            inside = (low >= piece.t[0] - 1e-6) & (high <= piece.t[-1] + 1e-6)
            if width < 1e-6:
                out[inside] = _column(piece, column)(t[inside])
            else:
                ends = _column(integral, column)(np.concatenate([high[inside], low[inside]]))
                out[inside] = (ends[: len(ends) // 2] - ends[len(ends) // 2 :]) / width
        return out


def _column(spline: BSpline, column: int) -> BSpline:
    """One of the quantities of a spline, whose evaluation costs that of one."""
    return BSpline.construct_fast(
        spline.t, np.ascontiguousarray(spline.c[:, column]), spline.k, spline.extrapolate
    )


def _spline(t: Floats, values: Floats) -> BSpline:
    """Least squares over evenly chosen knots; few samples are met by a lower degree."""
    degree = min(3, len(t) - 1)
    step = max(2, round(KNOTS / float(np.median(np.diff(t)))))
    inner = t[step:-step:step] if len(t) > 2 * step + degree else t[:0]
    knots = np.concatenate([np.repeat(t[0], degree + 1), inner, np.repeat(t[-1], degree + 1)])
    return make_lsq_spline(t, values, knots, degree)
