"""The lanes of a map as mining needs them: what goes on into what, who is beside whom, and metres along lane centres.

A lane keeps its identity over lane sections, junctions and merges: rows (a lane of one lane section) are joined by the
map's own links (`resim.road.links`), and where a lane has none, by where it ends and how it heads there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from resim.core.geometry import Bools, Floats, sealed, wrap_angle
from resim.road.links import LaneKey, lane_graph
from resim.road.opendrive import Road, RoadNetwork

Rows = NDArray[np.signedinteger[Any]]

NODE = 1.0
"""Distance [m] along the road between the nodes at which the length of a lane centre is tabulated."""
INSIDE = 1e-9
"""m by which the end of a lane section lies inside of it."""
MEET, STRAIGHT = 0.75, 0.35
"""m, rad: a lane without a link goes on into one that begins where it ends and heads as it does (our choice)."""
URBAN_TYPES = frozenset({"town", "townExpressway", "townCollector", "townArterial", "townPrivate", "townLocal",
                         "townPlayStreet", "lowSpeed", "pedestrian"})  # fmt: skip
"""Road types of OpenDRIVE that lie in towns."""


class Ways(NamedTuple):
    """A graph of rows: those that row r leads to are `to[first[r]:first[r + 1]]`."""

    first: Rows
    to: Rows


class Stations(NamedTuple):
    """Metres along lane centres from where they are entered, tabulated at even steps of s.

    first (L + 1,): where a row's nodes begin; start, step (L,): m of the road; at (M,): m along the centre from the
    section's start; length (L,): m of the centre; forward (L,): whether it is driven in the direction of s.
    """

    first: Rows
    start: Floats
    step: Floats
    at: Floats
    length: Floats
    forward: Bools


@dataclass(frozen=True, eq=False)
class MinedLanes:
    """The L rows of `RoadNetwork.lane_table`; those that nobody drives on are in no graph and beside nobody.

    Attributes:
        network: The map.
        after: What a row goes on into, in driving direction.
        before: What goes on into it.
        left: (L,) the next driven lane to the left in driving direction, whichever way that is driven; -1 for none.
        right: (L,) likewise to the right.
        beside_left: (L,) the lane index next to the left, if it is driven the same way; -1 for none.
        beside_right: (L,) likewise to the right.
        stations: Metres along the lane centres.
        turn: (L,) rad, by how much the lane turns, left positive.
        road: (L,) number of the road in the map.
        junction: (L,) number of the junction that the road is inside of, -1 for none.
        kind: (L,) lane type.
        road_type: (L,) type of the road there, "" for none.
        lanes: (L,) driven lanes of the section in the direction of this one.
    """

    network: RoadNetwork
    after: Ways
    before: Ways
    left: Rows
    right: Rows
    beside_left: Rows
    beside_right: Rows
    stations: Stations
    turn: Floats
    road: Rows
    junction: Rows
    kind: NDArray[np.str_]
    road_type: NDArray[np.str_]
    lanes: Rows

    @cached_property
    def _roads(self) -> tuple[Road, ...]:
        return tuple(self.network.roads.values())

    def road_of(self, row: int) -> Road:
        """Give the road of a row."""
        return self._roads[int(self.road[row])]

    def station(self, row: Rows, s: Floats) -> Floats:
        """Give metres (K,) along the lane centre from where row (K,) is entered; s (K,) m along the road."""
        table = self.stations
        first, count = table.first[row], table.first[row + 1] - table.first[row]
        place = np.clip((s - table.start[row]) / table.step[row], 0.0, count - 1.0)
        node = np.minimum(place.astype(np.intp), count - 2)
        low, high = table.at[first + node], table.at[first + node + 1]
        along = low + (place - node) * (high - low)
        return np.asarray(np.where(table.forward[row], along, table.length[row] - along))

    def urban(self, row: Rows, limit: Floats, slow: float) -> Bools:
        """Say whether rows (K,) lie in a town: by the road's type, else by a limit (K,) [m/s] of up to `slow`."""
        kind = self.road_type[row]
        told = ~np.isin(kind, ["", "unknown"])
        return np.asarray(np.where(told, np.isin(kind, list(URBAN_TYPES)), limit <= slow))


@lru_cache(maxsize=4)
def lane_map(network: RoadNetwork) -> MinedLanes:
    """Give the lane map of a network; the last ones are kept."""
    table = network.lane_table
    driven = table.drivable & (table.lane != 0)
    stations, turn, ends = _stations(network, driven)
    pairs = _links(network, driven)
    pairs = np.concatenate([pairs, _joins(pairs, driven, ends)])
    left, right, beside_left, beside_right, lanes = _neighbours(network, driven)
    roads = list(network.roads.values())
    numbers = {name: k for k, name in enumerate(network.junctions)}
    junction = [
        -1 if road.junction is None else numbers.setdefault(road.junction, len(numbers)) for road in roads
    ]
    found = MinedLanes(
        network, _ways(pairs, len(driven)), _ways(pairs[:, ::-1], len(driven)), left, right, beside_left, beside_right,
        stations, turn, table.road.astype(np.int32), np.array(junction, np.int32)[table.road],
        np.array(table.types, dtype=str), _road_types(network), lanes,
    )  # fmt: skip
    return sealed(found)


def _links(network: RoadNetwork, driven: Bools) -> Rows:
    """Pairs (P, 2) of driven rows, the second of which the first goes on into."""
    table = network.lane_table
    names = list(network.roads)
    keys = zip(table.road.tolist(), table.section.tolist(), table.lane.tolist(), strict=True)
    row = {LaneKey(names[road], section, lane): k for k, (road, section, lane) in enumerate(keys)}
    pairs = [(row[one], row[other]) for one, after in lane_graph(network).items() for other in after]
    found = np.array(pairs or np.zeros((0, 2)), dtype=np.int32).reshape(-1, 2)
    return found[driven[found].all(axis=1)]


def _ways(pairs: Rows, count: int) -> Ways:
    order = np.argsort(pairs[:, 0], kind="stable")
    first = np.searchsorted(pairs[order, 0], np.arange(count + 1)).astype(np.int32)
    return Ways(first, np.ascontiguousarray(pairs[order, 1]))


class _Ends(NamedTuple):
    """Where each row is entered (x, y, heading) and left, (L, 3) each; NaN for rows that nobody drives on."""

    entered: Floats
    left: Floats


def _stations(network: RoadNetwork, driven: Bools) -> tuple[Stations, Floats, _Ends]:
    """Tabulate the length of every driven lane centre: chords between nodes, each bent by its turn (exact on arcs)."""
    table = network.lane_table
    names = np.array(list(network.roads))
    whole = np.array([road.length for road in network.roads.values()])
    start = table.start
    span = np.maximum(np.minimum(table.end, whole[table.road]) - start, 2.0 * INSIDE)
    count = np.where(driven, np.maximum(np.ceil(span / NODE), 1.0) + 1, 2).astype(np.int32)
    first = np.concatenate([[0], np.cumsum(count)]).astype(np.int32)
    row = np.repeat(np.arange(len(count)), count)
    node = np.arange(len(row)) - first[row]
    step = span / (count - 1)
    s = np.minimum(start[row] + node * step[row], start[row] + span[row] - INSIDE)
    x, y, heading = (np.full(len(row), np.nan) for _ in range(3))
    use = driven[row]
    where = names[table.road[row[use]]], table.lane[row[use]], s[use]
    x[use], y[use] = network.to_xy(*where, 0.0)
    heading[use] = network.lane_heading(*where)
    along, turn = _lengths(x, y, heading, first)
    sign = np.where(table.forward, 1.0, -1.0)
    pose = np.stack([x, y, heading], axis=1)
    low, high = pose[first[:-1]], pose[first[1:] - 1]
    entered = np.where(table.forward[:, None], low, high)
    stations = Stations(first, start, step, along, along[first[1:] - 1], table.forward)
    return stations, sign * turn, _Ends(entered, np.where(table.forward[:, None], high, low))


def _lengths(x: Floats, y: Floats, heading: Floats, first: Rows) -> tuple[Floats, Floats]:
    """Metres (M,) from the first node of each row, and how far (L,) [rad] each row turns from its first to its last."""
    bend = wrap_angle(np.diff(heading))
    half = 0.5 * np.abs(bend)
    chord = np.hypot(np.diff(x), np.diff(y))
    arc = chord * np.where(half > 1e-6, half / np.maximum(np.sin(np.minimum(half, 1.5)), 1e-9), 1.0)
    between = first[1:-1] - 1  # from one row's last node to the next row's first
    arc[between] = bend[between] = 0.0
    sums = (np.concatenate([[0.0], np.cumsum(np.nan_to_num(a))]) for a in (arc, bend))
    along, turned = sums
    return along - np.repeat(along[first[:-1]], np.diff(first)), turned[first[1:] - 1] - turned[first[:-1]]


def _joins(pairs: Rows, driven: Bools, ends: _Ends) -> Rows:
    """Pairs of rows of which the map links the first to none, and which meet end to end all the same."""
    open_end = driven.copy()
    open_end[pairs[:, 0]] = False
    open_start = driven.copy()
    open_start[pairs[:, 1]] = False
    one, two = np.flatnonzero(open_end), np.flatnonzero(open_start)
    if not len(one) or not len(two):
        return np.zeros((0, 2), np.int32)
    near = cKDTree(ends.left[one, :2]).query_ball_tree(cKDTree(ends.entered[two, :2]), MEET)
    found = [(one[k], two[j]) for k, js in enumerate(near) for j in js if one[k] != two[j]]
    out = np.array(found or np.zeros((0, 2)), dtype=np.int32).reshape(-1, 2)
    turn = np.abs(wrap_angle(ends.left[out[:, 0], 2] - ends.entered[out[:, 1], 2]))
    return out[turn < STRAIGHT]


def _neighbours(network: RoadNetwork, driven: Bools) -> tuple[Rows, Rows, Rows, Rows, Rows]:
    """left, right, beside_left, beside_right and lanes, as in `MinedLanes`."""
    table = network.lane_table
    count = len(driven)
    up, down, next_up, next_down = (np.full(count, -1, np.int32) for _ in range(4))
    lanes = np.zeros(count, np.int32)
    section = np.cumsum(np.r_[0, (np.diff(table.road) != 0) | (np.diff(table.section) != 0)])
    order = np.lexsort((table.lane, section))
    order = order[driven[order]]
    one, two = order[:-1], order[1:]
    same = section[one] == section[two]
    one, two = one[same], two[same]
    up[one], down[two] = two, one
    low, high = table.lane[one], table.lane[two]
    next_to = (high - low == 1) | ((low == -1) & (high == 1))
    next_to &= table.forward[one] == table.forward[two]
    next_up[one[next_to]], next_down[two[next_to]] = two[next_to], one[next_to]
    way = 2 * section + table.forward
    lanes[driven] = np.bincount(way[driven], minlength=way.max() + 1)[way[driven]]
    ahead = table.forward
    pick = [(up, down), (down, up), (next_up, next_down), (next_down, next_up)]
    left, right, beside_left, beside_right = (np.where(ahead, a, b).astype(np.int32) for a, b in pick)
    return left, right, beside_left, beside_right, lanes


def _road_types(network: RoadNetwork) -> NDArray[np.str_]:
    """The type of the road (L,) in the middle of each row, "" where the file says none."""
    table = network.lane_table
    roads = list(network.roads.values())
    out = []
    for number, low, high in zip(table.road.tolist(), table.start.tolist(), table.end.tolist(), strict=True):
        types = [
            kind for kind in roads[number].types if kind.s <= 0.5 * (low + min(high, roads[number].length))
        ]
        out.append(types[-1].type if types else "")
    return np.array(out, dtype=str)
