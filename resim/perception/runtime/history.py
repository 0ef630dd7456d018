"""The true past of the objects: where they were, how fast and which way, so long ago.

What is looked up is linear in the samples: a value at a time, its mean over a time, its slope. So each is a row of
weights over the last samples; with equal time steps the weights stay the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats
from resim.perception.model import Objects
from resim.perception.runtime.kernel import HEADING, MANEUVER, V, X, Y, remember
from resim.scenario.maneuvers import SEEN_ACROSS, SEEN_BRAKING, momentary
from resim.simulation.perception import World

_SAME = 1e-9
"""s; below this two times are one."""
_STEP = 0.04
"""s; of the past that is laid out before the first step is known."""

Rows = NDArray[np.intp]


def at_time(times: Floats, t: float) -> Floats:
    """Give the weights of samples at `times` (K,) [s, increasing] in the linear interpolation at t."""
    weights = np.zeros(len(times))
    k = min(max(int(np.searchsorted(times, t)), 1), len(times) - 1)
    part = (t - times[k - 1]) / (times[k] - times[k - 1])
    weights[k - 1 : k + 1] = 1.0 - part, part
    weights[np.abs(weights) < _SAME] = 0.0
    weights /= weights.sum()
    return weights


def mean_over(times: Floats, t: float, over: float) -> Floats:
    """Give the weights of samples in the mean of their linear interpolation from t - over/2 to t + over/2 [s]."""
    if over < _SAME:
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
    k = min(max(int(np.searchsorted(times, t - _SAME)), 1), len(times) - 1)
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
        last = int(np.searchsorted(times, now - sets[0].latency.speed + _SAME, side="right"))
        self.settled = len(times) - last + 1


class History:
    """The past (5, T, N) of N objects, as the kernel writes it, at times t (T,) [s]; its samples go up to `end`.

    sets: parameters, the pooled ones first; set_of (4,): which of them each of MANEUVERS has. An object that is new has
    driven as it does now for ever.
    """

    def __init__(self, sets: Sequence[Objects], set_of: Rows) -> None:
        self.sets, self.set_of = sets, set_of
        self.need = max(
            max(s.latency.position, s.latency.speed + 0.5 * s.averaging.speed,
                s.latency.heading + 0.5 * s.averaging.heading) for s in sets
        )  # fmt: skip
        self.unwrap = any(s.latency.heading > 0.0 for s in sets)
        self.known: dict[float, Lookups] = {}
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self.end = 0
        self.look: Lookups | None = None

    def begin(self, world: World, dt: float = _STEP) -> None:
        """Lay out the time before the first sample, in steps of dt [s]."""
        self.dt, self.look, rows = dt, None, math.ceil(self.need / dt + _SAME) + 2
        self.steady = self.end = rows
        self.t = np.empty(max(8 * rows, 128))
        self.t[:rows] = world.t - dt * np.arange(rows - 1, -1, -1)
        self.past = np.empty((5, len(self.t), len(world.v)))
        self._past(world, np.arange(len(world.v)))
        self.first: World | None = world

    def _past(self, world: World, new: Rows) -> None:
        """Fill the columns of new objects."""
        past, heading, v = self.past[:, : self.end], world.heading[new], world.v[new]
        ago = self.t[: self.end, None] - world.t
        position = world.position[new] + ago * (v * np.exp(1j * heading))
        past[X][:, new], past[Y][:, new] = position.real, position.imag
        past[V][:, new], past[HEADING][:, new] = v, heading
        past[MANEUVER][:, new] = momentary(heading - world.ego.heading, v, 0.0)

    def regroup(self, world: World, kept: Rows, before: Rows, new: Rows) -> None:
        """Change the columns: those `before` go to `kept`, and `new` ones begin."""
        self.first = None  # the past keeps the steps that it has
        old, self.past = self.past, np.empty((5, len(self.t), len(world.v)))
        self.past[..., kept] = old[..., before]
        self._past(world, new)

    def append(self, world: World, step: float) -> None:
        """Take in the truth of now, `step` [s] after the last."""
        if not abs(step - self.dt) < _SAME:
            self._change(step)
        self.steady, self.first = self.steady + 1, None
        if self.end == len(self.t):
            self._shift(world.t)
        self.t[self.end] = world.t
        remember(
            self.past, self.end, world.position, world.heading, world.v, world.ego.heading, SEEN_BRAKING * step,
            SEEN_ACROSS, self.unwrap,
        )  # fmt: skip
        self.end += 1

    def _change(self, step: float) -> None:
        """Go on with another time step; the first that is known goes for the time before, too."""
        if self.first is not None:
            self.begin(self.first, step)
        else:
            self.steady, self.dt, self.look = 0, step, None

    def _shift(self, t: float) -> None:
        """Drop what is too old, in place; make room where little is."""
        first = max(int(np.searchsorted(self.t, t - self.need - _SAME)) - 2, 0)
        rows, size = self.end - first, len(self.t)
        if rows > size // 2:
            size *= 2
        times, past = np.empty(size), np.empty((5, size, self.past.shape[2]))
        times[:rows], past[:, :rows] = self.t[first : self.end], self.past[:, first : self.end]
        self.t, self.past, self.end = times, past, rows

    def lookups(self) -> Lookups:
        """Give what to look up now."""
        if self.look is None and self.steady * self.dt > self.need + self.dt:
            key = round(self.dt, 9)
            if key not in self.known:
                rows = math.ceil(self.need / self.dt + _SAME) + 2
                self.known[key] = Lookups(key * np.arange(1.0 - rows, 1.0), self.sets)
            self.look = self.known[key]  # for as long as the steps stay the same
        if self.look is not None:
            return self.look
        first = max(int(np.searchsorted(self.t[: self.end], self.t[self.end - 1] - self.need - _SAME)) - 1, 0)
        return Lookups(self.t[min(first, self.end - 2) : self.end], self.sets)
