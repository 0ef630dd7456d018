"""Fit of natural cubic splines of speed and heading to measured positions (Wagner 2021, Eq. 5.1-5.5).

The published fit hands knot times and values to a general minimiser with a numeric gradient. Here the
residual's Jacobian is known: a natural spline is linear in its knot values, its derivative by a knot's time
is itself a spline, and the trapezoid rule is linear in the integrand (`resim.scenario.kernel`). A damped
Gauss-Newton needs a few steps of less than a millisecond.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PPoly

from resim.core.geometry import Floats, unwrap_angle
from resim.scenario.course import (
    Complexes,
    beyond_noise,
    has_pause,
    is_off_trace,
    is_standing,
    mean_heading,
    position_noise,
    signed_motion,
)
from resim.scenario.natural import natural_spline
from resim.scenario.trace import Quadrature, Trace

GAIN = 0.02
"""Segments are added until the mean error falls by less than this share (Section 5.2.2.2)."""

SEGMENT = 2.5
"""Length [s] of the segments to begin with."""

LEAST_NOISE = 1e-3
"""m; positions are never taken as more exact."""
EXACT = 2e-3
"""m, a fifth of the error of reference sensors: a mean error below it needs no further segment."""


_SAME_TIME = 1e-6
Splines = tuple[Floats, Floats, Floats, Floats, complex]
"""Knots and values of speed, the same of heading, and the start x + iy [m], as the kernel takes them."""


class _SearchOptions(NamedTuple):
    """How to search: noise of positions [m], as far as it is known; how many segments in a row may not help, more where
    neighbouring errors are alike; and from where, even segments if None.
    """

    noise: float = 0.0
    patience: int = 2
    begin: Splines | None = None


_PLAIN = _SearchOptions()


@dataclass(frozen=True, eq=False)
class TraceFit:
    """A fitted trace, and the distance (T,) [m] of each measured position from it."""

    trace: Trace
    distance: Floats


def fit_trace(t: Floats, x: Floats, y: Floats, heading: Floats, v: Floats) -> TraceFit:
    """Fit splines of speed and heading to measured positions x, y (T,) [m] at times t (T,) [s], T >= 2.

    Measured heading [rad] and v [m/s] serve as the start of the search; the heading also stands where
    positions say nothing about it. Times need not be evenly spaced: gaps are bridged. Where the clock and the map begin
    changes nothing: the fit is of times since the first, and places from the first.
    """
    first = complex(x[0], y[0])
    found = _fitted(_exact(t, t - t[0]), _exact(x, x - x[0]) + 1j * _exact(y, y - y[0]), heading, v)
    return _put_back(found, first, float(t[0]))


def refit_trace(before: Trace, t: Floats, x: Floats, y: Floats, heading: Floats, v: Floats) -> TraceFit:
    """Fit a trace to positions that are near another one's, from which the search starts (Wagner 2021, 6.1.3).

    before: the other trace, at the same times from first to last. t: (T,) [s], x, y: (T,) [m], heading: (T,) [rad] and
    v: (T,) [m/s] as for `fit_trace`. Its knots are kept where they are as good as ever, so that two traces that are
    near each other have splines that are. Who stands, or was standing, is fitted anew.
    """
    first, place = complex(x[0], y[0]), _exact(x, x - x[0]) + 1j * _exact(y, y - y[0])
    still = not np.any(before.v.c) or is_standing(place, position_noise(t, place))
    if still or abs(t[0] - before.start) + abs(t[-1] - before.end) > _SAME_TIME:
        return fit_trace(t, x, y, heading, v)
    since = _exact(t, t - t[0])
    turned = float(2.0 * np.pi * np.round((heading[0] - before.heading(t[0])) / (2.0 * np.pi)))
    knots = [np.r_[one.x[:-1] - one.x[0], since[-1]] for one in (before.v, before.heading)]
    values = before.v(before.v.x), before.heading(before.heading.x) + turned
    begin = knots[0], values[0], knots[1], values[1], complex(before.x0, before.y0) - first
    found = _solved(since, place, unwrap_angle(heading), v, _SearchOptions(begin=begin))
    return _put_back(found, first, float(t[0]))


def _put_back(found: TraceFit, first: complex, t0: float) -> TraceFit:
    """A fit of places from the first and times since the first, where and when it was."""
    trace = found.trace
    v_moved, heading_moved = (PPoly.construct_fast(one.c, one.x + t0) for one in (trace.v, trace.heading))
    return TraceFit(
        Trace(trace.x0 + first.real, trace.y0 + first.imag, v_moved, heading_moved), found.distance
    )


def _exact(values: Floats, differences: Floats) -> Floats:
    """Differences of values, without the rounding that comes of their size."""
    return np.round(differences, 9 if np.spacing(np.abs(values).max()) < 1e-10 else 6)


def _fitted(t: Floats, place: Complexes, heading: Floats, v: Floats) -> TraceFit:
    """Fit to places x + iy (T,) [m]."""
    noise = position_noise(t, place)
    if is_standing(place, noise):
        return _at_rest(t, place, heading)
    found = _solved(t, place, unwrap_angle(heading), v)
    far, strayed = found.distance.max() > beyond_noise(noise), is_off_trace(found.distance, noise)
    paused = (far or strayed) and has_pause(t, place, noise)
    if far or paused:  # headings of who hardly moves may be anything
        known = noise if paused else 0.0  # else they follow the noise of positions while it stands
        again = _solved(t, place, *signed_motion(t, place, heading, noise), _SearchOptions(known, 6))
        found = min(found, again, key=lambda fit: float(np.square(fit.distance).mean()))
    return found


def _solved(
    t: Floats, place: Complexes, heading: Floats, v: Floats, how: _SearchOptions = _PLAIN
) -> TraceFit:
    """Add segments, halved where the error is largest, until they no longer help; then move the knots."""
    from resim.scenario import kernel  # compiled: numba is imported where it is used only

    rule = Quadrature.over(float(t[0]), t)
    measured = (t, place, heading, v, rule.nodes, rule.grid, rule.before, rule.own, rule.half)
    span, noise = float(t[-1] - t[0]), max(how.noise, LEAST_NOISE)
    segments = max(1, round(span / SEGMENT))
    most = max(segments, min(int(span / kernel.MIN_SEGMENT), len(t) // 2))
    if how.begin is not None:
        most = max(most, len(how.begin[0]))
    best, off, error, mean = kernel.improved(
        measured, how.begin or kernel.even(measured, segments), noise, 8, False
    )
    last, stalled, last_off = best, 0, off
    while (
        len(last[0]) <= most and mean > EXACT and stalled < (6 if _hangs_together(last_off) else how.patience)
    ):
        noise = max(mean, LEAST_NOISE)
        last, last_off, error, last_mean = kernel.improved(
            measured, kernel.split(t, last, error), noise, 2, False
        )
        stalled += 1
        if last_mean < (1.0 - GAIN) * mean:
            best, off, mean, stalled = last, last_off, last_mean, 0
    if mean > EXACT:
        best, off, _, _ = kernel.improved(measured, best, noise, 5, True)
    v_knots, p_v, knots, p_heading, start = best
    splines = natural_spline(v_knots, p_v), natural_spline(knots, p_heading)
    return TraceFit(Trace(start.real, start.imag, *splines), np.abs(off))


def _hangs_together(off: Complexes) -> bool:
    """Whether neighbouring errors are alike: then they are misfit, and more segments are worth a try."""
    return bool(np.vdot(off[:-1], off[1:]).real > 0.9 * np.vdot(off[:-1], off[:-1]).real)


def _at_rest(t: Floats, place: Complexes, heading: Floats) -> TraceFit:
    """Who does not move: at the middle of the positions, with one heading."""
    ends, middle = np.array([t[0], t[-1]]), complex(place.mean())
    constant = np.zeros((4, 1))
    constant[3] = mean_heading(heading)
    trace = Trace(middle.real, middle.imag, PPoly(np.zeros((4, 1)), ends), PPoly(constant, ends))
    return TraceFit(trace, np.abs(place - middle))
