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
_CHORD = 5.0
_APART = 2.0
"""m between places beyond the last one, and that measured ones may be apart."""


class OnWay(NamedTuple):
    """Who is on a way, (M,) each: gap [m] between bumpers, infinite for who is not; speed [m/s] along it."""

    gap: Floats
    v: Floats

    @property
    def ahead(self) -> Bools:
        """Who is on it."""
        return np.isfinite(self.gap)


class Boxed(NamedTuple):
    """M vehicles: position x + iy [m], heading [rad], v [m/s], length, width, z [m], NaN where not known."""

    position: NDArray[np.complex128]
    heading: Floats
    v: Floats
    length: Floats
    width: Floats
    z: Floats


class Way:
    """The way of one object: its places in the order of time, how far along it each is, and straight on after the last.

    count: how many places it has; the others are beyond.
    """

    def __init__(self, plan: Guide, row: int, length: float, width: float) -> None:
        k = np.flatnonzero(plan.present[row])
        self.first, self.count, self.length, self.width = int(k[0]), len(k), length, width
        place = plan.x[row, k] + 1j * plan.y[row, k]
        heading = np.unwrap(plan.heading[row, k])
        self.v, self.a = plan.v[row, k], plan.a[row, k]
        self.forwards = bool((self.v > -0.1).all())
        moved = (np.diff(place) * np.exp(-1j * heading[1:])).real
        # who creeps back and forth comes no further
        s = np.maximum.accumulate(np.concatenate([[0.0], np.cumsum(moved)]))
        beyond = np.arange(_APART, REACH, _APART)
        self.s = np.concatenate([s, s[-1] + beyond])
        self.position = np.concatenate([place, place[-1] + beyond * np.exp(1j * heading[-1])])
        self.heading = np.concatenate([heading, np.full(len(beyond), heading[-1])])
        z = np.full(len(k), np.nan) if plan.z is None else plan.z[row, k]
        self.z = np.concatenate([z, np.full(len(beyond), z[-1])])
        self._turn = np.exp(-1j * self.heading)

    def at_step(self, k: int) -> int:
        """Give the index of a step among its places; -1 where the object is not there."""
        return k - self.first if 0 <= k - self.first < self.count else -1

    def bend(self, s: float) -> float:
        """Give the curvature [1/m] of the way at s [m], of the chords to places 5 m before and after it.

        Headings turn on the spot where noise is all that moves who stands, places do not.
        """
        at = (s - _CHORD, s, s + _CHORD)
        before, here, after = np.interp(at, self.s, self.position.real) + 1j * np.interp(
            at, self.s, self.position.imag
        )
        if abs(here - before) < 0.5 * _CHORD or abs(after - here) < 0.5 * _CHORD:  # where it begins
            return 0.0
        return float(np.angle((after - here) / (here - before))) / _CHORD

    def columns(self, s: float) -> tuple[float, float, float]:
        """Give x, y [m] and heading [rad] at s [m]."""
        x, y = np.interp(s, self.s, self.position.real), np.interp(s, self.s, self.position.imag)
        return float(x), float(y), float(wrap_angle(np.interp(s, self.s, self.heading)))

    def others(self, s: float, others: Boxed) -> OnWay:
        """Say where others are, for an object at s [m] on its way: where they are on it first."""
        low, high = np.searchsorted(self.s, (s - 0.5 * self.length, s + REACH))
        begin = max(int(low) - 1, 0)
        window = slice(begin, max(int(high), begin + 1))
        off = (others.position[:, None] - self.position[window]) * self._turn[window]
        along, beside = off.real, np.abs(off.imag)
        turn = others.heading[:, None] - self.heading[window]
        c, d = np.abs(np.cos(turn)), np.abs(np.sin(turn))
        half_length = 0.5 * (others.length[:, None] * c + others.width[:, None] * d)
        half_width = 0.5 * (others.length[:, None] * d + others.width[:, None] * c)
        covers = (np.abs(along) < half_length + _APART) & (beside < 0.5 * self.width + half_width)
        centre = self.s[window] + along - s
        covers &= (centre > 0.0) & ~over(others.z[:, None], self.z[window])
        ahead = covers.any(axis=1)
        first = covers.argmax(axis=1)  # and from there on to where its middle is
        reach = self.s[window][first] + 2.0 * half_length[np.arange(len(first)), first] + _APART
        near = covers & (self.s[window] <= reach[:, None])
        at = np.arange(len(first)), np.where(near, np.abs(along), np.inf).argmin(axis=1)
        gap = np.where(ahead, centre[at] - half_length[at] - 0.5 * self.length, np.inf)
        return OnWay(gap, np.where(ahead, others.v * np.cos(turn[at]), 0.0))
