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
from itertools import pairwise

import numpy as np

from resim.core.geometry import Floats
from resim.simulation.case import HandedOver
from resim.simulation.guide import Guide
from resim.simulation.perception import Worlds
from resim.simulation.reactive.drivers import GRID, Following, TrafficDriver, driver_of, fitted, wanted
from resim.simulation.reactive.settings import ReactiveSettings
from resim.simulation.reactive.ways import REACH, Boxed, Way
from resim.simulation.traffic import Phase, Stage

_OFF = 1e-6
"""m or m/s from where it was measured, up to which the EGO is there: what rounding leaves."""
_ASIDE, _BENDS = 10.0, 0.5
"""m beside an object, and more per m ahead, beyond which nobody is on its way before it is nearer."""
_BACK = 0.05
"""m behind its trace at which an object is back on it, if its driver wants to brake no harder than that."""
_AS_FAST = 0.5
"""m/s by which it may be slower or faster then."""


@dataclass(eq=False)
class _Handed:
    """One object that a driver drives: s [m] on its way, v and what it does now [m/s²], and what it wants later."""

    since: float
    why: str
    s: float
    v: float
    a: float
    later: deque[float]
    farthest: float = 0.0


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
        self.length = np.array([m.length for m in self.members])
        self.width = np.array([m.width for m in self.members])
        self.now: dict[int, _Handed] = {}
        self.past: list[HandedOver] = []

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
        all_, off = self._vehicles(k, ego, z), [*([0] if moved else []), *self.now]
        for row in self._near(k, all_, off):
            self._look(row, k, all_, off)
        for row in [*self.now]:
            self._drive(row, k, all_)

    def ended(self, t: float) -> tuple[HandedOver, ...]:
        """Give who was handed over up to a time [s], in the order of time."""
        on = [self._told(row, one, None) for row, one in self.now.items()]
        told = sorted([*self.past, *on], key=lambda one: (one.t, one.id))
        back = [one if one.back is None or one.back <= t else replace(one, back=None) for one in told]
        return tuple(one for one in back if one.t <= t)

    def _vehicles(self, k: int, ego: Floats, z: float) -> Boxed:
        p = self.plan
        x, y, heading, v = (c[:, k].copy() for c in (p.x, p.y, p.heading, p.v))
        x[0], y[0], heading[0], v[0] = ego[:4]
        heights = np.full(len(x), np.nan) if p.z is None else p.z[:, k].copy()
        heights[0] = z
        return Boxed(x + 1j * y, heading, v, self.length, self.width, heights)

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
        if at < 0 or at + 1 >= len(way.s):
            return
        others = [m for m in off if m != row]
        s, v, a = float(way.s[at]), float(way.v[at]), float(way.a[at])
        found = way.others(s, _of(all_, others))
        if not found.ahead.any():
            return
        want = wanted(driver, v, found.gap, found.v)
        first = int(np.argmin(want))
        least = max(float(want[first]), -self.settings.hand_over.hardest)
        there = way.others(s, _of(_measured(self.measured, k, self.length, self.width), others))
        meant = wanted(driver, v, there.gap, there.v).min()
        meant = min(max(float(meant), -self.settings.hand_over.hardest), 0.0)
        bound = min(meant, a) - self.settings.hand_over.harder
        if least >= bound:
            return
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
            self.past.append(self._told(row, self.now.pop(row), None))
            return
        found = way.others(one.s, _of(all_, [m for m in range(len(self.members)) if m != row]))
        want = float(np.min(wanted(driver, one.v, found.gap, found.v), initial=driver.acceleration))
        want = max(want, -self.settings.hand_over.hardest)
        one.later.append(want)
        late = one.later.popleft()
        attentive = float(self.plan.t[k]) - one.since >= driver.reaction
        one.a = want if attentive and want < -driver.deceleration else late
        behind = max(float(way.s[at - 1]) - one.s, 0.0)
        most = float(way.v[at]) + math.sqrt(2.0 * self.settings.hand_over.catch_up * behind)
        v = max(min(one.v + one.a * self.dt, max(most, one.v - driver.deceleration * self.dt)), 0.0)
        s = one.s + 0.5 * (one.v + v) * self.dt
        caught_up = s >= float(way.s[at]) - _BACK and abs(v - float(way.v[at])) < _AS_FAST
        if caught_up and want >= min(float(way.a[at]), 0.0):
            self.past.append(self._told(row, self.now.pop(row), float(self.plan.t[k + 1])))
            return
        s = min(s, float(way.s[at]))
        one.a, one.s, one.v = (v - one.v) / self.dt, s, v
        one.farthest = max(one.farthest, float(way.s[at]) - s)
        p = self.plan
        columns = way.columns(s, v, one.a)
        for column, value in zip((p.x, p.y, p.heading, p.v, p.a, p.yaw_rate), columns, strict=True):
            column[row, k + 1] = value
        if p.z is not None:
            p.z[row, k + 1] = np.interp(s, way.s, way.z)

    def _told(self, row: int, one: _Handed, back: float | None) -> HandedOver:
        return HandedOver(self.members[row].id, one.since, one.why, back, one.farthest)


def _of(every: Boxed, rows: list[int]) -> Boxed:
    position, heading, v, length, width, z = every
    return Boxed(position[rows], heading[rows], v[rows], length[rows], width[rows], z[rows])


def _measured(plan: Guide, k: int, length: Floats, width: Floats) -> Boxed:
    z = np.full(len(length), np.nan) if plan.z is None else plan.z[:, k]
    return Boxed(plan.x[:, k] + 1j * plan.y[:, k], plan.heading[:, k], plan.v[:, k], length, width, z)


@lru_cache(maxsize=4096)
def way_of(stage: Stage, row: int) -> Way:
    """Give the way of an object of a stage."""
    return Way(stage.plan, row, stage.members[row].length, stage.members[row].width)


@lru_cache(maxsize=4096)
def traffic_driver(stage: Stage, settings: ReactiveSettings, row: int) -> TrafficDriver | None:
    """Give the driver of an object; None for who has none: a pedestrian, who reverses, who is there for a step."""
    kind, way = settings.of(stage.members[row].kind), way_of(stage, row)
    if kind is None or not way.forwards or len(way.s) < 2:
        return None
    driver = driver_of(kind, way.v)
    return fitted(driver, [*followings(stage, row)]) if settings.calibrated else driver


def followings(stage: Stage, row: int) -> Iterator[Following]:
    """Give the stretches over which an object followed one leader in the measured drive, from its start on."""
    plan, way = stage.plan, way_of(stage, row)
    length, width = (np.array([getattr(m, name) for m in stage.members]) for name in ("length", "width"))
    others = [m for m in range(len(length)) if m != row]
    every = max(round(GRID / float(plan.t[1] - plan.t[0])), 1)
    steps = [k for k in way.steps[::every].tolist() if k >= plan.begin]
    found: list[tuple[int, float, float, float, float]] = []
    for k in steps:
        at = way.at_step(k)
        there = way.others(float(way.s[at]), _of(_measured(plan, k, length, width), others))
        gap = there.gap
        first = int(np.argmin(gap)) if len(gap) else -1
        who = others[first] if len(gap) and np.isfinite(gap[first]) else -1
        found.append(
            (
                who,
                float(way.s[at]),
                float(way.v[at]),
                *((float(gap[first]), float(there.v[first])) if who >= 0 else (0.0, 0.0)),
            )
        )
    changes = [0, *(k for k in range(1, len(found)) if found[k][0] != found[k - 1][0]), len(found)]
    for begin, end in pairwise(changes):
        if end > begin and found[begin][0] >= 0:
            _, s, v, gap_, lead = np.array(found[begin:end]).T
            yield Following(s, v, gap_, lead)
