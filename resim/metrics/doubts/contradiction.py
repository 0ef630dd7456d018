"""What it is worth where position, speed and heading contradict each other: nobody knows which of them is right.

The way that speed and heading tell, less the way between the positions, is how far the object is off where it is given,
as far as it grows faster than noise and usual errors explain: r(t) = p(t) - ∫ v ds over windows of WINDOW, and over
longer ones, in which noise of positions hides less. Errors that
a track has throughout are no contradiction: a speed some percent off, a heading some degrees; nor is a box centre that
swings out in a turn. Who drives backwards may have a speed without sign, and filters
tell speeds late. Pedestrians walk in any direction.

A position that leaps farther than anybody drives from one sample to the next is off by as much, however often it does.

A heading that leaps, flickers or turns faster than the way that is driven allows is off as far as it does so.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from resim.core.clock import regular
from resim.core.geometry import Bools, Floats
from resim.core.objects import HARDEST
from resim.core.sightings import MOVES, Sightings
from resim.metrics.doubts.reach import CURVATURE
from resim.scenario.course import position_noise

WINDOW, CELL = 0.8, 0.1
"""Least time [s] over which ways and turns are compared, and from one comparison to the next."""
LONGER, LONGEST = 2.0, 13.0
"""Factor from one window to the next longer one, and the longest [s]: of 12.8 s."""
LEAP = 1.5
"""Way [m] from one sample to the next beyond what speed and hard braking explain, that is none of noise."""
SMOOTHING = 0.1
"""Time [s] to either side over which positions are averaged."""
RUN = 0.4
"""Time [s] that a contradiction lasts, before it is none."""
LEAST, NOISE, USUAL = 0.3, 6.0, 4.0
"""Difference of velocities [m/s], times the noise, and times the track's median difference, that are none."""
SPEED, HEADING = 0.03, 0.1
"""Part of the speed, and angle [rad], by which whole tracks are off at most."""
LATE, EXPLAINS = 1.0, 0.5
"""Time [s] by which filters tell a speed late, and the part of the difference that is left where that explains it."""
TURN = 0.05
"""Turn [rad] in a window that says nothing, whatever the way."""
FLICKER, OFTEN = 0.3, 0.95
"""Angle [rad] by which headings may be off their running median, but for the rest of this share of them."""
MEDIAN = 5
"""Samples of a running median."""
WORTH, FAR = 0.1, 0.5
"""Angle [rad] and distance [m] from which on a heading and a place are in doubt; splines are off as much at 0.9 g."""

_Complex = NDArray[np.complex128]
_Numbers = NDArray[Any]


def off_by(k: Sightings, *, walks: bool = False) -> tuple[float, float]:
    """Give how far [m] the object may be off along its heading, and across, by what its speed and heading tell."""
    t, state = k.t[k.usable], k.state[k.usable]
    if len(t) < 4 or t[-1] - t[0] < 2.0 * CELL:
        return 0.0, 0.0
    place, velocity, dt = state[:, 0] + 1j * state[:, 1], state[:, 3] + 1j * state[:, 4], np.diff(t)
    way = _sum(0.5 * (velocity[1:] + velocity[:-1]) * dt)
    leaps = np.abs(np.diff(place - way)) - 0.25 * HARDEST * dt**2
    leap = float(leaps.max()) if leaps.max() > LEAP else 0.0
    grid, windows = _grid(t)
    rest, averaged = _averaged(t, place - way)
    sums = [
        np.interp(grid, t, values)
        for values in (way, rest, _sum(0.25 * HARDEST * dt**2), np.unwrap(state[:, 2]))
    ]
    noise = NOISE * position_noise(t, place) * np.sqrt(2.0 / averaged)
    if walks:  # by the heading of a pedestrian nobody knows its way over long times
        windows = windows[:1]
    else:
        sums[:2] = _forwards(sums[0], sums[1], windows[0])
    most = np.hypot(np.ptp(sums[1].real), np.ptp(sums[1].imag))
    told, added = (_change(values, windows[0]) for values in sums[:2])
    late = _lateness(np.abs(told), np.abs(told + added))
    windows = [hop for hop in windows if hop < len(grid) - late]
    off = np.max([_off_in(hop, late, sums, noise, k.size[0], walks=walks) for hop in windows], axis=0)
    if not walks:  # windows that are long count a jump at an end of the track more than once
        off = np.minimum(off, most)
    if off.max() < FAR:
        return leap, leap
    along, across = np.maximum(off, leap).tolist()
    turned = 1.0 if walks else np.sin(min(float(np.ptp(np.unwrap(state[:, 2]))), 0.5 * np.pi))
    return along + turned * across, across + turned * along


def _forwards(way: _Numbers, rest: _Numbers, hop: int) -> list[_Numbers]:
    """The way that is told, and what positions add to it, where a speed without sign may be one backwards."""
    told, moved = _change(way, hop), _change(way + rest, hop)
    cells = np.clip(np.arange(len(way) - 1) - hop // 2, 0, len(told) - 1)
    backwards = ((moved * np.conj(told)).real < -0.5 * np.abs(told) ** 2)[cells]
    signed = way[0] + _sum(np.diff(way) * np.where(backwards, -1.0, 1.0))
    return [signed, way + rest - signed]


def _off_in(
    hop: int, late: int, sums: Sequence[_Numbers], noise: float, length: float, *, walks: bool
) -> Floats:
    """How far [m] it is off along and across, by windows of `hop` cells; speeds are told `late` cells later.

    sums: at the grid's times, the way that is told, what the positions add to it, what hides between samples [m], and
    the heading [rad]; noise: m, by which the change of an averaged position is off without any reason.
    """
    told, left, hidden, turn = (_change(values, hop) / (hop * CELL) for values in sums)
    moved = told + left
    told, moved = told[late:], moved[: len(moved) - late]
    loose = LEAST + hidden.real[: len(moved)] + noise / (hop * CELL)
    speed = np.maximum(np.abs(told), np.abs(moved))
    if walks:
        off = np.asarray(np.abs(moved) - np.abs(told), dtype=complex)
    else:
        off = (moved - told) * np.exp(-1j * np.angle(np.where(np.abs(told) > 0.0, told, moved)))
    swing = 0.5 * length * np.abs(turn[: len(moved)])
    cells = np.clip(np.arange(len(sums[0]) - 1 - late) - hop // 2, 0, len(off) - 1)
    along = _drift(off.real, SPEED, speed, loose, cells)
    return np.array([along, _drift(off.imag, HEADING, speed, loose + swing, cells)])


def _drift(off: Floats, most: float, speed: Floats, loose: Floats, cells: NDArray[np.intp]) -> float:
    """How far [m] the places drift away, by how fast (m,) [m/s] they do so in each window.

    What the track is off throughout is none: a part of the speed, up to `most`, with its spread. Where that does not
    hold all the time, nobody knows where it does. loose: (m,) m/s that say nothing; cells: which window each cell of
    the grid belongs to.
    """
    part = float(np.clip(np.median(off / np.maximum(speed, MOVES)), -most, most))
    rest = off - part * speed
    spread = np.minimum((most - abs(part)) * speed, USUAL * float(np.median(np.abs(rest))))
    changes = _integral(rest, np.abs(rest) > loose + spread, cells)
    return changes if changes < FAR else max(changes, _integral(off, np.abs(off) > loose, cells))


def _integral(off: Floats, bad: Bools, cells: NDArray[np.intp]) -> float:
    """How far [m] it goes in windows that are bad for long."""
    return float(np.ptp(_sum(np.where(_lasting(bad), off, 0.0)[cells] * CELL)))


def turned_by(k: Sightings) -> float:
    """Give by how much [rad] the heading of a vehicle may be off, to either side; front and rear are the same."""
    t, state = k.t[k.usable], k.state[k.usable]
    if len(t) < 4 or t[-1] - t[0] < 2.0 * CELL:
        return 0.0
    heading = np.unwrap(state[:, 2], period=np.pi)
    usual = median_filter(heading, MEDIAN, mode="nearest")
    flicker = float(np.quantile(np.abs(heading - usual), OFTEN))
    grid, (hop, *_) = _grid(t)
    way = _sum(
        np.maximum(np.hypot(*np.diff(state[:, :2], axis=0).T), np.hypot(*state[1:, 3:].T) * np.diff(t))
    )
    turn, driven = (_change(np.interp(grid, t, values), hop) for values in (usual, way))
    may = TURN + CURVATURE * driven + NOISE * position_noise(t, usual.astype(complex))
    excess = _sum(np.sign(turn) * np.maximum(np.abs(turn) - may, 0.0)) / hop
    off = max(float(np.ptp(excess)), flicker if flicker > FLICKER else 0.0)
    return min(off, 0.5 * np.pi) if off > WORTH else 0.0


def size_turned(size: tuple[float, float], by: float) -> tuple[float, float]:
    """Give length and width [m] of a box along the heading that holds one turned by up to so [rad]."""
    diagonal, corner = float(np.hypot(*size)), float(np.arctan2(size[1], size[0]))
    length = diagonal * np.cos(max(corner - by, 0.0))
    width = diagonal * np.sin(min(corner + by, 0.5 * np.pi))
    return float(length), float(width)


def _grid(t: Floats) -> tuple[Floats, list[int]]:
    """Times [s] a CELL apart, and how many of them windows span, the shortest first."""
    grid = regular(float(t[0]), float(t[-1] - t[0]), CELL)
    spans = WINDOW * LONGER ** np.arange(int(np.log(LONGEST / WINDOW) / np.log(LONGER)) + 1)
    return grid, sorted({min(round(span / CELL), len(grid) - 1) for span in spans.tolist()})


def _sum(steps: _Numbers) -> _Numbers:
    return np.concatenate([[0.0], np.cumsum(steps)])


def _change(values: _Numbers, hop: int) -> _Numbers:
    return np.asarray(values[hop:] - values[:-hop])


def _averaged(t: Floats, values: _Complex) -> tuple[_Complex, float]:
    """The mean over SMOOTHING to either side, and of how many samples it usually is."""
    a, b = (np.searchsorted(t, t + sign * (SMOOTHING + 1e-6)) for sign in (-1.0, 1.0))
    sums = _sum(values - values[0])
    return (sums[b] - sums[a]) / (b - a) + values[0], float(np.median(b - a))


def _lateness(told: _Numbers, moved: _Numbers) -> int:
    """How many cells later speeds are told, where that explains most of their difference; else 0."""

    def misfit(cells: int, late: int) -> float:
        return float(np.sqrt(np.mean((told[late : late + cells] - moved[:cells]) ** 2)))

    most = min(round(LATE / CELL), len(told) // 3)
    late = min(range(most + 1), key=lambda k: misfit(len(told) - most, k))
    cells = len(told) - late
    return late if misfit(cells, late) < EXPLAINS * misfit(cells, 0) else 0


def _lasting(bad: Bools) -> Bools:
    """The runs that last for RUN."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], bad, [False]])))
    out = np.zeros(len(bad), dtype=bool)
    for a, b in zip(edges[::2], edges[1::2], strict=True):
        out[a:b] = (b - a) * CELL > RUN - 0.5 * CELL or b - a == len(bad)
    return out
