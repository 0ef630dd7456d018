"""The true past of the objects: where they were, how fast and which way, so long ago.

What is looked up is linear in the samples: a value at a time, its mean over a time, its slope. So each is a row of
weights over the last samples; with equal time steps the weights stay the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from operator import is_not

import numpy as np
from numpy.typing import NDArray

from resim.core.clock import TICK
from resim.core.geometry import Floats
from resim.perception.model import Objects
from resim.perception.runtime.kernel import HEADING, PAST_ROWS, UNWRAPPED, V, X, Y, remember
from resim.scenario.maneuvers import SEEN_ACROSS, SEEN_BRAKING, momentary
from resim.simulation.perception import Worlds

_STEP = 0.04
"""s; of the past that is laid out before the first step is known."""

Rows = NDArray[np.intp]


def at_time(times: Floats, t: float) -> Floats:
    """Give the weights of samples at `times` (K,) [s, increasing] in the linear interpolation at t."""
    weights = np.zeros(len(times))
    k = min(max(int(np.searchsorted(times, t)), 1), len(times) - 1)
    since, step = t - times[k - 1], times[k] - times[k - 1]
    part = 0.0 if abs(since) < TICK else 1.0 if abs(since - step) < TICK else since / step
    weights[k - 1 : k + 1] = 1.0 - part, part
    return weights


def mean_over(times: Floats, t: float, over: float) -> Floats:
    """Give the weights of samples in the mean of their linear interpolation from t - over/2 to t + over/2 [s]."""
    if over < TICK:
        return at_time(times, t)
    first, last = times[:-1], times[1:]
    low, high = np.maximum(first, t - 0.5 * over), np.minimum(last, t + 0.5 * over)
    share, middle = np.maximum(high - low, 0.0) / (last - first) / over, 0.5 * (low + high)
    weights = np.zeros(len(times))
    weights[:-1] += share * (last - middle)
    weights[1:] += share * (middle - first)
    return weights


def slope_at(times: Floats, t: float) -> Floats:
    """Give the weights [1/s] of samples in the slope of their linear interpolation at t, or just before."""
    weights = np.zeros(len(times))
    k = min(max(int(np.searchsorted(times, t - TICK)), 1), len(times) - 1)
    weights[k - 1 : k + 1] = np.array([-1.0, 1.0]) / (times[k] - times[k - 1])
    return weights


class Lookups:
    """All that is looked up in samples at `times` (K,) [s], of which the last is now, for S sets of parameters.

    weights (S, 4, K): of the place, the speed, the acceleration and the heading; they are 0 outside of span (S, 4, 2).
    settled: counts back from behind the newest sample to the one that says what the maneuver is.
    """

    def __init__(self, times: Floats, sets: Sequence[Objects]) -> None:
        now = float(times[-1])
        self.weights = np.array([
            (at_time(times, now - s.latency.position),
             mean_over(times, now - s.latency.speed, s.averaging.speed),
             slope_at(times, now - s.latency.speed),
             mean_over(times, now - s.latency.heading, s.averaging.heading)) for s in sets
        ])  # fmt: skip
        used = self.weights != 0.0
        self.span = np.stack([used.argmax(axis=2), len(times) - used[..., ::-1].argmax(axis=2)], axis=2)
        last = int(np.searchsorted(times, now - sets[0].latency.speed + TICK, side="right"))
        self.settled = len(times) - last + 1


class _Window:
    """What one run's sensor looks back by: its sets of parameters, and lookups by the time step."""

    def __init__(self, sets: Sequence[Objects]) -> None:
        self.sets = sets
        self.need = max(
            max(s.latency.position, s.latency.speed + 0.5 * s.averaging.speed,
                s.latency.heading + 0.5 * s.averaging.heading) for s in sets
        )  # fmt: skip
        self.direction = UNWRAPPED if any(s.latency.heading > 0.0 for s in sets) else HEADING
        self.known: dict[float, Lookups] = {}

    def lookups(self, t: Floats, steady: int, dt: float) -> Lookups:
        """Give what to look up in samples at t (T,) [s], of which the last `steady` are steps of dt [s]."""
        if steady * dt > self.need + dt:
            key = round(dt, 9)
            if key not in self.known:
                rows = math.ceil((self.need + TICK) / dt) + 2
                self.known[key] = Lookups(key * np.arange(1.0 - rows, 1.0), self.sets)
            return self.known[key]
        first = max(int(np.searchsorted(t, t[-1] - self.need - TICK)) - 1, 0)
        return Lookups(t[min(first, len(t) - 2) :], self.sets)


class StackedLookups:
    """The lookups of B runs, one after the other: weights (S, 4, K), span (S, 4, 2), and settled (B,) of each run."""

    def __init__(self, of: list[Lookups]) -> None:
        self.of = of
        most = max(one.weights.shape[2] for one in of)
        self.weights = np.concatenate(
            [np.pad(one.weights, ((0, 0), (0, 0), (most - one.weights.shape[2], 0))) for one in of]
        )
        self.span = np.concatenate([one.span + (most - one.weights.shape[2]) for one in of])
        self.settled = np.array([one.settled for one in of])


class History:
    """The past of N objects, as the kernel writes it, at times t (T,) [s]; its samples go up to `end`.

    past (PAST_ROWS, T, N) is that of the world, maneuver (B, T, N) what it looks like from the EGO of each run. sets:
    of each run its parameters, the pooled ones first. An object that is new has driven as it does now for ever.
    """

    def __init__(self, sets: Sequence[Sequence[Objects]]) -> None:
        self._windows = [_Window(own) for own in sets]
        self.need = max(window.need for window in self._windows)
        self.direction = np.array([window.direction for window in self._windows])
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self.end = 0
        self._look: StackedLookups | None = None

    def begin(self, worlds: Worlds, dt: float = _STEP) -> None:
        """Lay out the time before the first sample, in steps of dt [s]."""
        self.dt, rows = dt, math.ceil((self.need + TICK) / dt) + 2
        self.steady = self.end = rows
        self.t = np.empty(max(8 * rows, 128))
        self.t[:rows] = worlds.t - dt * np.arange(rows - 1, -1, -1)
        self._make(len(self.t), len(worlds.v))
        self._past(worlds, np.arange(len(worlds.v)))
        self.first: Worlds | None = worlds

    def _make(self, size: int, count: int) -> None:
        """Make room for so many samples of so many objects."""
        self.past = np.empty((PAST_ROWS, size, count))
        self.maneuver = np.empty((len(self._windows), size, count), dtype=np.int8)

    def _past(self, worlds: Worlds, new: Rows) -> None:
        """Fill the columns of new objects."""
        past, heading, v = self.past[:, : self.end], worlds.heading[new], worlds.v[new]
        ago = self.t[: self.end, None] - worlds.t
        position = worlds.position[new] + ago * (v * np.exp(1j * heading))
        past[X][:, new], past[Y][:, new] = position.real, position.imag
        past[V][:, new], past[HEADING][:, new], past[UNWRAPPED][:, new] = v, heading, heading
        seen = momentary(heading - worlds.ego[:, 2, None], v, 0.0)
        self.maneuver[:, : self.end, new] = seen[:, None, :]

    def regroup(self, worlds: Worlds, kept: Rows, before: Rows, new: Rows) -> None:
        """Change the columns: those `before` go to `kept`, and `new` ones begin."""
        self.first = None  # the past keeps the steps that it has
        past, maneuver = self.past, self.maneuver
        self._make(len(self.t), len(worlds.v))
        self.past[..., kept], self.maneuver[..., kept] = past[..., before], maneuver[..., before]
        self._past(worlds, new)

    def append(self, worlds: Worlds, step: float) -> None:
        """Take in the truth of now, `step` [s] after the last."""
        if not abs(step - self.dt) < TICK:
            self._change(step)
        self.steady, self.first = self.steady + 1, None
        if self.end == len(self.t):
            self._shift(worlds.t)
        self.t[self.end] = worlds.t
        remember(
            self.past, self.maneuver, self.end, worlds.position, worlds.heading, worlds.v, worlds.ego[:, 2],
            SEEN_BRAKING * step, SEEN_ACROSS,
        )  # fmt: skip
        self.end += 1

    def _change(self, step: float) -> None:
        """Go on with another time step; the first that is known goes for the time before, too."""
        if self.first is not None:
            self.begin(self.first, step)
        else:
            self.steady, self.dt = 0, step

    def _shift(self, t: float) -> None:
        """Drop what is too old; make room where little is."""
        first = max(int(np.searchsorted(self.t, t - self.need - TICK)) - 2, 0)
        rows, size = self.end - first, len(self.t)
        if rows > size // 2:
            size *= 2
        times, past, maneuver = self.t, self.past, self.maneuver
        self.t = np.empty(size)
        self._make(size, past.shape[2])
        self.t[:rows], self.past[:, :rows] = times[first : self.end], past[:, first : self.end]
        self.maneuver[:, :rows] = maneuver[:, first : self.end]
        self.end = rows

    def lookups(self) -> StackedLookups:
        """Give what to look up now."""
        times = self.t[: self.end]
        of = [window.lookups(times, self.steady, self.dt) for window in self._windows]
        if self._look is None or any(map(is_not, of, self._look.of)):
            self._look = StackedLookups(of)  # for as long as the steps stay the same
        return self._look
