"""Which ways through a junction go before which others, by the map's priorities and signs."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping
from itertools import permutations

import shapely

from resim.road.sumo.places import SignalPlaces
from resim.road.sumo.plain import EdgePair, Ends, PlainNetwork, SumoConnection


class Precedence:
    """Collects pairs of ways of which the first goes before the second; ways that do not meet need no order.

    before: the pairs, in the order in which they were found; the first found of two opposite ones holds. lit: nodes
    with traffic lights, at which there are none: netconvert keeps to some of them only.
    """

    def __init__(self, places: SignalPlaces, made: PlainNetwork, lit: Collection[str]) -> None:
        self.before: dict[tuple[EdgePair, EdgePair], None] = {}
        self._at_node: dict[str, list[SumoConnection]] = defaultdict(list)
        self._on_road: dict[str, list[SumoConnection]] = defaultdict(list)
        self._node, self._lit = places.node, lit
        for connection in made.connections:
            if places.node(connection) not in lit:
                self._at_node[places.node(connection)].append(connection)
            origin = made.lanes[connection.origin].stretch.road
            for road in {origin, *(key.road for key in connection.way)}:
                self._on_road[road].append(connection)

    def edges(self) -> set[EdgePair]:
        """Give all pairs of edges that go before or after others."""
        return {edges for pair in self.before for edges in pair}

    def add_roads(self, high: str, low: str) -> str:
        """Let the ways over one road, or from it, go before those of another; give why that is nothing, or ""."""
        for road in (high, low):
            if not self._on_road[road]:
                return f"no way through a junction leads over road {road}"
        pairs = [
            (one, other) for one in self._on_road[high] for other in self._on_road[low]
            if self._node(one) == self._node(other) and _meet(one, other)
        ]  # fmt: skip
        if not pairs:
            return "their ways do not meet"
        pairs = [(one, other) for one, other in pairs if self._node(one) not in self._lit]
        if not pairs:
            return "traffic lights rule their junction"
        added = [self._add(one, other) for one, other in pairs]
        return "" if any(added) else "another priority says the opposite"

    def add_ranks(self, ranks: Mapping[Ends, int], default: int) -> None:
        """Let ways of a higher rank go before those of a lower at each node where some have ranks."""
        for own in self._at_node.values():
            rank = [ranks.get(each.ends, default) for each in own]
            if len(set(rank)) > 1:
                for (first, one), (second, other) in permutations(zip(rank, own, strict=True), 2):
                    if first > second and _meet(one, other):
                        self._add(one, other)

    def _add(self, one: SumoConnection, other: SumoConnection) -> bool:
        pair = one.edges, other.edges
        if pair[::-1] in self.before:
            return False
        self.before[pair] = None
        return True


def _meet(one: SumoConnection, other: SumoConnection) -> bool:
    """Whether two ways from different edges cross or end in the same lane."""
    if one.edges[0] == other.edges[0]:
        return False
    return one.target == other.target or bool(
        shapely.intersects(shapely.linestrings(one.line), shapely.linestrings(other.line))
    )
