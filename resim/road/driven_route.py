"""The route that a drive took over the roads of a map, and where another drive left it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import groupby, pairwise, zip_longest

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Bools, Floats, wrap_angle
from resim.road.links import LaneKey, lane_graph, ways
from resim.road.opendrive import DrivingLanes, RoadNetwork, RoadPositions
from resim.road.opendrive.index import LEVEL

_END = 1.0
"""How near [m] to its last road's end a drive is beyond the end of a route, and how far it goes to have a direction."""
_ASIDE = 3.5
"""How far [m] aside of the lanes of the last road, a lane's width, a drive comes over the end of the route."""
_CORNER, _SAMPLE = 1.5, 5.0
"""How much longer the way along roads is at most than that of who cuts their corners: a factor, and m."""
_ALONG = 0.5 * np.pi
"""By how much [rad] the heading of who drives along a lane is off it at most."""


@dataclass(frozen=True)
class Route:
    """Roads in the order in which a drive took them; all lanes of a road belong to it.

    Attributes:
        steps: Ids of roads: one at a time outside of junctions; inside, all the connecting roads that lead side by side
            from the road before to the one after, and with each of them all that it was on besides.
        onwards: Whether it leads along the last road in the direction of its s, or against it; of a route that ends
            inside of a junction that is as the lanes say.
    """

    steps: tuple[tuple[str, ...], ...] = ()
    onwards: bool = True

    @property
    def roads(self) -> tuple[str, ...]:
        """Ids of all its roads, each once, in the order in which they are first taken."""
        return tuple(dict.fromkeys(road for step in self.steps for road in step))

    def after(self, road: str) -> frozenset[str]:
        """Give the roads that it goes on into from a road: none from its last, nor from a road that is not on it."""
        return frozenset(name for one, two in pairwise(self.steps) if road in one for name in two)


NO_ROUTE = Route()
"""An object whose way is unknown."""


def driven_route(
    network: RoadNetwork, x: Floats, y: Floats, heading: Floats, *, z: Floats | None = None
) -> Route:
    """Give the route of a drive with centre positions x, y (K,) [m] and headings (K,) [rad], in order of time.

    z: heights (K,) [m] of the road, if they are known. Which connecting road of several on one spot a drive takes, only
    the road that it comes to tells. Where the map links no lanes from one road to the next, and where the drive begins
    or ends inside of a junction, they are those that it was on. A position on no driving lane tells nothing.
    """
    at = network.to_road(x, y, heading=heading, z=z)
    on, places = np.flatnonzero(at.on_road), np.column_stack([x, y])
    steps: list[tuple[str, ...]] = []
    before, inside = None, list[int]()
    for road, group in groupby(on.tolist(), key=lambda k: str(at.road[k])):
        if network.roads[road].junction is not None:
            inside += group
            continue
        steps += [*_through(network, before, road, at, places, inside), (road,)]
        before, inside = road, []
    steps += _through(network, before, None, at, places, inside)
    return Route(tuple(steps), _onwards(network, at, on))


def _onwards(network: RoadNetwork, at: RoadPositions, on: NDArray[np.intp]) -> bool:
    """Whether a drive with samples on roads went in the direction of s at its end."""
    if not len(on):
        return True
    last = on[-1]
    name, s = str(at.road[last]), float(at.s[last])
    others = np.flatnonzero(at.road[on] != name)
    stretch = at.s[on[others[-1] + 1 if len(others) else 0 :]]
    away = np.flatnonzero(np.abs(s - stretch) > _END)
    road = network.roads[name]
    return bool(s > stretch[away[-1]]) if len(away) else road.along(int(at.lane[last]), road.section_index(s))


@lru_cache(maxsize=64)
def only_roads(network: RoadNetwork, roads: tuple[str, ...]) -> RoadNetwork:
    """Give the map with these of its roads alone; the last ones are kept."""
    return replace(network, roads={name: network.roads[name] for name in roads})


def first_off_route(
    network: RoadNetwork,
    route: Route,
    x: Floats,
    y: Floats,
    heading: Floats,
    *,
    z: Floats | None = None,
) -> int | None:
    """Give the first of K samples (as of `driven_route`) at which a drive is on a driving lane off its route, or None.

    Who goes on over the end of its last road has not left it, wherever he goes then; of a route without roads nobody
    knows. Roads are to be taken in their order: who comes to a later one by another way has left it, too.
    """
    return first_off_routes(network, route, [(x, y, heading, z)])[0]


def first_off_routes(
    network: RoadNetwork, route: Route, drives: Sequence[tuple[Floats, Floats, Floats, Floats | None]]
) -> list[int | None]:
    """Give what `first_off_route` gives of each of several drives: x, y, heading and z, None where it is not known."""
    if not route.steps:
        return [None] * len(drives)
    ends = np.cumsum([0, *(len(x) for x, *_ in drives)])
    x, y = np.concatenate([x for x, *_ in drives]), np.concatenate([y for _, y, *_ in drives])
    every = network.driving_lanes(x, y)
    out = []
    for drive, (first, after) in zip(drives, pairwise(ends.tolist()), strict=True):
        low, high = np.searchsorted(every.point, (first, after))
        of = slice(int(low), int(high))
        lanes = DrivingLanes(every.point[of] - first, every.road[of], every.heading[of], every.z[of])
        out.append(_first_off(network, route, lanes, drive))
    return out


def _first_off(
    network: RoadNetwork,
    route: Route,
    lanes: DrivingLanes,
    drive: tuple[Floats, Floats, Floats, Floats | None],
) -> int | None:
    """The first sample off the route; lanes: at the samples. drive: x, y, heading, z."""
    x, y, heading, z = drive
    held = np.isin(lanes.road, route.roads)
    if z is not None:
        held &= ~(np.abs(lanes.z - z[lanes.point]) > LEVEL)
    on, anywhere = np.zeros(len(x), dtype=bool), np.zeros(len(x), dtype=bool)
    on[lanes.point[held]] = anywhere[lanes.point] = True
    known, out = _taken(network, route, _there(route, lanes, heading), x, y)
    on[out:] = False
    off = np.flatnonzero(anywhere & ~on)
    if not len(off):
        return None
    first = int(off[0])
    was = np.flatnonzero(on[:first])
    if len(was) and known[-1, was[-1]] and _ended(network, route, x, y, heading, int(was[-1])):
        return None
    return first


def _there(route: Route, lanes: DrivingLanes, heading: Floats) -> Bools:
    """Say on which steps of the route (S, K) a drive goes along a lane at each of its samples, with headings (K,)."""
    along = np.abs(wrap_angle(lanes.heading - heading[lanes.point])) < _ALONG
    point, road = lanes.point[along], lanes.road[along]
    out = np.zeros((len(route.steps), len(heading)), dtype=bool)
    for step, at in zip(route.steps, out, strict=True):
        at[point[np.isin(road, step)]] = True
    return out


def _taken(
    network: RoadNetwork, route: Route, there: Bools, x: Floats, y: Floats
) -> tuple[NDArray[np.bool_], int]:
    """Give which steps (S, K) of the route a drive can be on at each sample, and the first sample where there is none.

    there: the steps (S, K) that it goes along. From a step it comes to the next, at once where both are at one place,
    goes back to the one before, and passes those that are no longer than its way since it was on a step.
    """
    # compiled: numba is imported where it is used only
    from resim.road.kernel import taken

    if len(route.steps) == 1:
        return np.ones((1, len(x)), dtype=bool), len(x)
    lengths = [min(network.roads[name].length for name in step) for step in route.steps]
    ends, here = np.cumsum(lengths), np.arange(len(lengths))
    between = ends[None, :] - lengths - ends[:, None]  # from the end of a step to the start of another
    between[np.tril_indices(len(ends))] = np.inf
    between[here, here] = between[here[1:], here[:-1]] = 0.0
    went = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    known = np.zeros_like(there)
    return known, taken(there, between, went, _CORNER, _SAMPLE, known)


def _ended(network: RoadNetwork, route: Route, x: Floats, y: Floats, heading: Floats, last: int) -> bool:
    """Whether a drive whose last sample on the route this is came over the route's end then, and not by its side."""
    own = only_roads(network, route.roads)
    at = own.to_road(x[last : last + 1], y[last : last + 1], heading=heading[last : last + 1])
    name, s = str(at.road[0]), float(at.s[0])
    road = own.roads[name]
    onwards = route.onwards if road.junction is None else road.along(int(at.lane[0]), road.section_index(s))
    end_x, end_y, turn = own.reference_line(name, road.length if onwards else 0.0)
    ahead = (x[last:] - end_x + 1j * (y[last:] - end_y)) * np.exp(-1j * (turn if onwards else turn + np.pi))
    beyond = np.flatnonzero(ahead[1:].real >= -_END)
    if name not in route.steps[-1] or not len(beyond):
        return False
    way = ahead[: beyond[0] + 2]
    left = road.length - s if onwards else s
    return bool(left <= np.abs(np.diff(way)).sum() + _END and abs(way[-1].imag - way[0].imag) <= _ASIDE)


def _through(
    network: RoadNetwork,
    before: str | None,
    after: str | None,
    at: RoadPositions,
    xy: Floats,
    inside: list[int],
) -> Iterator[tuple[str, ...]]:
    """The steps from a road outside of junctions to the next, None where there is none; inside: samples between."""
    seen = list(dict.fromkeys(str(at.road[k]) for k in inside))
    chains = list(_chains(network, before, after)) if before is not None and (after or seen) else []
    if after is None:
        chains = [chain for chain in chains if seen[-1] in chain]
    levels = [tuple(dict.fromkeys(name for name in level if name)) for level in zip_longest(*chains)]
    if levels and inside:  # roads that the drive was on where it was off those that it must have taken
        held = only_roads(network, Route(tuple(levels)).roads).to_road(*xy[inside].T).on_road
        seen = list(dict.fromkeys(str(at.road[k]) for k, on in zip(inside, held, strict=True) if not on))
    yield from (tuple(dict.fromkeys((*level, *seen))) for level in levels)
    if not levels:
        for _, names in groupby(seen, key=lambda name: network.roads[name].junction):
            yield tuple(names)


def _chains(network: RoadNetwork, before: str, after: str | None) -> Iterator[tuple[str, ...]]:
    """The roads inside of junctions that lead from one road to another, or to any."""
    graph = _graph(network)
    inside = {road.id for road in network.roads.values() if road.junction is not None}
    for start in [key for key in graph if key.road == before]:
        for way in ways(graph, start, inside):
            if after in (None, way[-1].road):
                yield tuple(dict.fromkeys(key.road for key in way[:-1]))


@lru_cache(maxsize=4)
def _graph(network: RoadNetwork) -> Mapping[LaneKey, tuple[LaneKey, ...]]:
    return lane_graph(network)
