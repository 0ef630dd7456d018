"""Fit of natural cubic splines of speed and heading to measured positions (Wagner 2021, Eq. 5.1-5.5).

The published fit hands knot times and values to a general minimiser with a numeric gradient. Here the
residual's Jacobian is known: a natural spline is linear in its knot values, its derivative by a knot's time
is itself a spline, and the trapezoid rule is linear in the integrand (`resim.scenario.kernel`). A damped
Gauss-Newton needs a few steps of less than a millisecond.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import PPoly
from scipy.linalg.lapack import dposv

from resim.core.geometry import Floats, unwrap_angle
from resim.scenario.course import (
    Complexes,
    beyond_noise,
    mean_heading,
    pauses,
    position_noise,
    stands,
    strays,
    way,
)
from resim.scenario.natural import natural_spline
from resim.scenario.trace import Quadrature, Trace

MIN_SEGMENT = 0.1
"""Least time [s] between two knots (Eq. 5.5)."""

GAIN = 0.02
"""Segments are added until the mean error falls by less than this share (Section 5.2.2.2)."""

SEGMENT = 2.5
"""Length [s] of the segments to begin with."""

PIECE = 30.0
"""Length [s] of trace for each segment that is halved at a time."""

_HEADING_OFF = (
    0.5  # rad; how far off a measured heading may be, a priori: it speaks where positions say nothing
)
_BEND_V, _BEND_HEADING = 10.0, 0.5  # m/s³, rad/s²; how much second derivatives of what drives are, a priori
_LEAST_NOISE = 1e-3  # m
_EXACT = 2e-3  # m, a fifth of the error of reference sensors: a mean error below it needs no further segment


@dataclass(frozen=True, eq=False)
class TraceFit:
    """A fitted trace, and the distance (T,) [m] of each measured position from it."""

    trace: Trace
    distance: Floats


def fit_trace(t: Floats, x: Floats, y: Floats, heading: Floats, v: Floats) -> TraceFit:
    """Fit splines of speed and heading to measured positions x, y (T,) [m] at times t (T,) [s], T >= 2.

    Measured heading [rad] and v [m/s] serve as the start of the search; the heading also stands where
    positions say nothing about it. Times need not be evenly spaced: gaps are bridged.
    """
    place = x + 1j * y
    noise = position_noise(t, place)
    if stands(place, noise):
        return _at_rest(t, place, heading)
    found = _Problem(t, place, unwrap_angle(heading), v).solve()
    far, strayed = found.distance.max() > beyond_noise(noise), strays(found.distance, noise)
    paused = (far or strayed) and pauses(t, place, noise)
    if far or paused:  # headings of who hardly moves may be anything
        known = noise if paused else 0.0  # else they follow the noise of positions while it stands
        again = _Problem(t, place, *way(t, place, heading, noise), known).solve(patience=6)
        found = min(found, again, key=lambda s: float(np.square(s.distance).mean()))
    splines = natural_spline(found.v, found.p_v), natural_spline(found.heading, found.p_heading)
    return TraceFit(Trace(found.start.real, found.start.imag, *splines), found.distance)


def _at_rest(t: Floats, place: Complexes, heading: Floats) -> TraceFit:
    """Who does not move: at the middle of the positions, with one heading."""
    ends, middle = np.array([t[0], t[-1]]), complex(place.mean())
    constant = np.zeros((4, 1))
    constant[3] = mean_heading(heading)
    trace = Trace(middle.real, middle.imag, PPoly(np.zeros((4, 1)), ends), PPoly(constant, ends))
    return TraceFit(trace, np.abs(place - middle))


@dataclass(frozen=True, eq=False)
class _Candidate:
    """One candidate, and what follows from it; vectors in the map are x + iy.

    Knots and values of both splines, and the start [m]. `kernel.evaluate` gives the rest: at the nodes direction (1 m
    long) and motion [m/s]; how far off positions are (T,) [m], their mean distance; the rest of the residual, which has
    these weights; and the sum of all squares.
    """

    v: Floats
    p_v: Floats
    heading: Floats
    p_heading: Floats
    start: complex
    weights: tuple[float, float, float]
    direction: Complexes
    motion: Complexes
    off: Complexes
    mean: float
    heading_off: Floats
    v_bend: Floats
    heading_bend: Floats
    cost: float

    @property
    def distance(self) -> Floats:
        return np.abs(self.off)

    @property
    def hangs_together(self) -> bool:
        """Whether neighbouring residuals are alike: then they are misfit, and more segments are worth a try."""
        one, two = self.off[:-1], self.off[1:]
        return bool(np.vdot(one, two).real > 0.9 * np.vdot(one, one).real)


class _Problem:
    """The measured samples, and the damped Gauss-Newton steps that bring a candidate closer to them.

    noise: of positions [m], as far as it is known to begin with.
    """

    def __init__(self, t: Floats, place: Complexes, heading: Floats, v: Floats, noise: float = 0.0) -> None:
        from resim.scenario import kernel  # compiled: numba is imported where it is used only

        self.kernel, self.t, self.place = kernel, t, place
        rule = Quadrature.over(float(t[0]), t)
        self.own = rule.own
        of_rule = (rule.nodes, rule.grid, rule.before, rule.own, rule.half)
        self.measured = (t, place, heading, v, *of_rule)
        self.noise = max(noise, _LEAST_NOISE)

    def solve(self, patience: int = 2) -> _Candidate:
        """Add segments, halved where the error is largest, until they no longer help; then move the knots."""
        span = float(self.t[-1] - self.t[0])
        segments = max(1, round(span / SEGMENT))
        most = max(segments, min(int(span / MIN_SEGMENT), len(self.t) // 2))
        best = last = self.improve(self.even(segments), rounds=8, move_knots=False)
        stalled = 0
        while (
            len(last.v) <= most and best.mean > _EXACT and stalled < (6 if last.hangs_together else patience)
        ):
            self.noise = max(best.mean, _LEAST_NOISE)
            last = self.improve(self.split(last), rounds=2, move_knots=False)
            if last.mean < (1.0 - GAIN) * best.mean:
                best, stalled = last, 0
            else:
                stalled += 1
        return self.improve(self.again(best), rounds=5) if best.mean > _EXACT else best

    def even(self, segments: int) -> _Candidate:
        """A candidate with evenly spaced knots and the measured speed and heading."""
        knots = np.linspace(self.t[0], self.t[-1], segments + 1)
        p = np.linalg.solve(*self.kernel.start(self.measured, knots, 1e-6 * len(self.t), 1e-9))
        return self.evaluate(knots, p[:, 0].copy(), knots, p[:, 1].copy(), complex(self.place[0]))

    def split(self, state: _Candidate) -> _Candidate:
        """Halve the segment with the largest squared error along or across the motion, of a long trace one a PIECE."""
        error = state.off * state.direction[self.own].conj()
        along, across = error.real.copy(), error.imag.copy()
        v, p_v = self.kernel.halved(self.t, state.v, state.p_v, along, MIN_SEGMENT, PIECE)
        heading, p_heading = self.kernel.halved(
            self.t, state.heading, state.p_heading, across, MIN_SEGMENT, PIECE
        )
        return self.evaluate(v, p_v, heading, p_heading, state.start)

    def again(self, state: _Candidate) -> _Candidate:
        """Cost a candidate anew, at the noise that is known by now."""
        return self.evaluate(state.v, state.p_v, state.heading, state.p_heading, state.start)

    def evaluate(
        self, v: Floats, p_v: Floats, heading: Floats, p_heading: Floats, start: complex
    ) -> _Candidate:
        weights = (self.noise / _HEADING_OFF, self.noise / _BEND_V, self.noise / _BEND_HEADING)
        found: tuple[Any, ...] = self.kernel.evaluate(
            self.measured, v, p_v, heading, p_heading, start, *weights
        )
        return _Candidate(v, p_v, heading, p_heading, start, weights, *found)

    def improve(self, state: _Candidate, rounds: int, move_knots: bool = True) -> _Candidate:
        """Take up to `rounds` Levenberg-Marquardt steps."""
        damping = 1e-2
        for _ in range(rounds):
            normal, gradient = self.linearise(state, move_knots)
            diagonal = normal.diagonal() + 1e-9
            for _ in range(4):
                damped = normal.copy()
                damped.flat[:: len(damped) + 1] += damping * diagonal
                _, delta, failed = dposv(damped, -gradient)  # cho_factor and cho_solve take six times as long
                if not failed:
                    trial = self.step(state, delta, move_knots)
                    if trial.cost < state.cost:
                        break
                damping *= 10.0
            else:
                return state
            settled = state.cost - trial.cost < 1e-3 * state.cost
            state, damping = trial, damping * 0.1
            if settled:
                break
        return state

    def linearise(self, state: _Candidate, move_knots: bool) -> tuple[Floats, Floats]:
        """Give normal matrix and gradient by p_v, inner knots of v, p_heading, inner knots of heading, the start."""
        normal, gradient = self.kernel.normal_equations(
            self.measured, state.v, state.p_v, state.heading, state.p_heading, state.direction, state.motion,
            state.off, state.heading_off, state.v_bend, state.heading_bend, *state.weights, move_knots,
        )  # fmt: skip
        return normal, gradient

    def step(self, state: _Candidate, delta: Floats, move_knots: bool) -> _Candidate:
        splines, first = list[Floats](), 0
        for knots, p in ((state.v, state.p_v), (state.heading, state.p_heading)):
            p_new, first = p + delta[first : first + len(p)], first + len(p)
            if move_knots and len(p) > 2:
                moved = knots.copy()
                moved[1:-1] += delta[first : first + len(p) - 2]
                knots, first = self.kernel.apart(moved, MIN_SEGMENT), first + len(p) - 2
            splines += knots, p_new
        v, p_v, heading, p_heading = splines
        return self.evaluate(v, p_v, heading, p_heading, state.start + complex(*delta[-2:]))
