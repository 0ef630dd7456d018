"""What a driver who looks for another lane sees of others: who is in a lane, or soon will be, and how they drive."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats
from resim.core.levels import over
from resim.simulation.guide import Guide
from resim.simulation.reactive.drivers import TrafficDriver
from resim.simulation.reactive.handed import Handed
from resim.simulation.reactive.mobil import Body, InLane, Nearest, in_lane
from resim.simulation.reactive.people import boxed, traffic_driver, usual_driver, way_of
from resim.simulation.reactive.settings import ReactiveSettings
from resim.simulation.reactive.ways import Boxed
from resim.simulation.traffic import Stage

_TOWED, _BESIDE = 3.0, 2.0
"""m behind a vehicle, and to the side of its way, up to which a trailer is its own."""
_AHEAD, _MOMENT = 1.5, 0.05
"""s for which the EGO goes on to the side as it does now, and over which that is seen."""

Places = Callable[[NDArray[np.complex128]], tuple[Floats, Floats]]
"""Tells of positions (M,) how far [m] ahead in a lane, and to the left of its centre, they are."""


@dataclass(frozen=True, eq=False)
class ChangingDriver:
    """Who looks for another lane, and what it sees at a step k: all others, and by rows of the stage who they are.

    want: what it does where it is [m/s²]. cap: what it does at most, so as to be no faster than it may be.
    """

    row: int
    one: Handed
    driver: TrafficDriver
    k: int
    rows: list[int]
    others: Boxed
    want: float
    cap: float
    body: Body


class Sight:
    """What drivers see in one run. plan: where all are. now: who was handed over."""

    def __init__(self, stage: Stage, settings: ReactiveSettings, plan: Guide, now: dict[int, Handed]) -> None:
        self.stage, self.settings, self.plan, self.now = stage, settings, plan, now
        self.dt = float(plan.t[1] - plan.t[0])
        how = settings.lane_change
        self.times = np.arange(1.0, how.duration + how.lasting)
        """s from now at which others are looked at, too."""

    def lane(self, me: ChangingDriver, places: Places, *, soon: bool) -> InLane:
        """Give who is next in a lane; soon: or will be, until one had changed to it and been there for a while."""
        s, d = places(me.others.position)
        low, high = d.copy(), d.copy()
        for one, position in self._soon(me) if soon else ():
            later = places(position)[1]
            low[one], high[one] = np.fmin(low[one], later), np.fmax(high[one], later)
        if soon:
            moved = places(me.others.position + me.others.v * _MOMENT * np.exp(1j * me.others.heading))[1]
            drift = np.where(np.array(me.rows) == 0, (moved - d) * (_AHEAD / _MOMENT), 0.0)
            low, high = np.fmin(low, d + drift), np.fmax(high, d + drift)
        line = me.one.line
        z = np.interp(me.one.s + s, line.s, line.z, left=np.nan, right=np.nan)
        return in_lane(s, (low, high), me.others, me.body, over(me.others.z, z))

    def _soon(self, me: ChangingDriver) -> Iterator[tuple[NDArray[np.intp], NDArray[np.complex128]]]:
        """Which others are where soon, by index among them."""
        rows, measured = np.array(me.rows), self.stage.plan
        traced = np.array([row != 0 and row not in self.now for row in me.rows])
        for step in np.rint(self.times / self.dt).astype(int).tolist():
            k = me.k + step
            if k < len(measured.t):
                there = np.flatnonzero(traced & measured.present[rows, k])
                yield there, measured.x[rows[there], k] + 1j * measured.y[rows[there], k]
        for n, row in enumerate(me.rows):
            one = self.now.get(row)
            if one is not None:
                ahead = np.maximum(one.s + one.v * self.times, 0.0).tolist()
                for s in [*ahead, max(one.line.done, one.s)]:
                    x, y, _ = one.line.columns(s)
                    yield np.array([n]), np.array([x + 1j * y])

    def driver(self, me: ChangingDriver, other: Nearest) -> TrafficDriver:
        """Give the driver of one of the others; the EGO's is the usual one of its kind."""
        row = me.rows[other.row]
        own = None if row == 0 else traffic_driver(self.stage, self.settings, row)
        return own or usual_driver(self.stage, self.settings, row)

    def braking(self, k: int, row: int) -> float:
        """Give how hard [m/s²] somebody brakes at step k; 0 where that is not known."""
        before, now = self.plan.v[row, [max(k - 1, 0), k]].tolist()
        return max((before - now) / self.dt, 0.0) if np.isfinite(before) else 0.0

    def going(self, k: int, row: int) -> NDArray[np.complex128]:
        """Give where somebody is at step k, and where it is soon, x + iy (2,) [m], if it goes on as it does."""
        p = self.plan
        along = p.v[row, k] * np.exp(1j * p.heading[row, k]) * np.array([0.0, _AHEAD])
        return np.asarray(p.x[row, k] + 1j * p.y[row, k] + along)

    def tows(self, me: ChangingDriver) -> bool:
        """Say whether a trailer was close behind it when measured, which would go straight on."""
        members, measured = self.stage.members, boxed(self.stage, self.stage.plan, me.k)
        trailers = [row for row in me.rows if members[row].kind == "trailer"]
        if not trailers:
            return False
        way = way_of(self.stage, me.row)
        s, d = way.places(float(way.s[way.at_step(me.k)]), measured.position[trailers])
        gap = -s - 0.5 * (me.body.length + measured.length[trailers])
        return bool(((gap > -me.body.length) & (gap < _TOWED) & (np.abs(d) < _BESIDE)).any())
