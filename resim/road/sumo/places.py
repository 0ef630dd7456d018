"""Which connections of the net a signal of the map is for."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

from resim.road.links import LaneKey
from resim.road.opendrive import Road, RoadNetwork, Signal
from resim.road.sumo.plain import PlainNetwork, SumoConnection, lane_id

NEAR = 50.0
"""A signal further [m] before the end of its road is not for the junction there."""


class SignalPlaces:
    """Finds the connections that traffic drives which a signal is for; those of lanes for vehicles only."""

    def __init__(self, network: RoadNetwork, made: PlainNetwork) -> None:
        self._network, self._made = network, made
        targets = {piece.id: piece.target for piece in made.pieces.all}
        self._node = {name: targets[name.rpartition("_")[0]] for name in made.lanes}
        self._leaving: dict[str, list[SumoConnection]] = defaultdict(list)
        self._passing: dict[LaneKey, list[SumoConnection]] = defaultdict(list)
        for connection in made.connections:
            self._leaving[connection.origin].append(connection)
            for key in connection.way:
                self._passing[key].append(connection)

    def node(self, connection: SumoConnection) -> str:
        """Give the node of the net that a connection is in."""
        return self._node[connection.origin]

    def for_vehicles(self, connection: SumoConnection) -> bool:
        """Say whether vehicles may drive a connection."""
        road, section, lane = self._made.lanes[connection.origin].stretch.key
        return self._network.roads[road].sections[section].lanes[lane].drivable

    def ruled(self, road: Road, signal: Signal) -> tuple[list[SumoConnection], str]:
        """Give the connections that a signal on a road is for, or none and why."""
        if signal.problem:
            return [], signal.problem
        if road.junction is not None:
            keys = [key for k in range(len(road.sections)) for key in _lanes(road, k, signal)]
            found = [connection for key in keys for connection in self._passing[key]]
        else:
            keys = list(_lanes_towards_end(road, signal))
            near = [key for key in keys if _distance(road, key, signal.s) <= NEAR]
            if keys and not near:
                return [], f"no junction follows within {NEAR:g} m"
            found = self._ahead(road, near)
        if not keys:
            return [], "it is for no lane of vehicles"
        return found, "" if found else "no junction follows, or no way of the net leads through it"

    def _ahead(self, road: Road, keys: list[LaneKey]) -> list[SumoConnection]:
        """The connections at the junction at the road's end to which the lanes lead."""
        of_lane = self._made.pieces.of_lane
        todo = [lane_id(of_lane[key][-1], key.lane) for key in keys if key in of_lane]
        seen: dict[str, None] = {}
        while todo:
            lane = todo.pop()
            if lane in seen:
                continue
            seen[lane] = None
            todo += [
                each.target for each in self._leaving[lane]
                if self._made.lanes[each.target].stretch.road == road.id and not each.way
            ]  # fmt: skip
        at_junction = [lane for lane in seen if self._node[lane].endswith(".junction")]
        return [each for lane in at_junction for each in self._leaving[lane]]


def _lanes(road: Road, section: int, signal: Signal) -> list[LaneKey]:
    """The lanes of a section that a signal is for: lanes that it names come before the way that it faces."""
    lanes = [lane.id for lane in road.sections[section].lanes.values() if lane.drivable and lane.id != 0]
    if signal.lanes:
        lanes = [lane for lane in lanes if any(low <= lane <= high for low, high in signal.lanes)]
    facing = [
        lane for lane in lanes
        if signal.orientation == "none" or road.along(lane, section) == (signal.orientation == "+")
    ]  # fmt: skip
    return [LaneKey(road.id, section, lane) for lane in facing or (lanes if signal.lanes else [])]


def _lanes_towards_end(road: Road, signal: Signal) -> Iterator[LaneKey]:
    """The lanes beside a signal that names lanes; else all those that reach an end of the road."""
    if signal.lanes:
        yield from _lanes(road, road.section_index(signal.s), signal)
        return
    last = len(road.sections) - 1
    yield from (key for key in _lanes(road, last, signal) if road.along(key.lane, last))
    yield from (key for key in _lanes(road, 0, signal) if not road.along(key.lane, 0))


def _distance(road: Road, key: LaneKey, s: float) -> float:
    """The way [m] from s to the end of the road that the lane leads to."""
    return road.length - s if road.along(key.lane, key.section) else s
