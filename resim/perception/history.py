"""The true past of the objects: where they were, how fast and which way, so long ago.

What is looked up is linear in the samples: a value at a time, its mean over a time, its slope. So each is a row of
weights over the last samples, and one product gives it for all objects and all sets of parameters at once; with equal
time steps the weights stay the same.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats
from resim.perception.model import Objects
from resim.perception.tables import Maneuvers
from resim.sim.perception import World

_SAME = 1e-9
"""s; below this two times are one."""
_STEP = 0.04
"""s; of the past that is laid out before the first step is known."""

Rows = NDArray[np.intp]
_COLUMNS = ("position", "v", "heading", "turned", "raw", "turns")


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


class _Lookup:
    """Rows of weights (R, k) over the samples from `first` to `last`, counted back from the newest."""

    def __init__(self, rows: Sequence[Floats]) -> None:
        table = np.array(rows)
        used = np.flatnonzero(table.any(axis=0))
        low, high = (int(used[0]), int(used[-1]) + 1) if len(used) else (table.shape[1] - 1, table.shape[1])
        self.first, self.last = table.shape[1] - low, table.shape[1] - high
        self.weights = np.ascontiguousarray(table[:, low:high])

    def of(self, samples: Floats, end: int) -> Floats:
        """Give (R, N) what is looked up in samples (T, N), of which `end` - 1 is the newest."""
        found: Floats = self.weights.dot(samples[end - self.first : end - self.last])
        return found


class Lookups:
    """All that is looked up in samples at `times` (K,) [s], of which the last is now, for sets of parameters."""

    def __init__(self, times: Floats, sets: Sequence[Objects]) -> None:
        now = float(times[-1])
        late = [s.latency for s in sets]
        self.position = _Lookup([at_time(times, now - one.position) for one in late])
        self.motion = _Lookup(
            [mean_over(times, now - s.latency.speed, s.averaging.speed) for s in sets]
            + [slope_at(times, now - one.speed) for one in late]
            + [mean_over(times, now - s.latency.heading, s.averaging.heading) for s in sets]
        )
        self.pooled = len(times) - int(np.searchsorted(times, now - late[0].speed + _SAME, side="right")) + 1


class History:
    """Positions, speeds, headings and sets of parameters of N objects over the last samples.

    sets: parameters, the pooled ones first. An object that is new has driven as it does now for ever.
    """

    def __init__(self, sets: Sequence[Objects]) -> None:
        self.sets = sets
        late = [
            (s.latency.position, s.latency.speed + 0.5 * s.averaging.speed,
             s.latency.heading + 0.5 * s.averaging.heading) for s in sets
        ]  # fmt: skip
        self.late_position, self.late_speed, self.late_heading = (
            max(c) > 0.0 for c in zip(*late, strict=True)
        )
        self.need = max(max(one) for one in late)
        self.known: dict[float, Lookups] = {}
        self.end = 0

    def clear(self) -> None:
        """Forget everything."""
        self.end = 0

    def begin(self, world: World, turned: Floats, dt: float = _STEP) -> None:
        """Lay out the time before the first sample, in steps of dt [s].

        turned: (N,) rad, pi less the headings against the EGO's.
        """
        self.dt, rows = dt, math.ceil(self.need / dt + _SAME) + 2
        self.samples, self.steady, self.end = 1, rows, rows
        self.t = np.empty(max(8 * rows, 128))
        self.t[:rows] = world.t - dt * np.arange(rows - 1, -1, -1)
        self._make(len(world.v))
        self._past(world, turned, np.arange(len(world.v)))
        self.first: tuple[World, Floats] | None = (world, turned)

    def _make(self, n: int) -> None:
        size = len(self.t)
        self.position, self.motion = np.empty((size, n), dtype=complex), np.zeros((size, 2 * n))
        self.turned, self.set, self.sorted = np.empty((size, n)), np.zeros((size, n), dtype=np.intp), 1
        self.raw, self.turns = np.zeros(n), np.zeros(n)
        self._share(n)

    def _share(self, n: int) -> None:
        """Give the parts of the arrays their names."""
        self.parts = self.position.view(float)
        self.v, self.heading = self.motion[:, :n], self.motion[:, n:]

    def _past(self, world: World, turned: Floats, new: Rows) -> None:
        """Fill the columns of new objects."""
        rows, heading = slice(0, self.end), world.heading[new]
        ago = self.t[rows, None] - world.t
        self.position[rows, new] = world.position[new] + ago * (world.v[new] * np.exp(1j * heading))
        self.v[rows, new], self.heading[rows, new] = world.v[new], heading
        self.turned[rows, new] = turned[new]
        self.raw[new] = heading

    def regroup(self, world: World, turned: Floats, kept: Rows, before: Rows, new: Rows) -> None:
        """Change the columns: those `before` go to `kept`, and `new` ones begin."""
        self.first = None  # the past keeps the steps that it has
        old = [getattr(self, name) for name in _COLUMNS]
        self._make(len(world.v))
        for name, of in zip(_COLUMNS, old, strict=True):
            getattr(self, name)[..., kept] = of[..., before]
        self._past(world, turned, new)

    def append(self, world: World, turned: Floats) -> None:
        """Take in the truth of now."""
        t, step = world.t, world.t - float(self.t[self.end - 1])
        if self.samples == 1 and self.first is not None and abs(step - self.dt) > _SAME:
            self.begin(*self.first, step)
        self.samples += 1
        if abs(step - self.dt) < _SAME:
            self.steady += 1
        else:
            self.steady, self.dt = 1, step
        if self.end == len(self.t):
            self._shift(t)
        k = self.end
        self.t[k], self.position[k], self.v[k] = t, world.position, world.v
        if len(self.sets) > 1:
            self.turned[k] = turned
        if self.late_heading:
            change = world.heading - self.raw
            if change.dot(change) > 1.0:
                self.turns -= 2.0 * math.pi * np.rint(change / (2.0 * math.pi))
            self.raw = world.heading
            np.add(world.heading, self.turns, self.heading[k])
        self.end = k + 1

    def _shift(self, t: float) -> None:
        """Drop what is too old, in place; make room where little is."""
        first = max(int(np.searchsorted(self.t, t - self.need - _SAME)) - 2, 0)
        rows = self.end - first
        grow = rows > len(self.t) // 2
        for name in ("t", "position", "motion", "turned", "set"):
            old = getattr(self, name)
            to = np.empty((2 * len(old), *old.shape[1:]), dtype=old.dtype) if grow else old
            to[:rows] = old[first : self.end].copy()
            setattr(self, name, to)
        self._share(self.position.shape[1])
        self.end = rows
        self.sorted = max(self.sorted - first, 1)

    def lookups(self) -> Lookups:
        """Give what to look up now."""
        if self.steady * self.dt > self.need + self.dt:
            key = round(self.dt, 9)
            found = self.known.get(key)
            if found is None:
                rows = math.ceil(self.need / self.dt + _SAME) + 2
                found = self.known[key] = Lookups(self.dt * np.arange(1.0 - rows, 1.0), self.sets)
            return found
        first = max(int(np.searchsorted(self.t[: self.end], self.t[self.end - 1] - self.need - _SAME)) - 1, 0)
        return Lookups(self.t[min(first, self.end - 2) : self.end], self.sets)

    def sets_of(self, look: Lookups, maneuvers: Maneuvers) -> Rows:
        """Give (N,) which set of parameters objects have: for what they did the pooled latency of speed ago."""
        row = self.end - look.pooled
        if row >= self.sorted:  # many rows at once
            rows, before = slice(self.sorted, self.end), slice(self.sorted - 1, self.end - 1)
            dt, gained = self.t[rows] - self.t[before], self.v[rows] - self.v[before]
            self.set[rows] = maneuvers.sets(self.turned[rows], self.v[rows], gained, dt[:, None])
            self.sorted = self.end
        found: Rows = self.set[row]
        return found

    def picks(self, chosen: Rows) -> tuple[Rows, Rows]:
        """Give what `seen` picks for the sets `chosen` (N,) of the objects."""
        n, sets = len(chosen), len(self.sets)
        columns = np.arange(n)
        block = np.array([[0], [sets], [2 * sets]])
        return chosen * n + columns, (block + chosen) * 2 * n + columns + np.array([[0], [0], [n]])

    def seen(
        self, look: Lookups, world: World, picks: tuple[Rows, Rows]
    ) -> tuple[NDArray[np.complex128], Floats, Floats, Floats]:
        """Give late positions (N,) in the map, speeds, accelerations, and headings without jumps of a turn."""
        places = world.position
        if self.late_position:
            places = look.position.of(self.parts, self.end).view(complex).take(picks[0])
        v, a, heading = look.motion.of(self.motion, self.end).take(picks[1])
        return places, v if self.late_speed else world.v, a, heading
