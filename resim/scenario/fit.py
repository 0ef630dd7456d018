"""Fit of natural cubic splines of speed and heading to measured positions (Wagner 2021, Eq. 5.1-5.5).

The published fit hands knot times and values to a general minimiser with a numeric gradient. Here the
residual's Jacobian is known: a natural spline is linear in its knot values, its derivative by a knot's time
is itself a spline, and the trapezoid rule is linear in the integrand. A damped Gauss-Newton needs a few
steps of less than a millisecond.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from resim.core.geometry import Floats, unwrap_angle
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
class Fit:
    """A fitted trace, and the distance (T,) [m] of each measured position from it."""

    trace: Trace
    distance: Floats


def fit_trace(t: Floats, x: Floats, y: Floats, heading: Floats, v: Floats) -> Fit:
    """Fit splines of speed and heading to measured positions x, y (T,) [m] at times t (T,) [s], T >= 2.

    Measured heading [rad] and v [m/s] serve as the start of the search; the heading also stands where
    positions say nothing about it. Times need not be evenly spaced: gaps are bridged.
    """
    problem = _Problem(t, x, y, unwrap_angle(heading), v)
    span = float(t[-1] - t[0])
    segments = max(1, round(span / SEGMENT))
    most = max(segments, min(int(span / MIN_SEGMENT), len(t) // 2))
    best = last = problem.improve(problem.even(segments), rounds=8, move_knots=False)
    stalled = 0
    while segments < most and best.mean > _EXACT and stalled < (6 if last.hangs_together else 2):
        segments += 1
        problem.noise = max(best.mean, _LEAST_NOISE)
        last = problem.improve(problem.split(last), rounds=2, move_knots=False)
        if last.mean < (1.0 - GAIN) * best.mean:
            best, stalled = last, 0
        else:
            stalled += 1
    if best.mean > _EXACT:
        best = problem.improve(problem.again(best), rounds=5)
    trace = Trace(best.x0, best.y0, best.spline_v(), best.spline_heading())
    return Fit(trace, best.distance)


@dataclass(frozen=True, eq=False)
class _State:
    """One candidate: knots and values of both splines, start position, and what follows from them."""

    v: Natural
    heading: Natural
    p_v: Floats
    p_heading: Floats
    x0: float
    y0: float
    residual_x: Floats
    residual_y: Floats
    cost: float

    @property
    def distance(self) -> Floats:
        return np.hypot(self.residual_x, self.residual_y)

    @property
    def mean(self) -> float:
        return float(self.distance.mean())

    @property
    def hangs_together(self) -> bool:
        """Whether neighbouring residuals are alike: then they are misfit, and more segments are worth a try."""
        one, two = (np.stack([r[:-1], r[1:]]) for r in (self.residual_x, self.residual_y))
        return bool((one[0] @ one[1] + two[0] @ two[1]) > 0.9 * (one[0] @ one[0] + two[0] @ two[0]))

    def spline_v(self) -> CubicSpline:
        return _natural(self.v.knots, self.p_v)

    def spline_heading(self) -> CubicSpline:
        return _natural(self.heading.knots, self.p_heading)


def _natural(knots: Floats, values: Floats) -> CubicSpline:
    return CubicSpline(knots, values, bc_type="natural")


class _Problem:
    """The measured samples, and the damped Gauss-Newton steps that bring a candidate closer to them."""

    def __init__(self, t: Floats, x: Floats, y: Floats, heading: Floats, v: Floats) -> None:
        self.t, self.x, self.y, self.measured_heading, self.measured_v = t, x, y, heading, v
        self.rule = Quadrature.over(float(t[0]), t)
        self.noise = _LEAST_NOISE

    def even(self, segments: int) -> _State:
        """A candidate with evenly spaced knots and the measured speed and heading."""
        spline = Natural.over(np.linspace(self.t[0], self.t[-1], segments + 1), self.rule.nodes)
        own = spline.basis[self.rule.grid :]
        ridge = 1e-6 * len(self.t) * (spline.second.T @ spline.second) + 1e-9 * np.eye(segments + 1)
        values = np.column_stack([self.measured_v, self.measured_heading])
        p = np.asarray(np.linalg.solve(own.T @ own + ridge, own.T @ values), dtype=np.float64)
        return self.evaluate(spline, spline, p[:, 0], p[:, 1], float(self.x[0]), float(self.y[0]))

    def split(self, state: _State) -> _State:
        """Halve the segment with the largest squared error along (speed) or across (heading) the motion."""
        angle = (state.heading.basis @ state.p_heading)[self.rule.grid :]
        c, s = np.cos(angle), np.sin(angle)
        along, across = (
            c * state.residual_x + s * state.residual_y,
            c * state.residual_y - s * state.residual_x,
        )
        (v, p_v), (heading, p_heading) = (
            self._halved(spline, values, error)
            for spline, values, error in (
                (state.v, state.p_v, along),
                (state.heading, state.p_heading, across),
            )
        )
        return self.evaluate(v, heading, p_v, p_heading, state.x0, state.y0)

    def _halved(self, spline: Natural, values: Floats, error: Floats) -> tuple[Natural, Floats]:
        segments = len(spline.knots) - 1
        owner = np.clip(np.searchsorted(spline.knots, self.t, side="right") - 1, 0, segments - 1)
        squares = np.bincount(owner, error**2, minlength=segments)
        i = int(np.argmax(np.where(np.diff(spline.knots) >= 2.0 * MIN_SEGMENT, squares, -1.0)))
        middle = 0.5 * (spline.knots[i] + spline.knots[i + 1])
        knots = _apart(np.insert(spline.knots, i + 1, middle))
        bend = spline.second[i : i + 2] @ values
        width = spline.knots[i + 1] - spline.knots[i]
        value = 0.5 * (values[i] + values[i + 1]) - width**2 / 16.0 * bend.sum()
        return Natural.over(knots, self.rule.nodes), np.insert(values, i + 1, value)

    def again(self, state: _State) -> _State:
        """Cost a candidate anew, at the noise that is known by now."""
        return self.evaluate(state.v, state.heading, state.p_v, state.p_heading, state.x0, state.y0)

    def evaluate(
        self, v: Natural, heading: Natural, p_v: Floats, p_heading: Floats, x0: float, y0: float
    ) -> _State:
        speed, angle = v.basis @ p_v, heading.basis @ p_heading
        rx = x0 + self.rule(speed * np.cos(angle)) - self.x
        ry = y0 + self.rule(speed * np.sin(angle)) - self.y
        prior = angle[self.rule.grid :] - self.measured_heading
        cost = float(rx @ rx + ry @ ry + (self.noise / _HEADING_OFF) ** 2 * prior @ prior)
        for spline, p, usual in ((v, p_v, _BEND_V), (heading, p_heading, _BEND_HEADING)):
            bend = spline.second @ p
            cost += (self.noise / usual) ** 2 * float(bend @ bend)
        return _State(v, heading, p_v, p_heading, x0, y0, rx, ry, cost)

    def improve(self, state: _State, rounds: int, move_knots: bool = True) -> _State:
        """Take up to `rounds` Levenberg-Marquardt steps."""
        damping = 1e-2
        for _ in range(rounds):
            normal, gradient = self.linearise(state, move_knots)
            for _ in range(4):
                try:
                    factor = cho_factor(
                        normal + damping * np.diag(np.diag(normal) + 1e-9), check_finite=False
                    )
                except LinAlgError:
                    damping *= 10.0
                    continue
                trial = self.step(state, -cho_solve(factor, gradient, check_finite=False), move_knots)
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

    def linearise(self, state: _State, move_knots: bool) -> tuple[Floats, Floats]:
        """Give the normal matrix and the gradient by p_v, p_heading, x0, y0 and inner knot times."""
        v, heading = state.v, state.heading
        by_v, by_heading = v.basis, heading.basis
        if move_knots:
            by_v = np.hstack([by_v, v.by_knot_times(state.p_v)])
            by_heading = np.hstack([by_heading, heading.by_knot_times(state.p_heading)])
        speed, angle = v.basis @ state.p_v, heading.basis @ state.p_heading
        c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
        turn = speed[:, None] * by_heading
        one, none = np.ones((len(self.t), 1)), np.zeros((len(self.t), 1))
        jx = np.hstack([self.rule(np.hstack([by_v * c, -turn * s])), one, none])
        jy = np.hstack([self.rule(np.hstack([by_v * s, turn * c])), none, one])
        normal = jx.T @ jx + jy.T @ jy
        gradient = jx.T @ state.residual_x + jy.T @ state.residual_y
        own = by_heading[self.rule.grid :]
        at = slice(by_v.shape[1], by_v.shape[1] + by_heading.shape[1])
        weight = (self.noise / _HEADING_OFF) ** 2
        normal[at, at] += weight * own.T @ own
        gradient[at] += weight * own.T @ (angle[self.rule.grid :] - self.measured_heading)
        for spline, p, usual, first in (
            (v, state.p_v, _BEND_V, 0),
            (heading, state.p_heading, _BEND_HEADING, by_v.shape[1]),
        ):
            at = slice(first, first + len(p))
            smooth = (self.noise / usual) ** 2 * (spline.second.T @ spline.second)
            normal[at, at] += smooth
            gradient[at] += smooth @ p
        return normal, gradient

    def step(self, state: _State, delta: Floats, move_knots: bool) -> _State:
        v, heading, x0, y0 = state.v, state.heading, state.x0 + delta[-2], state.y0 + delta[-1]
        splines, first = [], 0
        for spline, p in ((v, state.p_v), (heading, state.p_heading)):
            p_new, first = p + delta[first : first + len(p)], first + len(p)
            if move_knots and len(p) > 2:
                moved = spline.knots.copy()
                moved[1:-1] += delta[first : first + len(p) - 2]
                spline, first = Natural.over(_apart(moved), self.rule.nodes), first + len(p) - 2
            splines.append((spline, p_new))
        (v, p_v), (heading, p_heading) = splines
        return self.evaluate(v, heading, p_v, p_heading, float(x0), float(y0))


def _apart(knots: Floats) -> Floats:
    """Push knots to their order with MIN_SEGMENT between them, ends fixed (Eq. 5.5)."""
    steps = MIN_SEGMENT * np.arange(len(knots))
    lower = np.maximum.accumulate(np.append(knots[:1], knots[1:]) - steps) + steps
    upper = np.minimum.accumulate((np.append(lower[:-1], knots[-1:]) - steps)[::-1])[::-1] + steps
    return np.asarray(np.clip(upper, knots[0] + steps, knots[-1] - steps[::-1]))
