"""Traffic that reacts, in one run: objects keep to their traces until the EGO makes their drivers do otherwise.

An object is handed over where its driver would brake harder than in the measured drive, and harder than its trace
does, for the EGO or another object that is not where it was measured. From then on it drives along its measured way,
behind whoever is on it, or around them on the lane beside it (`lane_changes`). It never gets ahead of its trace, and
where it has caught up on its way it is back on it. Where all are where they were measured, nobody is handed over.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field, replace

import numpy as np

from resim.core.geometry import Floats
from resim.road.opendrive import RoadNetwork
from resim.simulation.case import HandedOver, LaneChange
from resim.simulation.guide import Guide
from resim.simulation.perception import Worlds
from resim.simulation.reactive.aside import Aside
from resim.simulation.reactive.deciders import Deciders
from resim.simulation.reactive.drivers import TrafficDriver, wanted
from resim.simulation.reactive.handed import Handed
from resim.simulation.reactive.lane_changes import LaneChanges
from resim.simulation.reactive.mobil import Body, Nearest
from resim.simulation.reactive.people import boxed, traffic_driver, way_of
from resim.simulation.reactive.settings import ReactiveSettings
from resim.simulation.reactive.sight import ChangingDriver
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
_SOON = 1.0
"""s within which a driver is as fast as it may be, for the comparison of lanes."""
_SHARP = 2.0
"""m of the chords that tell how sharply a change of lanes bends."""
_TOLD = -99.0
"""m/s², the hardest braking that is told in figures."""
_CLOSE = 0.2
"""Share of what its driver would brake by in the measured drive, by which it has to be harder at least."""


@dataclass(eq=False)
class ReactiveTraffic:
    """The traffic of one run. deciders: who decides for those handed over, None for their drivers' own models.

    plan: where all are, which changes as the run goes on.
    """

    stage: Stage
    settings: ReactiveSettings
    network: RoadNetwork
    deciders: Deciders | None = None
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
        self.now: dict[int, Handed] = {}
        self.past: list[tuple[int, Handed]] = []
        self.changes = LaneChanges(
            self.stage, self.settings, self.network, self.plan, self.now, self.deciders
        )

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
        all_, off = boxed(self.stage, p, k), [*([0] if moved else []), *self.now]
        for row in self._near(k, all_, off):
            self._look(row, k, all_, off)
        for row in [*self.now]:
            self._drive(row, k, all_)

    def ended(self, t: float) -> tuple[HandedOver, ...]:
        """Give who was handed over up to a time [s], in the order of time."""
        told = [
            one.told(self.members[row].id, t)
            for row, one in [*self.past, *self.now.items()]
            if one.since <= t
        ]
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
        found = way.others(s, all_.of(others))
        if v < _SLOW or not (found.ahead & (found.gap > 0.0)).any():  # too late for a driver to do anything
            return
        want = wanted(driver, v, found.gap, found.v)
        first = int(np.argmin(want))
        there = way.others(s, boxed(self.stage, self.measured, k).of(others))
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
        now = float(self.plan.t[k])
        self.now[row] = Handed(now, why, way, s, v, a, deque([a] * late), now + driver.reaction)
        if self.deciders is not None:
            self.deciders.take(row, driver)

    def _give_back(self, row: int) -> None:
        """Let an object go back to its trace."""
        self.past.append((row, self.now.pop(row)))
        if self.deciders is not None:
            self.deciders.give_back(row)

    def _drive(self, row: int, k: int, all_: Boxed) -> None:
        """Move an object along its line to step k + 1."""
        one, way, driver = self.now[row], way_of(self.stage, row), self._driver(row)
        at, now = way.at_step(k + 1), float(self.plan.t[k])
        assert driver is not None
        if at < 0:  # it was not seen any longer
            self._give_back(row)
            return
        want = self._want(row, k, all_, driver)
        one.later.append(want)
        late = one.later.popleft()
        attentive = now - one.since >= driver.reaction
        a = want if attentive and want < -driver.deceleration else late
        v = max(min(one.v + a * self.dt, self._fastest(one, way, driver, at)), 0.0)
        s, trace = one.s + 0.5 * (one.v + v) * self.dt, float(way.s[at])
        caught_up = (
            not one.aside
            and s >= trace - _BACK
            and abs(v - float(way.v[at])) <= driver.deceleration * self.dt
        )
        if caught_up and want >= min(float(way.a[at]), 0.0):
            one.back = float(self.plan.t[k + 1])
            self._give_back(row)
            return
        s = min(s, one.line.s_at(trace))
        one.a, one.s, one.v = (v - one.v) / self.dt, s, v
        one.behind.append((float(self.plan.t[k + 1]), trace - one.station, one.a))
        self._put(row, k + 1, one)

    def _put(self, row: int, k: int, one: Handed) -> None:
        """Write where an object is at step k."""
        p, line, (x, y, heading) = self.plan, one.line, one.line.columns(one.s)
        columns = (x, y, heading, one.v, one.a, line.bend(one.s) * one.v)
        for column, value in zip((p.x, p.y, p.heading, p.v, p.a, p.yaw_rate), columns, strict=True):
            column[row, k] = value
        if p.z is not None:
            p.z[row, k] = np.interp(one.s, line.s, line.z)
        if one.returned:
            one.take(way_of(self.stage, row))

    def _want(self, row: int, k: int, all_: Boxed, driver: TrafficDriver) -> float:
        """What an object's driver wants [m/s²], who may change to another line for it."""
        one = self.now[row]
        rows = [m for m in range(len(self.members)) if m != row]
        others = all_.of(rows)
        want = self._behind(row, k, rows, others, driver)
        if self.changes.due(row, k):
            way = way_of(self.stage, row)
            cap = (self._fastest(one, way, driver, way.at_step(k + 1)) - one.v) / _SOON
            body = Body(one.v, way.length, way.width)
            me = ChangingDriver(row, one, driver, k, rows, others, min(want, cap), cap, body)
            found = self.changes.chosen(me)
            if found is not None:
                side, line, one.passes = found
                one.take(line)
                now = float(self.plan.t[k])
                one.changes.append(LaneChange(now, side))
                want = self._behind(row, k, rows, others, driver)
        if one.changing:
            one.look = float(self.plan.t[k]) + self.settings.lane_change.pause
        return want

    def _behind(self, row: int, k: int, rows: list[int], others: Boxed, driver: TrafficDriver) -> float:
        """What a driver wants [m/s²] for who is on the line ahead, if it does not get by, and for the line's end."""
        one = self.now[row]
        found = one.line.others(one.s, others)
        if one.changing and isinstance(one.line, Aside) and one.passes in rows:
            n = rows.index(one.passes)
            ahead = Nearest(n, float(found.gap[n]), float(found.v[n]))
            if self.changes.gets_by(one, one.line, k, one.passes, ahead):
                found.gap[n] = math.inf
        end = one.line.until - one.s - 0.5 * one.line.length
        gap, lead_v = np.append(found.gap, end), np.append(found.v, 0.0)
        want = wanted(driver, one.v, gap, lead_v)
        first = int(np.argmin(want))
        least = float(want[first])
        if self.deciders is not None:
            least = self.deciders.acceleration(row, one.v, float(gap[first]), float(lead_v[first]))
        return max(min(least, driver.acceleration), -self.settings.hand_over.hardest)

    def _fastest(self, one: Handed, way: Way, driver: TrafficDriver, at: int) -> float:
        """How fast [m/s] an object may be at place `at` of its way: to catch up with its trace, and in bends.

        It slows down for that no harder than is comfortable.
        """
        behind = max(float(way.s[at - 1]) - one.station, 0.0)
        most = float(way.v[at]) + math.sqrt(2.0 * self.settings.hand_over.catch_up * behind)
        for ahead in (0.0, one.v):
            s = one.s + ahead
            bend = max(abs(one.line.bend(s, _SHARP) if one.changing else one.line.bend(s)), 1e-9)
            slow = (
                0.0 if one.changing else float(np.interp(one.line.station_at(s), way.s[: way.count], way.v))
            )
            most = min(most, max(slow, math.sqrt(_ASIDE_MOST / bend)))
        return max(most, one.v - driver.deceleration * self.dt)
