"""Traffic that reacts, in one run: objects keep to their traces until the EGO makes their drivers do otherwise.

An object is handed over where its driver would brake harder than in the measured drive, and harder than its trace
does, for the EGO or another object that is not where it was measured. From then on it drives along its measured way,
behind whoever is on it. It never gets ahead of its trace, and where it has caught up it is back on it. Where all are
where they were measured, nobody is handed over.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from resim.core.clock import TICK
from resim.core.geometry import Floats
from resim.simulation.case import HandedOver
from resim.simulation.guide import Guide
from resim.simulation.perception import Worlds
from resim.simulation.reactive.drivers import GRID, Following, TrafficDriver, driver_of, fitted, wanted
from resim.simulation.reactive.settings import ReactiveSettings
from resim.simulation.reactive.ways import REACH, Boxed, Way
from resim.simulation.traffic import Phase, Stage

_SLOW = 0.5
"""m/s below which nobody is handed over: who stands has nothing to brake for."""
_OFF = 1e-6
"""m or m/s from where it was measured, up to which the EGO is there: what rounding leaves."""
_ASIDE, _BENDS = 10.0, 0.5
"""m beside an object, and more per m ahead, beyond which nobody is on its way before it is nearer."""
_BACK = 0.05
"""m behind its trace at which an object is back on it, if its driver wants to brake no harder than that."""
_ASIDE_MOST = 4.0
"""m/s² to the side, beyond which a driver who is later than its trace takes no bend."""
_TOLD = -99.0
"""m/s², the hardest braking that is told in figures."""
_CLOSE = 0.2
"""Share of what its driver would brake by in the measured drive, by which it has to be harder at least."""


@dataclass(eq=False)
class _Handed:
    """One object that a driver drives: s [m] on its way, v and what it does now [m/s²], and what it wants later."""

    since: float
    why: str
    s: float
    v: float
    a: float
    later: deque[float]
    back: float | None = None
    behind: list[tuple[float, float, float]] = field(default_factory=list)
    """When [s] how far [m] it was behind its trace, and what it did [m/s²]."""


@dataclass(eq=False)
class ReactiveTraffic:
    """The traffic of one run. plan: where all are, which changes as the run goes on."""

    stage: Stage
    settings: ReactiveSettings
    plan: Guide = field(init=False)

    def __post_init__(self) -> None:
        measured = self.stage.plan
        self.measured = measured
        names = ("x", "y", "heading", "v", "a", "yaw_rate")
        changing = {name: getattr(measured, name).copy() for name in names}
        z = None if measured.z is None else measured.z.copy()
        self.plan = replace(measured, **changing, z=z)
        self.dt = float(measured.t[1] - measured.t[0])
        self.members = self.stage.members
        self.now: dict[int, _Handed] = {}
        self.past: list[tuple[int, _Handed]] = []

    def worlds(self, phase: Phase, k: int, ego: Floats, ego_z: Floats | None) -> Worlds:
        """Give the truth at step k, as `Phase.worlds` does of traffic on its traces."""
        told = phase.worlds(k, ego, ego_z)
        if not self.now:
            return told
        p, rows = self.plan, phase.rows
        told = told._replace(
            position=p.x[rows, k] + 1j * p.y[rows, k], heading=p.heading[rows, k], v=p.v[rows, k]
        )
        return told if p.z is None else told._replace(z=p.z[rows, k])

    def places(self, phase: Phase, k: int) -> Floats | None:
        """Give x, y, heading, v (4, n) of a phase's objects at step k; None where all are on their traces."""
        p = self.plan
        return np.stack([c[phase.rows, k] for c in (p.x, p.y, p.heading, p.v)]) if self.now else None

    def advance(self, k: int, ego: Floats, z: float) -> None:
        """Move the objects that were handed over to step k + 1; ego (6,): where the EGO is at step k, z [m] there."""
        measured = np.array(self.measured.state(0, k))
        moved = not np.isfinite(measured).all() or np.abs(ego[:4] - measured[:4]).max() > _OFF
        if not moved and not self.now:
            return
        p = self.plan
        for column, value in zip((p.x, p.y, p.heading, p.v), ego[:4].tolist(), strict=True):
            column[0, k] = value
        if p.z is not None:
            p.z[0, k] = z
        all_, off = _boxed(self.stage, p, k), [*([0] if moved else []), *self.now]
        for row in self._near(k, all_, off):
            self._look(row, k, all_, off)
        for row in [*self.now]:
            self._drive(row, k, all_)

    def ended(self, t: float) -> tuple[HandedOver, ...]:
        """Give who was handed over up to a time [s], in the order of time."""
        told = []
        for row, one in [*self.past, *self.now.items()]:
            if one.since > t:
                continue
            until = [part for part in one.behind if part[0] <= t + TICK]
            farthest = max((part[1] for part in until), default=0.0)
            hardest = max((-part[2] for part in until), default=0.0)
            back = one.back if one.back is not None and one.back <= t + TICK else None
            told.append(
                HandedOver(self.members[row].id, one.since, one.why, back, farthest, max(hardest, 0.0))
            )
        return tuple(sorted(told, key=lambda one: (one.t, one.id)))

    def _near(self, k: int, all_: Boxed, off: list[int]) -> list[int]:
        """Who is on a trace, has a driver, and comes near somebody who is not where it was measured."""
        away = (all_.position[off] - all_.position[:, None]) * np.exp(-1j * all_.heading)[:, None]
        along, beside = away.real, np.abs(away.imag)
        near = ((along > 0.0) & (along < REACH) & (beside < _ASIDE + _BENDS * along)).any(axis=1)
        near[0] = False
        return [row for row in np.flatnonzero(near).tolist() if row not in self.now and self._driver(row)]

    def _driver(self, row: int) -> TrafficDriver | None:
        return traffic_driver(self.stage, self.settings, row)

    def _look(self, row: int, k: int, all_: Boxed, off: list[int]) -> None:
        """Hand an object over, if it would not keep to its trace."""
        way, driver = way_of(self.stage, row), self._driver(row)
        at = way.at_step(k)
        assert driver is not None
        if not 0 <= at < way.count - 1:
            return
        others = [m for m in off if m != row]
        s, v, a = float(way.s[at]), float(way.v[at]), float(way.a[at])
        found = way.others(s, _of(all_, others))
        if v < _SLOW or not (found.ahead & (found.gap > 0.0)).any():  # too late for a driver to do anything
            return
        want = wanted(driver, v, found.gap, found.v)
        first = int(np.argmin(want))
        there = way.others(s, _of(_boxed(self.stage, self.measured, k), others))
        meant = min(float(wanted(driver, v, there.gap, there.v).min()), 0.0)
        least = float(want[first])
        if least >= min(meant, a) - max(self.settings.hand_over.harder, -_CLOSE * meant):
            return
        least, meant = (max(one, _TOLD) for one in (least, meant))
        did = (
            f"not below {meant:.1f} m/s² in the measured drive"
            if there.ahead.any()
            else "nobody was there when measured"
        )
        who = f"{self.members[others[first]].id} {found.gap[first]:.1f} m ahead at {found.v[first]:.1f} m/s"
        why = f"at {v:.1f} m/s with {who} its driver wants {least:.1f} m/s²; {did}"
        late = round(driver.reaction / self.dt)
        self.now[row] = _Handed(float(self.plan.t[k]), why, s, v, a, deque([a] * late))

    def _drive(self, row: int, k: int, all_: Boxed) -> None:
        """Move an object along its way to step k + 1."""
        one, way, driver = self.now[row], way_of(self.stage, row), self._driver(row)
        at = way.at_step(k + 1)
        assert driver is not None
        if at < 0:  # it was not seen any longer
            self.past.append((row, self.now.pop(row)))
            return
        found = way.others(one.s, _of(all_, [m for m in range(len(self.members)) if m != row]))
        want = float(np.min(wanted(driver, one.v, found.gap, found.v), initial=driver.acceleration))
        want = max(want, -self.settings.hand_over.hardest)
        one.later.append(want)
        late = one.later.popleft()
        attentive = float(self.plan.t[k]) - one.since >= driver.reaction
        a = want if attentive and want < -driver.deceleration else late
        v = max(min(one.v + a * self.dt, self._fastest(one, way, driver, at)), 0.0)
        s = one.s + 0.5 * (one.v + v) * self.dt
        caught_up = (
            s >= float(way.s[at]) - _BACK and abs(v - float(way.v[at])) <= driver.deceleration * self.dt
        )
        if caught_up and want >= min(float(way.a[at]), 0.0):
            one.back = float(self.plan.t[k + 1])
            self.past.append((row, self.now.pop(row)))
            return
        s = min(s, float(way.s[at]))
        one.a, one.s, one.v = (v - one.v) / self.dt, s, v
        one.behind.append((float(self.plan.t[k + 1]), float(way.s[at]) - s, one.a))
        p, (x, y, heading) = self.plan, way.columns(s)
        columns = (x, y, heading, v, one.a, way.bend(s) * v)
        for column, value in zip((p.x, p.y, p.heading, p.v, p.a, p.yaw_rate), columns, strict=True):
            column[row, k + 1] = value
        if p.z is not None:
            p.z[row, k + 1] = np.interp(s, way.s, way.z)

    def _fastest(self, one: _Handed, way: Way, driver: TrafficDriver, at: int) -> float:
        """How fast [m/s] an object may be at place `at` of its way: to catch up with its trace, and in bends.

        It slows down for that no harder than is comfortable.
        """
        behind = max(float(way.s[at - 1]) - one.s, 0.0)
        most = float(way.v[at]) + math.sqrt(2.0 * self.settings.hand_over.catch_up * behind)
        for ahead in (0.0, one.v):
            bend = max(abs(way.bend(one.s + ahead)), 1e-9)
            slow = float(np.interp(one.s + ahead, way.s[: way.count], way.v))
            most = min(most, max(slow, math.sqrt(_ASIDE_MOST / bend)))
        return max(most, one.v - driver.deceleration * self.dt)


def _of(every: Boxed, rows: list[int]) -> Boxed:
    position, heading, v, length, width, z = every
    return Boxed(position[rows], heading[rows], v[rows], length[rows], width[rows], z[rows])


def _boxed(stage: Stage, plan: Guide, k: int) -> Boxed:
    """All of them, EGO first, where a plan has them at step k."""
    z = np.full(len(stage.members), np.nan) if plan.z is None else plan.z[:, k]
    place = plan.x[:, k] + 1j * plan.y[:, k]
    return Boxed(place, plan.heading[:, k], plan.v[:, k], stage.length, stage.width, z)


@lru_cache(maxsize=8)
def _known(stage: Stage) -> tuple[dict[int, Way], dict[tuple[int, ReactiveSettings], TrafficDriver | None]]:
    """Ways and drivers of a stage that were asked for."""
    return {}, {}


def way_of(stage: Stage, row: int) -> Way:
    """Give the way of an object of a stage."""
    ways, _ = _known(stage)
    if row not in ways:
        ways[row] = Way(stage.plan, row, stage.members[row].length, stage.members[row].width)
    return ways[row]


def traffic_driver(stage: Stage, settings: ReactiveSettings, row: int) -> TrafficDriver | None:
    """Give the driver of an object; None for who has none: a pedestrian, who reverses, who is there for a step."""
    _, drivers = _known(stage)
    if (row, settings) not in drivers:
        kind, way = settings.of(stage.members[row].kind), way_of(stage, row)
        driver = None
        if kind is not None and way.forwards and way.count > 1:
            driver = driver_of(kind, way.v)
            driver = fitted(driver, [*followings(stage, row)]) if settings.calibrated else driver
        drivers[row, settings] = driver
    return drivers[row, settings]


def followings(stage: Stage, row: int) -> Iterator[Following]:
    """Give the stretches over which an object followed one leader in the measured drive, from its start on."""
    plan, way = stage.plan, way_of(stage, row)
    others = [m for m in range(len(stage.members)) if m != row]
    dt = float(plan.t[1] - plan.t[0])
    every = max(round(GRID / dt), 1)
    places = np.arange(max(plan.begin - way.first, 0), way.count, every)
    who, gap, lead_v = np.full(len(places), -1), np.full(len(places), np.nan), np.full(len(places), np.nan)
    for k, at in enumerate(places.tolist() if others else ()):
        there = way.others(float(way.s[at]), _of(_boxed(stage, plan, way.first + at), others))
        first = int(np.argmin(there.gap))
        if 0.0 < there.gap[first] < math.inf:
            who[k], gap[k], lead_v[k] = others[first], there.gap[first], there.v[first]
    for part in np.split(np.arange(len(places)), np.flatnonzero(np.diff(who)) + 1):
        if len(part) and who[part[0]] >= 0:
            among = places[part]
            yield Following(way.s[among], way.v[among], gap[part], lead_v[part], every * dt)
