"""Fit of natural cubic splines of speed and heading to measured positions (Wagner 2021, Eq. 5.1-5.5).

The published fit hands knot times and values to a general minimiser with a numeric gradient. Here the
residual's Jacobian is known: a natural spline is linear in its knot values, its derivative by a knot's time
is itself a spline, and the trapezoid rule is linear in the integrand. A damped Gauss-Newton needs a few
steps of less than a millisecond.
"""

from __future__ import annotations

from dataclasses import dataclass

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
from resim.scenario.natural import Natural
from resim.scenario.trace import Quadrature, Trace

MIN_SEGMENT = 0.1
"""Least time [s] between two knots (Eq. 5.5)."""

GAIN = 0.02
"""Segments are added until the mean error falls by less than this share (Section 5.2.2.2)."""

SEGMENT = 2.5
"""Length [s] of the segments to begin with."""

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
    splines = found.v.spline(found.p_v), found.heading.spline(found.p_heading)
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
    off positions are (T,) [m]; all that is off, as the sum of squares has it; that sum.
    """

    v: Natural
    heading: Natural
    p_v: Floats
    p_heading: Floats
    start: complex
    direction: Complexes
    motion: Complexes
    off: Complexes
    residual: Floats
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
        while segments < most and best.mean > _EXACT and stalled < (6 if last.hangs_together else patience):
            segments += 1
            self.noise = max(best.mean, _LEAST_NOISE)
            last = self.improve(self.split(last), rounds=2, move_knots=False)
            if last.mean < (1.0 - GAIN) * best.mean:
                best, stalled = last, 0
            else:
                stalled += 1
        return self.improve(self.again(best), rounds=5) if best.mean > _EXACT else best

    def even(self, segments: int) -> _Candidate:
        """A candidate with evenly spaced knots and the measured speed and heading."""
        spline = Natural.over(np.linspace(self.t[0], self.t[-1], segments + 1), self.rule.nodes)
        own = spline.basis[:, self.rule.own]
        ridge = 1e-6 * len(self.t) * (spline.second.T @ spline.second) + 1e-9 * np.eye(segments + 1)
        values = np.column_stack([self.measured_v, self.measured_heading])
        p = np.asarray(np.linalg.solve(own @ own.T + ridge, own @ values), dtype=np.float64)
        return self.evaluate(spline, spline, p[:, 0], p[:, 1], complex(self.place[0]))

    def split(self, state: _Candidate) -> _Candidate:
        """Halve the segment with the largest squared error along (speed) or across (heading) the motion."""
        error = state.off * state.direction[self.rule.own].conj()
        v, p_v = self._halved(state.v, state.p_v, error.real)
        heading, p_heading = self._halved(state.heading, state.p_heading, error.imag)
        return self.evaluate(v, heading, p_v, p_heading, state.start)

    def _halved(self, spline: Natural, values: Floats, error: Floats) -> tuple[Natural, Floats]:
        knots = spline.knots
        widths = np.diff(knots)
        squares = np.bincount(spline.segment[self.rule.own], error**2, minlength=len(widths))
        i = int(np.argmax(np.where(widths >= 2.0 * MIN_SEGMENT, squares, -1.0)))
        bend = spline.second[i : i + 2] @ values
        value = 0.5 * (values[i] + values[i + 1]) - widths[i] ** 2 / 16.0 * bend.sum()
        middle = 0.5 * (knots[i] + knots[i + 1])
        knots, values = (
            np.concatenate([c[: i + 1], [new], c[i + 1 :]]) for c, new in ((knots, middle), (values, value))
        )
        return Natural.over(_apart(knots), self.rule.nodes), values

    def again(self, state: _Candidate) -> _Candidate:
        """Cost a candidate anew, at the noise that is known by now."""
        return self.evaluate(state.v, state.heading, state.p_v, state.p_heading, state.start)

    def evaluate(
        self, v: Natural, heading: Natural, p_v: Floats, p_heading: Floats, start: complex
    ) -> _Candidate:
        angle = p_heading @ heading.basis
        direction = np.cos(angle) + 1j * np.sin(angle)
        motion = (p_v @ v.basis) * direction
        off = start + self.rule(motion) - self.place
        residual = np.concatenate([
            off.view(np.float64), self.noise / _HEADING_OFF * (angle[self.rule.own] - self.measured_heading),
            self.noise / _BEND_V * (v.second @ p_v), self.noise / _BEND_HEADING * (heading.second @ p_heading),
        ])  # fmt: skip
        cost = float(residual @ residual)
        return _Candidate(v, heading, p_v, p_heading, start, direction, motion, off, residual, cost)

    def improve(self, state: _Candidate, rounds: int, move_knots: bool = True) -> _Candidate:
        """Take up to `rounds` Levenberg-Marquardt steps."""
        damping = 1e-2
        for _ in range(rounds):
            jacobian = self.linearise(state, move_knots)
            normal, gradient = jacobian @ jacobian.T, jacobian @ state.residual
            for _ in range(4):
                damped = normal + damping * np.diag(np.diag(normal) + 1e-9)
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

    def linearise(self, state: _Candidate, move_knots: bool) -> Floats:
        """Give the derivatives (P, R) of the residual by p_v, p_heading, inner knot times of each, and the start."""
        v, heading, n = state.v, state.heading, 2 * len(self.t)
        by_v, by_heading = v.basis, heading.basis
        if move_knots:
            by_v = np.vstack([by_v, v.by_knot_times(state.p_v)])
            by_heading = np.vstack([by_heading, heading.by_knot_times(state.p_heading)])
        first = len(by_v)
        motions = np.empty((first + len(by_heading), len(self.rule.nodes)), dtype=np.complex128)
        for rows, by, motion in (
            (motions[:first], by_v, state.direction),
            (motions[first:], by_heading, 1j * state.motion),
        ):
            np.multiply(by, motion.real, out=rows.real)
            np.multiply(by, motion.imag, out=rows.imag)
        out = np.zeros((len(motions) + 2, len(state.residual)))
        out[:-2, :n] = self.rule(motions).view(np.float64)
        out[-2, 0:n:2] = out[-1, 1:n:2] = 1.0
        bend, end = n + len(self.t), len(state.residual) - len(state.p_heading)
        out[first:-2, n:bend] = self.noise / _HEADING_OFF * by_heading[:, self.rule.own]
        out[: len(v.knots), bend:end] = self.noise / _BEND_V * v.second.T
        out[first : first + len(heading.knots), end:] = self.noise / _BEND_HEADING * heading.second.T
        return out

    def step(self, state: _Candidate, delta: Floats, move_knots: bool) -> _Candidate:
        splines, first = [], 0
        for spline, p in ((state.v, state.p_v), (state.heading, state.p_heading)):
            p_new, first = p + delta[first : first + len(p)], first + len(p)
            if move_knots and len(p) > 2:
                moved = spline.knots.copy()
                moved[1:-1] += delta[first : first + len(p) - 2]
                spline, first = Natural.over(_apart(moved), self.rule.nodes), first + len(p) - 2
            splines.append((spline, p_new))
        (v, p_v), (heading, p_heading) = splines
        return self.evaluate(v, heading, p_v, p_heading, state.start + complex(*delta[-2:]))


def _apart(knots: Floats) -> Floats:
    """Push knots to their order with MIN_SEGMENT between them, ends fixed (Eq. 5.5)."""
    steps = MIN_SEGMENT * np.arange(len(knots))
    lower = np.maximum.accumulate(np.append(knots[:1], knots[1:]) - steps) + steps
    upper = np.minimum.accumulate((np.append(lower[:-1], knots[-1:]) - steps)[::-1])[::-1] + steps
    return np.asarray(np.clip(upper, knots[0] + steps, knots[-1] - steps[::-1]))
