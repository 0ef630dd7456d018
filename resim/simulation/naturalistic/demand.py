"""Who comes, when, and where to: vehicles drawn for a SUMO net, each with a driver of its own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from lxml import etree

from resim.core.errors import InputError
from resim.road.opendrive import RoadNetwork
from resim.simulation.naturalistic.settings import NaturalisticSettings, PopulationSettings

RAMPS = ("onRamp", "offRamp", "entry", "exit", "mwyEntry", "mwyExit", "connectingRamp", "slipLane")
MOST_ROUTES = 2000


@dataclass(frozen=True)
class NetEdge:
    """An edge of the net. lanes: of the map (road, lane), of those that cars drive on; after: what it leads to."""

    id: str
    lanes: tuple[tuple[str, int], ...]
    after: tuple[str, ...]


@dataclass(frozen=True)
class SpawnedVehicle:
    """A vehicle to spawn. edges: its route. parameters: of its driver, by SUMO's names."""

    id: str
    kind: str
    depart: float
    edges: tuple[str, ...]
    length: float
    width: float
    parameters: Mapping[str, float]


def read_edges(net: Path) -> dict[str, NetEdge]:
    """Give the edges of a net that are not inside of junctions, without those that no car drives on."""
    root = etree.parse(str(net)).getroot()
    after: dict[str, dict[str, None]] = {}
    for element in root.iterfind("connection"):
        if not element.get("from", "").startswith(":"):
            after.setdefault(element.get("from", ""), {})[element.get("to", "")] = None
    edges = {}
    for element in root.iterfind("edge"):
        name = element.get("id", "")
        if name.startswith(":"):
            continue
        if lanes := tuple(map_lane(lane) for lane in element.iterfind("lane") if drives(lane)):
            edges[name] = NetEdge(name, lanes, tuple(after.get(name, ())))
    return {
        name: NetEdge(name, edge.lanes, tuple(to for to in edge.after if to in edges))
        for name, edge in edges.items()
    }


def drives(lane: etree._Element) -> bool:
    """Say whether cars drive on a lane of the net."""
    allowed, forbidden = lane.get("allow", "").split(), lane.get("disallow", "").split()
    return ("passenger" in allowed or not allowed) and not {"passenger", "all"} & set(forbidden)


def map_lane(lane: etree._Element) -> tuple[str, int]:
    """Give road and lane of the map that a lane of the net begins with."""
    told = lane.find("param[@key='origId']")
    first = (told.get("value", "") if told is not None else "").split()[0]
    road, _, number = first.rsplit("_", 2)
    return road, int(number)


def routes_from(
    edges: Mapping[str, NetEdge], network: RoadNetwork, start: str, exit_share: float
) -> list[tuple[tuple[str, ...], float]]:
    """Give every route from an edge to where the map ends, each with its probability.

    Where a way leads to a ramp (and others do not), it gets the exit share; the rest is even.
    """
    found: list[tuple[tuple[str, ...], float]] = []
    stack: list[tuple[tuple[str, ...], float]] = [((start,), 1.0)]
    while stack and len(found) < MOST_ROUTES:
        route, share = stack.pop()
        onward = [to for to in edges[route[-1]].after if to not in route]
        if not onward:
            found.append((route, share))
            continue
        ramps = [to for to in onward if _is_ramp(edges[to], network)]
        rest = [to for to in onward if to not in ramps]
        for to in onward:
            part = 1.0 / len(onward) if not ramps or not rest else exit_share / len(ramps) if to in ramps else (
                (1.0 - exit_share) / len(rest))  # fmt: skip
            stack.append(((*route, to), share * part))
    return found


def _is_ramp(edge: NetEdge, network: RoadNetwork) -> bool:
    """Whether all lanes of the edge are those of ramps."""
    return all(_lane_type(network, road, lane) in RAMPS for road, lane in edge.lanes)


def _lane_type(network: RoadNetwork, road: str, lane: int) -> str:
    return next((s.lanes[lane].type for s in network.roads[road].sections if lane in s.lanes), "")


def spawn(
    edges: Mapping[str, NetEdge],
    network: RoadNetwork,
    settings: NaturalisticSettings,
    duration: float,
    seed: int,
) -> list[SpawnedVehicle]:
    """Draw the vehicles of so many seconds, in order of time. Raises InputError for a map that nobody can enter."""
    entered = {to for edge in edges.values() for to in edge.after}
    sources = [name for name in edges if name not in entered]
    if not sources:
        raise InputError(
            network.path, "no lane of the map begins at its border", "Use a map that traffic can enter."
        )
    drawn: list[SpawnedVehicle] = []
    for number, source in enumerate(sources):
        rng = np.random.default_rng([seed, 1, number])
        drawn += _from_source(edges, network, settings, source, duration, rng)
    drawn.sort(key=lambda one: one.depart)
    return [
        SpawnedVehicle(str(n), v.kind, v.depart, v.edges, v.length, v.width, v.parameters)
        for n, v in enumerate(drawn, start=1)
    ]


def _from_source(
    edges: Mapping[str, NetEdge], network: RoadNetwork, settings: NaturalisticSettings, source: str,
    duration: float, rng: np.random.Generator,
) -> Iterator[SpawnedVehicle]:  # fmt: skip
    demand, edge = settings.demand, edges[source]
    flow = demand.ramp if _is_ramp(edge, network) else demand.per_lane * len(edge.lanes)
    count = int(rng.poisson(flow * duration / 3600.0))
    times = np.sort(rng.uniform(0.0, duration, count))
    routes = routes_from(edges, network, source, demand.exit_share)
    shares = np.array([share for _, share in routes])
    chosen = rng.choice(len(routes), count, p=shares / shares.sum())
    trucks = rng.random(count) < demand.truck_share
    drivers = {kind: _drivers(getattr(settings, kind), rng, count) for kind in ("car", "truck")}
    for kind, drawn in drivers.items():  # last, so that all else is drawn as before there were these
        drawn["lcAssertive"] = getattr(settings, kind).assertive.draw(rng, count)
        drawn["actionStepLength"] = getattr(settings, kind).decides.draw(rng, count)
    for n in range(count):
        kind = "truck" if trucks[n] else "car"
        own = {name: round(float(values[n]), 4) for name, values in drivers[kind].items()}
        yield SpawnedVehicle(
            "",
            kind,
            round(float(times[n]), 1),
            routes[int(chosen[n])][0],
            own.pop("length"),
            own.pop("width"),
            own,
        )


def _drivers(population: PopulationSettings, rng: np.random.Generator, count: int) -> dict[str, np.ndarray]:
    names = {
        "length": "length", "width": "width", "speed_factor": "speedFactor", "top_speed": "maxSpeed",
        "time_gap": "tau", "standstill": "minGap", "acceleration": "accel", "deceleration": "decel",
        "speed_gain": "lcSpeedGain", "keep_right": "lcKeepRight",
    }  # fmt: skip
    return {sumo: getattr(population, own).draw(rng, count) for own, sumo in names.items()}
