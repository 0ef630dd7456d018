"""The ways of traffic objects: where they were measured, as paths along which they may be slower."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Bools, Floats, wrap_angle
from resim.core.levels import over
from resim.simulation.guide import Guide

REACH = 150.0
"""m ahead that a driver looks."""
_BESIDE = 30.0
"""m from a way, beyond which nobody is on it."""
Rows = NDArray[np.intp]


class OnWay(NamedTuple):
    """Who is on a way, (M,) each: gap [m] between bumpers, infinite for who is not; speed [m/s] along it; who is."""

    gap: Floats
    v: Floats
    ahead: Bools


class Boxed(NamedTuple):
    """M vehicles: position x + iy [m], heading [rad], v [m/s], length, width, z [m], NaN where not known."""

    position: NDArray[np.complex128]
    heading: Floats
    v: Floats
    length: Floats
    width: Floats
    z: Floats


class Way:
    """The way of one object: its places in the order of time, and how far along it each is."""

    def __init__(self, plan: Guide, row: int, length: float, width: float) -> None:
        self.steps = np.flatnonzero(plan.present[row])
        k = self.steps
        self.first, self.length, self.width = int(k[0]), length, width
        self.position = plan.x[row, k] + 1j * plan.y[row, k]
        self.heading, self.v, self.a = (
            np.unwrap(plan.heading[row, k]), plan.v[row, k].copy(), plan.a[row, k].copy(),
        )  # fmt: skip
        self.s = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(self.position)))])
        self.z = np.full(len(k), np.nan) if plan.z is None else plan.z[row, k]
        self.forwards = bool((self.v > -0.1).all())

    def at_step(self, k: int) -> int:
        """Give the index of a step among its places; -1 where the object is not there."""
        return k - self.first if 0 <= k - self.first < len(self.steps) else -1

    def columns(self, s: float, v: float, a: float) -> tuple[float, float, float, float, float, float]:
        """Give x, y, heading, v, a, yaw rate of who is at s [m] with v [m/s] and a [m/s²]."""
        x, y = np.interp(s, self.s, self.position.real), np.interp(s, self.s, self.position.imag)
        j = min(max(int(np.searchsorted(self.s, s, side="right")) - 1, 0), len(self.s) - 2)
        j = max(j, 0)
        heading = float(np.interp(s, self.s, self.heading))
        after = min(j + 1, len(self.s) - 1)
        far = self.s[after] - self.s[j]
        bend = (self.heading[after] - self.heading[j]) / far if far > 0.01 else 0.0
        return float(x), float(y), float(wrap_angle(heading)), v, a, float(bend * v)

    def others(self, s: float, others: Boxed) -> OnWay:
        """Say where others are, for an object at s [m] on its way."""
        low, high = np.searchsorted(self.s, (s - 0.5 * self.length, s + REACH))
        window = slice(max(int(low) - 1, 0), max(int(high), int(low)) + 1)
        way = self.position[window]
        away = others.position[:, None] - way[None, :]
        nearest = np.argmin(away.real**2 + away.imag**2, axis=1)
        index = window.start + nearest
        heading, off = self.heading[index], away[np.arange(len(nearest)), nearest]
        along = off.real * np.cos(heading) + off.imag * np.sin(heading)
        beside = off.imag * np.cos(heading) - off.real * np.sin(heading)
        turn = others.heading - heading
        c, d = np.abs(np.cos(turn)), np.abs(np.sin(turn))
        half_length = 0.5 * (others.length * c + others.width * d)
        half_width = 0.5 * (others.length * d + others.width * c)
        centre = self.s[index] + along - s
        # who is beyond the window's end is not on the way that is known
        inside = np.abs(along) <= np.maximum(half_length, 1.0) + np.where(index == window.start, 0.0, 5.0)
        ahead = (centre > 0.0) & (np.abs(beside) < 0.5 * self.width + half_width) & inside
        ahead &= (np.abs(off) < _BESIDE) & ~over(others.z, self.z[index])
        gap = np.where(ahead, centre - half_length - 0.5 * self.length, np.inf)
        return OnWay(gap, np.where(ahead, others.v * np.cos(turn), 0.0), ahead)
