"""Fit of natural cubic splines of speed and heading to measured positions (Wagner 2021, Eq. 5.1-5.5).

The published fit hands knot times and values to a general minimiser with a numeric gradient. Here the
residual's Jacobian is known: a natural spline is linear in its knot values, its derivative by a knot's time
is itself a spline, and the trapezoid rule is linear in the integrand (`resim.scenario.kernel`). A damped
Gauss-Newton needs a few steps of less than a millisecond.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

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
from resim.scenario.natural import natural_spline, second_derivatives
from resim.scenario.trace import STEP, Quadrature, Trace

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

    Knots and values of both splines, and the start [m]. At the nodes: direction (1 m long) and motion [m/s]. How far
    off positions are (T,) [m]; of the rest of the residual: headings (T,), second derivatives of speed and of heading
    (K,); the sum of all squares.
    """

    v: Floats
    heading: Floats
    p_v: Floats
    p_heading: Floats
    start: complex
    direction: Complexes
    motion: Complexes
    off: Complexes
    heading_off: Floats
    v_bend: Floats
    heading_bend: Floats
    cost: float

    @property
    def distance(self) -> Floats:
        return np.abs(self.off)

    @property
    def mean(self) -> float:
        return float(self.distance.mean())

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

        self.kernel = kernel
        self.t, self.place, self.measured_heading, self.measured_v = t, place, heading, v
        self.rule = Quadrature.over(float(t[0]), t)
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
        values = np.column_stack([self.measured_v, self.measured_heading])
        rule = self.rule
        p = self.kernel.start(knots, rule.nodes[rule.own], values, 1e-6 * len(self.t), 1e-9)
        return self.evaluate(knots, knots, p[:, 0].copy(), p[:, 1].copy(), complex(self.place[0]))

    def split(self, state: _Candidate) -> _Candidate:
        """Halve the segment with the largest squared error along (speed) or across (heading) the motion.

        Of a long trace one in each PIECE of it.
        """
        error = state.off * state.direction[self.rule.own].conj()
        v, p_v = self._halved(state.v, state.p_v, error.real)
        heading, p_heading = self._halved(state.heading, state.p_heading, error.imag)
        return self.evaluate(v, heading, p_v, p_heading, state.start)

    def _halved(self, knots: Floats, values: Floats, error: Floats) -> tuple[Floats, Floats]:
        widths = np.diff(knots)
        segment = np.searchsorted(knots[1:-1], self.t, side="right")
        squares = np.bincount(segment, error**2, minlength=len(widths))
        squares[widths < 2.0 * MIN_SEGMENT] = -1.0
        bend = second_derivatives(knots, values)
        pieces = max(1, int((knots[-1] - knots[0]) / PIECE))
        piece = np.minimum(pieces * (knots[:-1] - knots[0]) / (knots[-1] - knots[0]), pieces - 1).astype(int)
        first = np.searchsorted(piece, np.arange(pieces + 1))
        worst = [a + int(np.argmax(squares[a:b])) for a, b in pairwise(first.tolist()) if b > a]
        at = np.array([i for i in worst if squares[i] >= 0.0] or worst[:1])
        value = 0.5 * (values[at] + values[at + 1]) - widths[at] ** 2 / 16.0 * (bend[at] + bend[at + 1])
        middle = 0.5 * (knots[at] + knots[at + 1])
        return _apart(np.insert(knots, at + 1, middle)), np.insert(values, at + 1, value)

    def again(self, state: _Candidate) -> _Candidate:
        """Cost a candidate anew, at the noise that is known by now."""
        return self.evaluate(state.v, state.heading, state.p_v, state.p_heading, state.start)

    def evaluate(
        self, v: Floats, heading: Floats, p_v: Floats, p_heading: Floats, start: complex
    ) -> _Candidate:
        rule = self.rule
        angle = self.kernel.at(heading, p_heading, rule.nodes)
        direction = np.cos(angle) + 1j * np.sin(angle)
        motion = self.kernel.at(v, p_v, rule.nodes) * direction
        off = start + rule(motion) - self.place
        heading_off = self.noise / _HEADING_OFF * (angle[rule.own] - self.measured_heading)
        v_bend = self.noise / _BEND_V * second_derivatives(v, p_v)
        heading_bend = self.noise / _BEND_HEADING * second_derivatives(heading, p_heading)
        rest = (off.view(np.float64), heading_off, v_bend, heading_bend)
        cost = sum(float(part @ part) for part in rest)
        return _Candidate(
            v, heading, p_v, p_heading, start, direction, motion, off, heading_off, v_bend, heading_bend, cost
        )

    def improve(self, state: _Candidate, rounds: int, move_knots: bool = True) -> _Candidate:
        """Take up to `rounds` Levenberg-Marquardt steps."""
        damping = 1e-2
        for _ in range(rounds):
            normal, gradient = self.linearise(state, move_knots)
            for _ in range(4):
                damped = normal.copy()
                damped[np.diag_indices_from(damped)] += damping * (np.diag(normal) + 1e-9)
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
        rule, noise = self.rule, self.noise
        normal, gradient = self.kernel.normal_equations(
            state.v, state.p_v, state.heading, state.p_heading, move_knots,
            rule.nodes, rule.grid, rule.before, rule.own, rule.half, STEP,
            state.direction, state.motion, state.off, state.heading_off, state.v_bend, state.heading_bend,
            noise / _HEADING_OFF, noise / _BEND_V, noise / _BEND_HEADING,
        )  # fmt: skip
        return normal, gradient

    def step(self, state: _Candidate, delta: Floats, move_knots: bool) -> _Candidate:
        splines, first = [], 0
        for knots, p in ((state.v, state.p_v), (state.heading, state.p_heading)):
            p_new, first = p + delta[first : first + len(p)], first + len(p)
            if move_knots and len(p) > 2:
                moved = knots.copy()
                moved[1:-1] += delta[first : first + len(p) - 2]
                knots, first = _apart(moved), first + len(p) - 2
            splines.append((knots, p_new))
        (v, p_v), (heading, p_heading) = splines
        return self.evaluate(v, heading, p_v, p_heading, state.start + complex(*delta[-2:]))


def _apart(knots: Floats) -> Floats:
    """Push knots to their order with MIN_SEGMENT between them, ends fixed (Eq. 5.5)."""
    steps = MIN_SEGMENT * np.arange(len(knots))
    lower = np.maximum.accumulate(np.append(knots[:1], knots[1:]) - steps) + steps
    upper = np.minimum.accumulate((np.append(lower[:-1], knots[-1:]) - steps)[::-1])[::-1] + steps
    return np.asarray(np.clip(upper, knots[0] + steps, knots[-1] - steps[::-1]))
