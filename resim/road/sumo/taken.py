"""What of the map's lights, signs and priorities the net has."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from resim.core import spec
from resim.road.opendrive import RoadNetwork, SpeedSign
from resim.road.opendrive.limits import signs_for
from resim.road.sumo.pieces import Piece
from resim.road.sumo.plain import PlainNetwork
from resim.road.sumo.programs import Program
from resim.road.sumo.rules import Rules, UnusedRule


@dataclass(frozen=True)
class TakenRules:
    """What of the map's rules is in the net.

    lights: how many traffic lights. signs: how many signs of right of way. speed_signs: how many that begin or end a
    limit. priorities: how many of junctions. programs: of the traffic lights, one for each node that has some.
    left_out: what is not in the net, and why.
    """

    __pydantic_config__ = spec.EXACT

    lights: int = 0
    signs: int = 0
    speed_signs: int = 0
    priorities: int = 0
    programs: tuple[Program, ...] = ()
    left_out: tuple[UnusedRule, ...] = ()


def taken(
    network: RoadNetwork, made: PlainNetwork, rules: Rules, programs: tuple[Program, ...]
) -> TakenRules:
    """Give what the net has of the rules. programs: those in the net."""
    lights = {light for own in rules.lights.values() for light in own}
    signs = sum(len(road.signs) for road in network.roads.values())
    lost = list(_speed_signs(network, made))
    left_out = (*rules.left_out, *lost, *_controllers(network, lights))
    return TakenRules(len(lights), rules.signs, signs - len(lost), rules.priorities, programs, left_out)


def _speed_signs(network: RoadNetwork, made: PlainNetwork) -> Iterator[UnusedRule]:
    """The speed signs that give no edge its limit: an edge has the one in its middle (`plainxml`)."""
    holding = {(piece.road, _sign(network, piece, lane)) for piece in made.pieces.all for lane in piece.lanes}
    for road in network.roads.values():
        for sign in road.signs:
            if math.isnan(sign.speed):
                why = f"it shows no speed that a sign can show ({sign.text})"
                yield UnusedRule("speed sign", sign.id, road.id, sign.s, why)
            elif (road.id, sign) not in holding:
                yield UnusedRule("speed sign", sign.id, road.id, sign.s, "it holds in the middle of no edge")


def _sign(network: RoadNetwork, piece: Piece, lane: int) -> SpeedSign | None:
    """The speed sign that holds for a lane in the middle of an edge."""
    middle = 0.5 * (piece.start + piece.end)
    signs = [
        sign
        for sign in signs_for(network.roads[piece.road], lane, piece.forward)
        if (sign.s <= middle) == piece.forward
    ]
    return signs[-1 if piece.forward else 0] if signs else None


def _controllers(network: RoadNetwork, lights: set[str]) -> Iterator[UnusedRule]:
    """The controllers without a traffic light in the net."""
    for controller in network.controllers:
        if lights.isdisjoint(controller.signals):
            why = "it switches no traffic light of the net" if controller.signals else "it names no signal"
            yield UnusedRule("controller", controller.id, "", None, why)
