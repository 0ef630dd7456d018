"""The ways of traffic objects: where they were measured, as lines along which they may be slower."""

from __future__ import annotations

import math
from functools import cached_property
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
_FINE, _COARSE = 0.2, 1.0
"""m that points of a grid are apart at least, roughly, and at most."""


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

    def of(self, rows: list[int]) -> Boxed:
        """Give some of them."""
        position, heading, v, length, width, z = self
        return Boxed(position[rows], heading[rows], v[rows], length[rows], width[rows], z[rows])


class Line:
    """A line along which somebody drives, by its points (P,), and how far along the measured way each of them is.

    s: m along it. position: x + iy [m]. heading: rad, unwrapped. z: m, NaN where not known. station: m along the
    measured way, on which s is the same. done: s [m] at which the change of lanes that it holds is over. until: s [m]
    at which the lane ends. length, width: m, of who drives along it.
    """

    def __init__(
        self,
        position: NDArray[np.complex128],
        heading: Floats,
        s: Floats,
        station: Floats,
        z: Floats,
        size: tuple[float, float],
    ) -> None:
        self.position, self.heading, self.s, self.station, self.z = position, heading, s, station, z
        self.length, self.width = size
        self.done, self.until = -math.inf, math.inf
        self._turn = np.exp(-1j * heading)

    def station_at(self, s: float) -> float:
        """Give how far [m] along the measured way s [m] is."""
        return s if self.station is self.s else float(np.interp(s, self.s, self.station))

    def s_at(self, station: float) -> float:
        """Give s [m] of a place on the measured way [m]."""
        return station if self.station is self.s else float(np.interp(station, self.station, self.s))

    def places(self, s: float, position: NDArray[np.complex128]) -> tuple[Floats, Floats]:
        """Give how far [m] ahead of s, and to the left, positions (M,) are, by the nearest point within reach."""
        low, high = np.searchsorted(self.s, (s - REACH, s + REACH))
        window = slice(max(int(low) - 1, 0), int(high) + 1)
        off = position[:, None] - self.position[window]
        at = np.abs(off).argmin(axis=1)
        own = off[np.arange(len(at)), at] * self._turn[window][at]
        return self.s[window][at] + own.real - s, own.imag

    def bend(self, s: float, chord: float = _CHORD) -> float:
        """Give the curvature [1/m] of the line at s [m], of the chords [m] to places before and after it.

        Headings turn on the spot where noise is all that moves who stands, places do not.
        """
        at = (s - chord, s, s + chord)
        before, here, after = np.interp(at, self.s, self.position.real) + 1j * np.interp(
            at, self.s, self.position.imag
        )
        if abs(here - before) < 0.5 * chord or abs(after - here) < 0.5 * chord:  # where it begins
            return 0.0
        return float(np.angle((after - here) / (here - before))) / chord

    def columns(self, s: float) -> tuple[float, float, float]:
        """Give x, y [m] and heading [rad] at s [m]."""
        x, y = np.interp(s, self.s, self.position.real), np.interp(s, self.s, self.position.imag)
        return float(x), float(y), float(wrap_angle(np.interp(s, self.s, self.heading)))

    def others(self, s: float, others: Boxed) -> OnWay:
        """Say where others are, for who is at s [m] on the line: where they are on it first."""
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


class Way(Line):
    """The way of one object: its places in the order of time, how far along it each is, and straight on after the last.

    count: how many places it has; the others are beyond.
    """

    def __init__(self, plan: Guide, row: int, length: float, width: float) -> None:
        k = np.flatnonzero(plan.present[row])
        self.first, self.count = int(k[0]), len(k)
        place = plan.x[row, k] + 1j * plan.y[row, k]
        heading = np.unwrap(plan.heading[row, k])
        self.v, self.a = plan.v[row, k], plan.a[row, k]
        self.forwards = bool((self.v > -0.1).all())
        moved = (np.diff(place) * np.exp(-1j * heading[1:])).real
        # who creeps back and forth comes no further
        s = np.maximum.accumulate(np.concatenate([[0.0], np.cumsum(moved)]))
        beyond = np.arange(_APART, REACH, _APART)
        s = np.concatenate([s, s[-1] + beyond])
        z = np.full(len(k), np.nan) if plan.z is None else plan.z[row, k]
        super().__init__(
            np.concatenate([place, place[-1] + beyond * np.exp(1j * heading[-1])]),
            np.concatenate([heading, np.full(len(beyond), heading[-1])]),
            s,
            s,
            np.concatenate([z, np.full(len(beyond), z[-1])]),
            (length, width),
        )

    def at_step(self, k: int) -> int:
        """Give the index of a step among its places; -1 where the object is not there."""
        return k - self.first if 0 <= k - self.first < self.count else -1

    @property
    def end(self) -> float:
        """s [m] of its last measured place."""
        return float(self.s[self.count - 1])

    @cached_property
    def grid(self) -> Line:
        """The same line with points 0.2 to 1 m apart, as nearly as places allow: who stood for long has one."""
        s = self.s[np.append(True, np.diff(np.floor(self.s / _FINE)) > 0.0)]
        s = s[np.append(True, np.diff(s) > 0.25 * _FINE)]
        while len(s) > 1 and (gaps := np.diff(s)).max() > _COARSE:
            s = np.sort(np.append(s, (s[:-1] + 0.5 * gaps)[gaps > _COARSE]))
        x, y, heading, z = (
            np.interp(s, self.s, c) for c in (self.position.real, self.position.imag, self.heading, self.z)
        )
        return Line(x + 1j * y, heading, s, s, z, (self.length, self.width))
