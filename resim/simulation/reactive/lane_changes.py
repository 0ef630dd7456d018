"""Lane changes of who was handed over: around somebody who holds it up, and back to its measured way.

It goes to a lane beside its way, and no farther: it is never more than one lane aside. Whether it does, MOBIL says
(`resim.simulation.reactive.mobil`); how long it takes is what Toledo and Zohar (2007) measured, or less where only
that is safe. Who will be in a lane soon counts as being there: by its measured trace, its own lane change, or, of the
EGO, how it moves to the side.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Floats
from resim.road.opendrive import RoadNetwork
from resim.simulation.guide import Guide
from resim.simulation.reactive.aside import Aside, leaving
from resim.simulation.reactive.deciders import Deciders
from resim.simulation.reactive.drivers import wanted
from resim.simulation.reactive.handed import Handed
from resim.simulation.reactive.lanes import Neighbour, Side, neighbour
from resim.simulation.reactive.mobil import MARGIN, Nearest, gets_by, moved_in, moved_out, wants
from resim.simulation.reactive.people import way_of
from resim.simulation.reactive.settings import ReactiveSettings
from resim.simulation.reactive.sight import ChangingDriver, Places, Sight
from resim.simulation.traffic import Stage

NEVER = ("pedestrian", "bicycle", "trailer")
"""Kinds that do not change lanes."""
_FARTHEST_ASIDE = 5.5
"""m aside of its measured way, beyond which a lane is not the one beside it any longer."""
_LENGTHS, _SHORTEST = 2.4, 10.0
"""Own lengths, and m, within which nobody changes lanes, however slow."""
_LONGEST = 1000.0
"""m of a lane that are looked at."""
_TRIED = 3
"""Durations that are tried, from the usual to the shortest one."""


@dataclass(frozen=True, eq=False)
class Target:
    """Where somebody may go to.

    side: where it is. offset: (P,) m left of the way's grid. until: station [m] where it ends. places: tells how far
    ahead and to its left others are.
    """

    side: Side
    offset: Floats
    until: float
    places: Places


class LaneChanges:
    """The lane changes of one run. plan: where all are. now: who was handed over.

    deciders: who says who wants to change to which side, None for MOBIL.
    """

    def __init__(
        self,
        stage: Stage,
        settings: ReactiveSettings,
        network: RoadNetwork,
        plan: Guide,
        now: dict[int, Handed],
        deciders: Deciders | None = None,
    ) -> None:
        self.stage, self.settings, self.how = stage, settings, settings.lane_change
        self.deciders = deciders
        self.network, self.plan, self.now = network, plan, now
        self.hardest = settings.hand_over.hardest
        self.sight = Sight(stage, settings, plan, now)

    def due(self, row: int, k: int) -> bool:
        """Say whether an object's driver looks for another lane at step k."""
        one = self.now[row]
        if not self.how.possible or one.changing or self.plan.t[k] < one.look - 1e-6:
            return False
        one.look = float(self.plan.t[k]) + self.how.every
        return self.stage.members[row].kind not in NEVER

    def chosen(self, me: ChangingDriver) -> tuple[Side, Aside, int] | None:
        """Give the side to which somebody goes, the line that it takes, and the row of the stage of whom it gets by.

        None where it stays in its lane. The row is -1 for nobody.
        """
        one, how = me.one, self.how
        wished = None if self.deciders is None else self.deciders.sides(me.row)
        if wished == ():
            return None
        if wished is None and not one.aside:
            free = min(float(wanted(me.driver, one.v, np.array([np.inf]), np.zeros(1))[0]), me.cap)
            if free - me.want <= how.threshold + how.bias:
                return None
        if self.sight.tows(me):
            return None
        lane = self.sight.lane(me, lambda position: one.line.places(one.s, position), soon=False)
        freed = 0.0
        if lane.behind.row >= 0:
            freed = moved_out(lane.behind, me.body, lane, self.sight.driver(me, lane.behind), self.hardest)
        best: tuple[float, Side, Aside] | None = None
        for target in self._targets(me):
            if wished is not None and target.side not in wished:
                continue
            found = self._weighed(me, target, lane.ahead, freed)
            if found is not None and (best is None or found[0] > best[0]):
                best = found[0], target.side, found[1]
        if best is None:
            return None
        return best[1], best[2], me.rows[lane.ahead.row] if lane.ahead.row >= 0 else -1

    def _targets(self, me: ChangingDriver) -> Iterator[Target]:
        """Where it may go to: from its way to the lanes beside it, from there back."""
        one, way = me.one, way_of(self.stage, me.row)
        station = one.station
        if isinstance(one.line, Aside):
            off = float(np.interp(one.s, one.line.s, one.line.offset))
            places: Places = lambda position: way.places(station, position)  # noqa: E731
            yield Target("right" if off > 0.0 else "left", np.zeros(len(way.grid.s)), math.inf, places)
            return
        for side in ("left", "right"):
            if self.how.sides in ("both", side):
                found = self._beside(me, side, station)
                if found is not None:
                    yield found

    def _beside(self, me: ChangingDriver, side: Side, station: float) -> Target | None:
        """The lane beside its way, where there is one."""
        way, width = way_of(self.stage, me.row), me.body.width
        x, y, heading = me.one.line.columns(me.one.s)
        z = float(np.interp(me.one.s, me.one.line.s, me.one.line.z))
        length = min(way.end - station + 1.0, _LONGEST)
        crossed = max(self.how.duration * me.body.v, _SHORTEST)
        found = neighbour(self.network, (x, y, heading, z), width, side, length, crossed)
        if found is None:
            return None
        return Target(side, *_offsets(found, way.grid.position, way.grid.s, station, length), found.places)

    def _weighed(
        self, me: ChangingDriver, target: Target, slow: Nearest, freed: float
    ) -> tuple[float, Aside] | None:
        """What it gains [m/s²] by going there, and the line to it; None where it had better not.

        slow: who is ahead where it is. freed: what the one behind gains there [m/s²].
        """
        one, way, how = me.one, way_of(self.stage, me.row), self.how
        lane = self.sight.lane(me, target.places, soon=True)
        behind = self.sight.driver(me, lane.behind) if lane.behind.row >= 0 else me.driver
        if lane.ahead.gap < me.driver.standstill or lane.behind.gap < behind.standstill:
            return None
        station, v = one.station, me.body.v
        least = how.threshold + (-how.bias if one.aside else how.bias)
        if (
            self.deciders is not None
        ):  # they say that it wants to; whether it is safe, as long as it lasts, is left
            least = -math.inf
        for duration in np.linspace(how.duration, min(how.shortest, how.duration), _TRIED).tolist():
            length = max(duration * v, _LENGTHS * me.body.length, _SHORTEST)
            lasts = station + length + how.lasting * v
            if station + length > way.end or target.until < min(lasts, way.end):
                continue
            line = leaving(way, one.line, station, length, target.offset, target.until)
            would = self._would(me, line, lane.ahead, slow)
            slower = me.body._replace(v=max(v + 0.5 * duration * min(would, 0.0), 0.0))
            before, after = moved_in(lane.behind, slower, lane, 0.5 * duration, behind, self.hardest)
            gain = would - me.want + how.politeness * (after - before + freed)
            if min(would, after) >= -how.safe and gain > least:
                return gain, line
        return None

    def _would(self, me: ChangingDriver, line: Aside, ahead: Nearest, slow: Nearest) -> float:
        """What it would do [m/s²] on a line: for who is on it, who is ahead in that lane, and the lane's end.

        Whoever is ahead where it is now, and who is `slow`, does not count if it gets by.
        """
        s, v = line.s_at(me.one.station), me.body.v
        found = line.others(s, me.others)
        if slow.row >= 0 and self.gets_by(me.one, line, me.k, me.rows[slow.row], slow):
            found.gap[slow.row] = math.inf
        end = Nearest(0, line.until - s - 0.5 * me.body.length)
        own = [wants(me.driver, v, one, self.hardest) for one in (ahead, end)]
        return float(min(*own, *wanted(me.driver, v, found.gap, found.v).tolist(), me.cap))

    def gets_by(self, one: Handed, line: Aside, k: int, row: int, ahead: Nearest) -> bool:
        """Say whether somebody is aside of who is ahead on a line, of that row, before it is where that one is."""
        s, aside = line.s_at(one.station), 0.5 * (line.width + float(self.stage.width[row])) + MARGIN
        length = line.clear_at(s, self.sight.going(k, row), aside) - s
        return gets_by(length, one.v, ahead, self.sight.braking(k, row))


def _offsets(
    lane: Neighbour, grid: NDArray[np.complex128], s: Floats, station: float, length: float
) -> tuple[Floats, float]:
    """Offsets (P,) [m] of a lane from the points of a way's grid, held where it is not beside, and where it ends.

    s: (P,) m, of the points. length: m from the station on that matter. Its end is a station [m].
    """
    first, last = np.searchsorted(s, (station - 1.0, station + length + 1.0)).tolist()
    first = max(first - 1, 0)
    ahead, left = lane.places(grid[first:last])
    aside = -left
    until = math.inf
    gone = np.flatnonzero((np.abs(aside) > _FARTHEST_ASIDE) | ((ahead > lane.left) & (lane.left < length)))
    if len(gone):
        until = float(s[first + gone[0]])
        aside = aside[: max(int(gone[0]), 1)]
    whole = np.full(len(s), aside[-1])
    whole[: first + len(aside)] = np.concatenate([np.full(first, aside[0]), aside])
    return whole, until
