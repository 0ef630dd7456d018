"""What of the map's lights, signs and priorities the net has."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from resim.core import spec
from resim.road.opendrive import RoadNetwork
from resim.road.sumo.programs import Program
from resim.road.sumo.rules import LeftOut, Rules


@dataclass(frozen=True)
class TakenRules:
    """What of the map's rules is in the net.

    lights: how many traffic lights. signs: how many signs of right of way. speed_signs: how many begin or end a limit.
    priorities: how many of junctions. programs: of the traffic lights, one for each node that has some. left_out: what
    is not in the net, and why.
    """

    __pydantic_config__ = spec.EXACT

    lights: int = 0
    signs: int = 0
    speed_signs: int = 0
    priorities: int = 0
    programs: tuple[Program, ...] = ()
    left_out: tuple[LeftOut, ...] = ()


def taken(network: RoadNetwork, rules: Rules, programs: tuple[Program, ...]) -> TakenRules:
    """Give what the net has of the rules. programs: those in the net."""
    lights = {light for own in rules.lights.values() for light in own}
    speeds = [sign for road in network.roads.values() for sign in road.signs if not math.isnan(sign.speed)]
    left_out = (*rules.left_out, *_controllers(network, lights))
    return TakenRules(len(lights), rules.signs, len(speeds), rules.priorities, programs, left_out)


def _controllers(network: RoadNetwork, lights: set[str]) -> Iterator[LeftOut]:
    """The controllers without a traffic light in the net."""
    for controller in network.controllers:
        if lights.isdisjoint(controller.signals):
            why = "it switches no traffic light of the net" if controller.signals else "it names no signal"
            yield LeftOut("controller", controller.id, "", None, why)
