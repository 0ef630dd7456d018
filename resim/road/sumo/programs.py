"""Programs of traffic lights: those of the map's controllers in turn; where it has none that fit, netconvert's own."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

from lxml import etree

from resim.core import spec
from resim.road.opendrive import Controller, RoadNetwork
from resim.road.sumo.patch import Via, connection_ends
from resim.road.sumo.plain import Ends
from resim.road.sumo.rules import Rules

CYCLE, SHORTEST_GREEN, YELLOW = 90.0, 5.0, 3.0
"""Durations [s]: of the program, as netconvert's; maps say none."""


@dataclass(frozen=True)
class Program:
    """The program of the traffic lights at one node of the net.

    id: the node's. connections: how many it rules. controllers: of the map, whose lights are green in turn, in this
    order; none where the program is netconvert's own. remark: why it is.
    """

    __pydantic_config__ = spec.EXACT

    id: str
    connections: int
    controllers: tuple[str, ...]
    remark: str


class _Group(NamedTuple):
    """Connections that are green together, and their controller."""

    controller: str
    green: frozenset[Ends]


def write_programs(network: RoadNetwork, rules: Rules, root: etree._Element, via: Via) -> tuple[Program, ...]:
    """Write the programs of controllers over netconvert's; give what every traffic light of the net has."""
    index: dict[str, dict[int, Ends]] = defaultdict(dict)
    for element in root.iterfind("connection[@tl]"):
        index[element.get("tl", "")][int(element.get("linkIndex", "0"))] = connection_ends(element)
    junctions = {element.get("id", ""): element for element in root.iterfind("junction")}
    controllers = _in_order(network)
    programs = []
    for logic in root.iterfind("tlLogic"):
        node = logic.get("id", "")
        groups = list(_groups(controllers, rules, index[node].values()))
        remark = _why_not(groups, rules, index[node].values())
        if not remark:
            _write(logic, groups, index[node], _yields(junctions[node], via))
        names = () if remark else tuple(group.controller for group in groups)
        programs.append(Program(node, len(index[node]), names, remark))
    return tuple(programs)


def _in_order(network: RoadNetwork) -> list[Controller]:
    """The controllers in the order of their junctions, those of no junction last, in their own order."""
    place: dict[str, int] = {}
    for junction in network.junctions.values():
        for k, name in enumerate(junction.controllers):
            place.setdefault(name, k)
    return sorted(network.controllers, key=lambda each: place.get(each.id, len(place)))


def _groups(controllers: Collection[Controller], rules: Rules, here: Collection[Ends]) -> Iterator[_Group]:
    for controller in controllers:
        signals = set(controller.signals)
        green = frozenset(ends for ends in here if not signals.isdisjoint(rules.lights[ends]))
        if green:
            yield _Group(controller.id, green)


def _why_not(groups: Collection[_Group], rules: Rules, here: Collection[Ends]) -> str:
    """Why the controllers make no program, "" where they do."""
    if not groups:
        return "no controller switches its lights"
    without = set(here).difference(*(group.green for group in groups))
    if without:
        lights = sorted({light for ends in without for light in rules.lights[ends]})
        return f"no controller switches its lights {', '.join(lights)}"
    whole = [group.controller for group in groups if group.green.issuperset(here)]
    return f"controller {whole[0]} switches all its lights" if whole else ""


def _yields(junction: etree._Element, via: Via) -> dict[Ends, set[Ends]]:
    """The connections to which each connection of a junction gives way, as netconvert has worked out."""
    last = {lanes[-1]: ends for ends, lanes in via.items()}
    here = [last.get(lane) for lane in junction.get("intLanes", "").split()]
    found: dict[Ends, set[Ends]] = {}
    for request in junction.iterfind("request"):
        own = here[int(request.get("index", "0"))]
        bits = reversed(request.get("response", ""))
        if own is not None:
            found[own] = {
                other for other, bit in zip(here, bits, strict=True) if bit == "1" and other is not None
            }
    return found


def _write(
    logic: etree._Element, groups: list[_Group], index: Mapping[int, Ends], yields: Mapping[Ends, set[Ends]]
) -> None:
    """Write a phase of green and one of yellow for each group."""
    given = logic.findall("phase")
    yellow = max((float(p.get("duration", "0")) for p in given if "y" in p.get("state", "")), default=YELLOW)
    green = max(CYCLE // len(groups) - yellow, SHORTEST_GREEN)
    for phase in given:
        logic.remove(phase)
    for now, then in pairwise([*groups, groups[0]]):
        states = {
            ends: "r" if ends not in now.green else "g" if yields[ends] & now.green else "G"
            for ends in index.values()
        }  # fmt: skip
        changing = {
            ends: "y" if state != "r" and ends not in then.green else state for ends, state in states.items()
        }
        for duration, letters in ((green, states), (yellow, changing)):
            state = "".join(letters[index[k]] for k in sorted(index))
            etree.SubElement(logic, "phase", duration=f"{duration:g}", state=state).tail = given[0].tail
