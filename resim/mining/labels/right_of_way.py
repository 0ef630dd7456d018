"""Who has the way through a junction, as far as the map's lights and signs and the objects say (Kaefer's catalogs).

States of lights are in no object list. What shows is that lights hold others back: a way is protected if somebody
stands, as long as it lasts, at the lights of an approach whose ways cross it, and nobody drives on such a way. At a
junction without lights every way is unprotected. At lights that hold back nobody seen, nothing is said; nor anywhere on
a map without any light or sign that tells who has the way, since that map may just not say so.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property

import numpy as np
import shapely

from resim.core.geometry import Floats
from resim.mining.features import Features
from resim.mining.labels.others import REVERSING
from resim.mining.labels.turns import LABELS as WAYS
from resim.mining.labels.turns import crossings
from resim.mining.lane_map import MinedLanes, Ways
from resim.mining.maneuver import FAMILIES, LabelFamily, LabelledManeuver
from resim.mining.samples import Ints
from resim.mining.settings import MiningSettings, RightOfWaySettings

PROTECTED, UNPROTECTED, RUNS_STOP = "protected_way", "unprotected_way", "run_stop_sign"
BACKING = "reversing_at_junction"
JOINED = 0.1
"""m: lines of lanes that come so near join."""


def find(
    features: Features, settings: MiningSettings, found: Sequence[LabelledManeuver]
) -> Iterator[LabelledManeuver]:
    """Find what is known of the right of way of those who pass junctions."""
    rules = settings.right_of_way
    ways = [one for one in found if one.label in WAYS and features.row[one.start] >= 0]
    ways = [one for one in ways if features.junction[one.start] >= 0]  # not of a user's regions
    if not ways:
        return
    rights = _Rights(features, rules, settings.standing.speed)
    for way in ways:
        junction, approach = int(features.junction[way.start]), rights.approach(way.start)
        if junction not in rights.lit and rights.told:
            yield LabelledManeuver(UNPROTECTED, way.object, way.start, way.end, way.start)
        elif junction in rights.lit and (held := rights.held_back(way)) >= 0:
            yield LabelledManeuver(PROTECTED, way.object, way.start, way.end, way.start, held)
        if approach in rights.stops:
            near = rights.last_metres(way.start, approach)
            slowest = float(np.min(features.samples.v[near]))
            if slowest > rules.stop_speed:
                figures = {"v_mps": slowest}
                yield LabelledManeuver(
                    RUNS_STOP, way.object, int(near[0]), way.start, way.start, figures=figures
                )


def find_backing(
    features: Features, settings: MiningSettings, found: Sequence[LabelledManeuver]
) -> Iterator[LabelledManeuver]:
    """Find who backs up in a crossing, or as near to one as is looked for stops."""
    backing = [one for one in found if one.label == REVERSING]
    counts = crossings(features.lanes, settings.turn)
    if not backing or not counts.any():
        return
    lanes, reach = features.lanes, settings.right_of_way.stop_before
    inside = (lanes.junction >= 0) & counts[lanes.junction]
    rows = np.flatnonzero(inside).tolist()
    to_go = _metres(lanes, {one for row in rows for one in _of(lanes.before, row)}, lanes.before, reach)
    gone = _metres(lanes, {one for row in rows for one in _of(lanes.after, row)}, lanes.after, reach)
    for one in backing:
        own = np.arange(one.start, one.end + 1)
        own = own[features.row[own] >= 0]
        row, u = features.row[own], features.u[own]
        near = inside[row] | (gone[row] + u <= reach)
        near |= to_go[row] + lanes.stations.length[row] - u <= reach
        if near.any():
            at = own[near]
            yield LabelledManeuver(BACKING, one.object, int(at[0]), int(at[-1]), int(at[0]))


class _Rights:
    """Lights and stop signs by lanes (rows) before junctions, and which ways through them cross."""

    def __init__(self, features: Features, rules: RightOfWaySettings, standing: float) -> None:
        self.features, self.rules, self.standing = features, rules, standing
        lanes = features.lanes
        inside = np.flatnonzero((lanes.junction >= 0) & (lanes.lanes > 0)).tolist()
        before = {row: _of(lanes.before, row) for row in inside}
        self.approaches = {
            row: [one for one in rows if lanes.junction[one] < 0] for row, rows in before.items()
        }
        signs = {one: _signs(lanes, one, rules.near) for rows in self.approaches.values() for one in rows}
        lit = {row for row in inside if "light" in _signs(lanes, row, np.inf)}
        lit |= {row for row, rows in self.approaches.items() if any("light" in signs[one] for one in rows)}
        self.lit = {int(lanes.junction[row]) for row in lit}
        self.told = any(one.kind is not None for road in lanes.network.roads.values() for one in road.signals)
        self.stops = {one for one, kinds in signs.items() if "stop" in kinds}
        self.lines: dict[int, shapely.LineString] = {}

    def approach(self, start: int) -> int:
        """The lane before the junction that a sample is the first one inside of; -1 for none."""
        k = start - 1
        while k >= 0 and self.features.row[k] < 0 and k >= self.features.samples.first[self._owner(start)]:
            k -= 1
        return int(self.features.row[k])

    def last_metres(self, start: int, approach: int) -> Ints:
        """The last samples before `start` that are on the approach, as far as is looked for a stop."""
        features, reach = self.features, self.rules.stop_before
        low = int(features.samples.first[self._owner(start)])
        own = np.arange(low, start)
        own = own[features.row[own] >= 0]
        left = self._left({approach}, own, reach)
        far = np.flatnonzero(left > reach)
        near = own[far[-1] + 1 :] if len(far) else own
        return near if len(near) else own[-1:]

    def held_back(self, way: LabelledManeuver) -> int:
        """Who stands at lights for a way as long as it lasts (row of the tracks), -1 for nobody."""
        features, samples = self.features, self.features.samples
        rows = {int(row) for row in features.row[way.start : way.end + 1].tolist() if row >= 0}
        crossing = self._crossing(rows, self.approach(way.start))
        held = {one for row in crossing for one in self.approaches[row]}
        order, first = samples.by_step
        steps = samples.step[way.start], samples.step[way.end]
        there = order[first[steps[0]] : first[steps[1] + 1]]
        there = there[samples.owner[there] != way.object]
        if (np.isin(features.row[there], list(crossing)) & (np.abs(samples.v[there]) > self.standing)).any():
            return -1
        stands = np.abs(samples.v[there]) <= self.standing
        stands &= self._left(held, there, self.rules.near) <= self.rules.near
        who, count = np.unique(samples.owner[there[stands]], return_counts=True)
        whole = who[count == steps[1] - steps[0] + 1]
        return int(whole[0]) if len(whole) else -1

    def _left(self, approaches: set[int], samples: Ints, reach: float) -> Floats:
        """Metres from samples to the end of the lane among these that they lead to; infinite beyond `reach`."""
        features, lanes = self.features, self.features.lanes
        row = features.row[samples]
        left = _metres(lanes, approaches, lanes.before, reach)[row] + lanes.stations.length[row]
        return np.where(row >= 0, left - features.u[samples], np.inf)

    def _owner(self, k: int) -> int:
        return int(self.features.samples.owner[k])

    def _crossing(self, rows: set[int], approach: int) -> set[int]:
        """The lanes inside the junction, from other approaches, that cross or join the way over these lanes."""
        lanes = self.features.lanes
        own = [row for row in rows if lanes.junction[row] >= 0]
        out = set()
        for row in self._by_junction.get(int(lanes.junction[own[0]]), []) if own else []:
            from_there = self.approaches[row]
            if row in own or not from_there or any(lanes.road[a] == lanes.road[approach] for a in from_there):
                continue
            if any(self._line(row).dwithin(self._line(one), JOINED) for one in own):
                out.add(row)
        return out

    @cached_property
    def _by_junction(self) -> dict[int, list[int]]:
        out: dict[int, list[int]] = {}
        for row in self.approaches:
            out.setdefault(int(self.features.lanes.junction[row]), []).append(row)
        return out

    def _line(self, row: int) -> shapely.LineString:
        """The lane's centre."""
        if row not in self.lines:
            network = self.features.lanes.network
            table = network.lane_table
            road = self.features.lanes.road_of(row)
            s = np.linspace(table.start[row], min(table.end[row], road.length) - 1e-9, 20)
            x, y = network.to_xy(np.full(20, road.id), np.full(20, table.lane[row]), s, 0.0)
            self.lines[row] = shapely.LineString(np.stack([x, y], axis=1))
        return self.lines[row]


def _metres(lanes: MinedLanes, rows: set[int], ways: Ways, reach: float) -> Floats:
    """Metres (L,) from these rows, which are at 0, to the near end of those that follow along `ways`.

    A road may have short lane sections: what is near begins on others. Infinite beyond `reach` [m].
    """
    out = np.full(len(lanes.road), np.inf)
    todo = [(0.0, row) for row in rows]
    while todo:
        far, row = todo.pop()
        if far > reach or far >= out[row]:
            continue
        out[row] = far
        todo += [(far + float(lanes.stations.length[row]), one) for one in _of(ways, row)]
    return out


def _of(ways: tuple[np.ndarray, np.ndarray], row: int) -> list[int]:
    first, to = ways
    return [int(one) for one in to[first[row] : first[row + 1]]]


def _signs(lanes: MinedLanes, row: int, near: float) -> set[str]:
    """What kinds of signals are for a lane, up to `near` [m] before the end of its road."""
    table = lanes.network.lane_table
    road = lanes.road_of(row)
    lane, forward = int(table.lane[row]), bool(table.forward[row])
    return {
        str(one.kind)
        for one in road.signals
        if not one.problem
        and (one.orientation == "none" or forward == (one.orientation == "+"))
        and (not one.lanes or any(low <= lane <= high for low, high in one.lanes))
        and (road.length - one.s if forward else one.s) <= near
    }


FAMILIES.add(
    LabelFamily(
        "right of way", (PROTECTED, UNPROTECTED, RUNS_STOP), find,
        "whether lights hold others back for a way through a junction; who does not stop at a stop sign",
        "Kaefer 2022, Appendix 1; our numbers",
    )
)  # fmt: skip
FAMILIES.add(
    LabelFamily(
        "backing at junctions", (BACKING,), find_backing, "backing up in a crossing or near to one",
        "Kaefer 2022, Appendix 1; our numbers",
    )
)  # fmt: skip
