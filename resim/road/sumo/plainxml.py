"""Writes what goes into the net as SUMO's plain XML, for netconvert: nodes, edges and connections."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from lxml import etree

from resim.core.geometry import Floats
from resim.road.opendrive import VEHICLE_LANES, RoadNetwork
from resim.road.sumo.plain import PlainNetwork
from resim.road.sumo.rules import Rules

ALLOWED = {
    "sidewalk": "pedestrian",
    "walking": "pedestrian",
    "biking": "bicycle",
    "rail": "rail",
    "tram": "tram",
}
NOT_ON_ROADS = (
    "pedestrian tram rail_urban rail rail_electric rail_fast ship container cable_car subway aircraft"
)
DEFAULT_SPEED = 50.0 / 3.6


def names(made: PlainNetwork) -> dict[str, str]:
    """Give what the edges, lanes and nodes of the net are called in the map: for errors of netconvert's."""
    out = {}
    for piece in made.pieces.all:
        out[piece.id] = f"road {piece.road}, s = {piece.start:.3f} to {piece.end:.3f} m"
        ends = ("start", "end") if piece.forward else ("end", "start")
        for node, side in ((piece.origin, ends[0]), (piece.target, ends[1])):
            out.setdefault(node, f"the {side} of {out[piece.id]}")
    return out | {name: str(own.stretch.key) for name, own in made.lanes.items()}


def write(network: RoadNetwork, made: PlainNetwork, rules: Rules, folder: Path) -> list[str]:
    """Write nodes, edges and connections into the folder; give the arguments that make netconvert read them."""
    trees = {
        "node": _nodes(made, rules),
        "edge": _edges(network, made),
        "connection": _connection_xml(made, rules),
    }
    arguments = []
    for name, root in trees.items():
        path = folder / f"map.{name}.xml"
        path.write_bytes(etree.tostring(root))
        arguments += [f"--{name}-files", str(path)]
    return arguments


def _nodes(made: PlainNetwork, rules: Rules) -> etree._Element:
    """Every node in the mean of the lane ends that meet there, with the kind of right of way."""
    ends: dict[str, list[Floats]] = defaultdict(list)
    for piece in made.pieces.all:
        for index in range(len(piece.lanes)):
            line = made.lanes[f"{piece.id}_{index}"].line
            ends[piece.origin].append(line[0])
            ends[piece.target].append(line[-1])
    kinds = dict.fromkeys(rules.all_way, "allway_stop") | dict.fromkeys(rules.lit, "traffic_light")
    root = etree.Element("nodes")
    for name, points in ends.items():
        x, y = np.mean(points, axis=0)
        etree.SubElement(root, "node", id=name, x=_number(x), y=_number(y), type=kinds.get(name, "priority"))
    return root


def _edges(network: RoadNetwork, made: PlainNetwork) -> etree._Element:
    root = etree.Element("edges")
    for piece in made.pieces.all:
        edge = etree.SubElement(root, "edge", {"id": piece.id, "from": piece.origin, "to": piece.target,
                                               "numLanes": str(len(piece.lanes)), "spreadType": "center"})  # fmt: skip
        middle = 0.5 * (piece.start + piece.end)
        limits = network.speed_limit(piece.road, np.array(piece.lanes), np.full(len(piece.lanes), middle))
        for index, (lane, limit) in enumerate(zip(piece.lanes, limits.tolist(), strict=True)):
            own = made.lanes[f"{piece.id}_{index}"]
            element = etree.SubElement(
                edge, "lane", index=str(index), width=_number(own.width), shape=shape_text(own.line),
                speed=_number(limit if math.isfinite(limit) and limit > 0.0 else DEFAULT_SPEED),
            )  # fmt: skip
            name, value = _permission(network.roads[piece.road].sections[piece.section].lanes[lane].type)
            element.set(name, value)
            etree.SubElement(element, "param", key="origId", value=f"{piece.road}_{piece.section}_{lane}")
    return root


def _permission(kind: str) -> tuple[str, str]:
    if kind in VEHICLE_LANES:
        return "disallow", NOT_ON_ROADS
    return ("allow", ALLOWED[kind]) if kind in ALLOWED else ("allow", "authority")


def _connection_xml(made: PlainNetwork, rules: Rules) -> etree._Element:
    root = etree.Element("connections")
    left: dict[str, str] = {}
    for connection in made.connections:
        (origin, before), (target, after) = (
            name.rsplit("_", 1) for name in (connection.origin, connection.target)
        )
        left[origin] = target
        attributes = {"from": origin, "to": target, "fromLane": before, "toLane": after}
        if connection.stretches:
            attributes["shape"] = shape_text(connection.line)
        if rules.node[connection.ends] in rules.lit and connection.ends not in rules.lights:
            attributes["uncontrolled"] = "true"
        etree.SubElement(root, "connection", attributes)
    for piece in made.pieces.all:
        if piece.id not in left:  # said, or netconvert guesses where it might lead
            etree.SubElement(root, "connection", {"from": piece.id})
    for pair in rules.before:
        first, second = (f"{origin}->{target}" for origin, target in pair)
        etree.SubElement(root, "prohibition", prohibitor=first, prohibited=second)
    return root


def shape_text(line: Floats | Sequence[Sequence[float]]) -> str:
    """Give points (K, 2) [m] as SUMO writes them."""
    return " ".join(f"{x:.6f},{y:.6f}" for x, y in np.asarray(line).tolist())


def _number(value: float) -> str:
    return f"{value:.6f}"
