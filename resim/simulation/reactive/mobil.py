"""Whether to change lanes: Minimizing Overall Braking Induced by Lane changes (Kesting, Treiber, Helbing 2007).

A driver changes if nobody has to brake hard for it, and if it gains more by it than the others lose, these times a
politeness. What somebody would do, accelerations of the Intelligent Driver Model tell.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from resim.core.geometry import Bools, Floats
from resim.simulation.reactive.drivers import TrafficDriver, wanted
from resim.simulation.reactive.ways import Boxed

MARGIN = 0.3
"""m to the side that are left to who counts as in another lane."""

_BRAKES, _ROOM = 1.0, 1.0
"""m/s² by which who is ahead may brake at least while somebody gets by, and m that are left then."""


class Body(NamedTuple):
    """Who wants to change: speed [m/s], length and width [m]."""

    v: float
    length: float
    width: float


class Nearest(NamedTuple):
    """Who is next to somebody in a lane: row among the others, -1 for nobody; gap [m], infinite then; speed [m/s]."""

    row: int = -1
    gap: float = math.inf
    v: float = 0.0
    length: float = 0.0


class InLane(NamedTuple):
    """Who is next in a lane, ahead and behind."""

    ahead: Nearest
    behind: Nearest


def in_lane(s: Floats, d: tuple[Floats, Floats], others: Boxed, own: Body, hidden: Bools) -> InLane:
    """Give who is next in a lane.

    s: how far (M,) [m] others are ahead. d: between which offsets (M,) [m] from the lane's centre they are, now and
    soon. hidden: who does not count.
    """
    reach = 0.5 * (own.width + others.width) + MARGIN
    there = (d[0] < reach) & (d[1] > -reach) & ~hidden
    gap = np.abs(s) - 0.5 * (own.length + others.length)

    def nearest(rows: Bools) -> Nearest:
        if not rows.any():
            return Nearest()
        row = int(np.where(rows, gap, np.inf).argmin())
        return Nearest(row, float(gap[row]), float(others.v[row]), float(others.length[row]))

    return InLane(nearest(there & (s >= 0.0)), nearest(there & (s < 0.0)))


def wants(driver: TrafficDriver, v: float, ahead: Nearest, hardest: float) -> float:
    """Give what a driver does [m/s²] at v [m/s] behind somebody, braking no harder than `hardest` [m/s²]."""
    return max(float(wanted(driver, v, np.array([ahead.gap]), np.array([ahead.v]))[0]), -hardest)


def moved_in(
    behind: Nearest, own: Body, lane: InLane, time: float, driver: TrafficDriver, hardest: float
) -> tuple[float, float]:
    """Give what the one behind does [m/s²] before somebody changes into his lane, and after.

    time: s from now until he is there: by then the gap is smaller, if who is behind is faster.
    """
    if behind.row < 0:
        return 0.0, 0.0
    whole = behind.gap + own.length + lane.ahead.gap
    left = max(behind.gap - max(behind.v - own.v, 0.0) * time, 0.0)
    before = wants(driver, behind.v, lane.ahead._replace(gap=whole), hardest)
    return before, wants(driver, behind.v, Nearest(0, left, own.v), hardest)


def moved_out(behind: Nearest, own: Body, lane: InLane, driver: TrafficDriver, hardest: float) -> float:
    """Give what the one behind gains [m/s²] where somebody leaves the lane between him and who is ahead."""
    if behind.row < 0:
        return 0.0
    whole = behind.gap + own.length + lane.ahead.gap
    after = wants(driver, behind.v, lane.ahead._replace(gap=whole), hardest)
    return after - wants(driver, behind.v, Nearest(0, behind.gap, own.v), hardest)


def gets_by(length: float, v: float, ahead: Nearest, brakes: float) -> bool:
    """Say whether somebody at v [m/s] is aside of who is ahead, after length [m], before it is where that one is.

    brakes: how hard [m/s²] that one brakes now; it is taken to brake by 1 m/s² at least, down to a stop.
    """
    time, hard, v_ahead = length / max(v, 0.1), max(brakes, _BRAKES), max(ahead.v, 0.0)
    braking = min(time, v_ahead / hard)
    return length + _ROOM < ahead.gap + v_ahead * braking - 0.5 * hard * braking**2
