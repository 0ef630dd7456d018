"""What the map's traffic lights, signs and priorities mean for the connections of the net."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from resim.core import spec
from resim.road.opendrive import RoadNetwork, SignalKind
from resim.road.sumo.places import SignalPlaces
from resim.road.sumo.plain import EdgePair, Ends, PlainNetwork, SumoConnection
from resim.road.sumo.precedence import Precedence

RANK = {"stop": 0, "give way": 0, "priority": 2}
"""Of two ways that meet, the one of the higher rank goes first; a way without a sign has UNSIGNED."""

UNSIGNED = 1


@dataclass(frozen=True)
class UnusedRule:
    """What of the map's rules is not in the net, and why.

    kind: traffic light, sign, speed sign, priority or controller. road: where it stands, "" for the last two.
    s: [m] there, None for the last two.
    """

    __pydantic_config__ = spec.EXACT

    kind: str
    id: str
    road: str
    s: float | None
    why: str


@dataclass(frozen=True, eq=False)
class Rules:
    """What netconvert is told.

    lights: of each connection with traffic lights, their ids. node: of every connection. lit: nodes with traffic
    lights. stops: connections before which vehicles stop. all_way: nodes where they do on all ways. before: traffic on
    the first pair of edges goes before that on the second. signs, priorities: how many of the map are in it. left_out:
    those that are not.
    """

    lights: Mapping[Ends, tuple[str, ...]]
    node: Mapping[Ends, str]
    lit: frozenset[str]
    stops: frozenset[Ends]
    all_way: frozenset[str]
    before: tuple[tuple[EdgePair, EdgePair], ...]
    signs: int
    priorities: int
    left_out: tuple[UnusedRule, ...]


class _RuledWays(NamedTuple):
    """A signal with the connections that it is for, wherever it stands; why: none."""

    kind: SignalKind | None
    id: str
    road: str
    s: float
    connections: dict[Ends, SumoConnection]
    why: str

    def left_out(self, why: str) -> UnusedRule:
        return UnusedRule(
            "traffic light" if self.kind == "light" else "sign", self.id, self.road, self.s, why
        )


def find_rules(network: RoadNetwork, made: PlainNetwork) -> Rules:
    """Give the rules for the connections of the net that is made of a map."""
    places = SignalPlaces(network, made)
    ruled = list(_ruled(network, places))
    left_out = [each.left_out(each.why) for each in ruled if not each.connections]
    lights = _lights(ruled)
    node = {c.ends: places.node(c) for c in made.connections}
    lit = frozenset(node[ends] for ends in lights)
    signs = []
    for each in ruled:
        if each.connections and each.kind in RANK:
            free = {ends: own for ends, own in each.connections.items() if node[ends] not in lit}
            signs.append(each._replace(connections=free))
    precedence = Precedence(places, made, lit)
    priorities, refused = _add_priorities(network, precedence)
    stops = {ends for each in signs if each.kind == "stop" for ends in each.connections}
    precedence.add_ranks(_ranks(signs), UNSIGNED)
    ordered = precedence.edges()
    without = list(_without_effect(signs, ordered))
    return Rules(
        lights, node, lit, frozenset(stops),
        frozenset(_all_way(places, made, stops, ordered)), tuple(precedence.before),
        len(signs) - len(without), priorities, (*left_out, *without, *refused),
    )  # fmt: skip


def _ruled(network: RoadNetwork, places: SignalPlaces) -> Iterator[_RuledWays]:
    """Every signal of the map once, with all its references."""
    standing = defaultdict(list)
    for road in network.roads.values():
        for signal in road.signals:
            standing[signal.id].append((road, signal))
    for name, own in standing.items():
        own.sort(key=lambda each: each[1].refers)
        road, first = own[0]
        if first.kind is None and not first.problem:
            yield _RuledWays(None, name, road.id, first.s, {}, f"not known as a light or sign ({first.text})")
            continue
        found = [places.ruled(*each) for each in own]
        ways = {c.ends: c for ruled, _ in found for c in ruled if places.for_vehicles(c)}
        yield _RuledWays(
            first.kind, name, road.id, first.s, ways, found[0][1] or "no way of vehicles passes it"
        )


def _lights(ruled: Iterable[_RuledWays]) -> dict[Ends, tuple[str, ...]]:
    """The ids of the traffic lights of each connection that has some."""
    lights: dict[Ends, tuple[str, ...]] = {}
    for each in ruled:
        for ends in each.connections if each.kind == "light" else ():
            lights[ends] = (*lights.get(ends, ()), each.id)
    return lights


def _ranks(signs: Iterable[_RuledWays]) -> dict[Ends, int]:
    """The rank of each connection with signs, the lowest that one of them gives."""
    ranks: dict[Ends, int] = {}
    for each in signs:
        for ends in each.connections:
            rank = RANK[each.kind or ""]
            ranks[ends] = min(rank, ranks.get(ends, rank))
    return ranks


def _without_effect(signs: Iterable[_RuledWays], edges: Collection[EdgePair]) -> Iterator[UnusedRule]:
    for each in signs:
        if not each.connections:
            yield each.left_out("traffic lights rule its junction")
        elif each.kind != "stop" and not any(own.edges in edges for own in each.connections.values()):
            yield each.left_out("its ways meet none that goes before or after them")


def _all_way(
    places: SignalPlaces, made: PlainNetwork, stops: Collection[Ends], ordered: Collection[EdgePair]
) -> Iterator[str]:
    """The nodes with several edges that lead in, of which vehicles stop on all, and none goes first by a priority."""
    here: dict[str, list[SumoConnection]] = defaultdict(list)
    for connection in made.connections:
        if places.for_vehicles(connection):
            here[places.node(connection)].append(connection)
    for node, own in here.items():
        first = any(c.edges in ordered for c in own)
        if len({c.edges[0] for c in own}) > 1 and all(c.ends in stops for c in own) and not first:
            yield node


def _add_priorities(network: RoadNetwork, precedence: Precedence) -> tuple[int, list[UnusedRule]]:
    """How many of the junctions' priorities are taken over, and the others."""
    taken, refused = 0, []
    for junction in network.junctions.values():
        for high, low in junction.priorities:
            why = precedence.add_roads(high, low)
            taken += not why
            if why:
                name = f"junction {junction.id}: {high} before {low}"
                refused.append(UnusedRule("priority", name, "", None, why))
    return taken, refused
