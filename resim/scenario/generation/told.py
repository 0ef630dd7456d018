"""What a route and a speed say that an object does: lane changes, turns, standing, speeding."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import brentq

from resim.core.geometry import Floats
from resim.road.opendrive import RoadNetwork
from resim.scenario.generation.curve import RouteCurve
from resim.scenario.generation.lane_curve import LanePiece
from resim.scenario.generation.speed import SpeedProfile
from resim.scenario.generation.truth import TrueManeuver, junction_passes, lane_name, runs_of

_STANDS = 1e-9
_LIMIT = 1e-6


@dataclass(frozen=True, eq=False)
class DrivenRoute:
    """A route with the speed along it.

    pieces: of the curve, () of a route by points. changed: of each change, by its number, the first and last piece.
    """

    curve: RouteCurve
    pieces: tuple[LanePiece, ...]
    changed: Mapping[int, tuple[int, int]]
    speed: SpeedProfile

    @cached_property
    def begins(self) -> Floats:
        """Parameters at which the pieces begin, and at which the last one ends."""
        return np.concatenate([[0.0], np.cumsum([piece.length for piece in self.pieces])])

    def time(self, q: float) -> float:
        """Give when [s] it is at a parameter of the curve; inf where it never is."""
        return self.speed.time_at(self.curve.way(q))


def lane_changes(name: str, route: DrivenRoute) -> Iterator[TrueManeuver]:
    """Give the lane changes that are begun, and cross a border: their defining moment.

    To leave the driven lanes, for the shoulder or the field, is none.
    """
    for first, last in route.changed.values():
        one, two = route.pieces[first], route.pieces[last]
        section = two.network.roads[two.road].sections[two.section]
        if one.lane == one.to_lane or not section.lanes[two.to_lane].drivable:
            continue
        crossing = _crossing(route, first, last)
        if np.isfinite(crossing):
            start, end = (route.time(float(route.begins[k])) for k in (first, last + 1))
            to = "left" if (abs(one.to_lane - one.lane) and (one.to_lane > one.lane) == one.up) else "right"
            names = lane_name(one.road, one.lane), lane_name(two.road, two.to_lane)
            yield TrueManeuver(name, f"lane_change_{to}", start, end, crossing, "", *names)


def _crossing(route: DrivenRoute, first: int, last: int) -> float:
    """When [s] the centre crosses the border of the lane that it leaves; inf where it never does."""
    for k in range(first, last + 1):
        piece = route.pieces[k]
        if piece.beyond(piece.length) > 0.0:
            q = 0.0 if piece.beyond(0.0) > 0.0 else brentq(piece.beyond, 0.0, piece.length, xtol=1e-12)
            return route.time(float(route.begins[k] + q))
    return np.inf


def turns(name: str, network: RoadNetwork, route: DrivenRoute) -> Iterator[TrueManeuver]:
    """Give the ways through junctions that are driven to their end."""
    for turn in junction_passes(network, route.pieces):
        start, end = (route.time(float(route.begins[k])) for k in (turn.first, turn.last + 1))
        if np.isfinite(end):
            yield TrueManeuver(name, turn.label, start, end, start, "", turn.lane_from, turn.lane_to)


def standing(name: str, t: Floats, v: Floats) -> Iterator[TrueManeuver]:
    """Give when an object stands; t, v: (K,) its samples."""
    for a, b in runs_of(t, np.abs(v) < _STANDS):
        if b > a:
            yield TrueManeuver(name, "standing", a, b, a)


def speeding(name: str, network: RoadNetwork, t: Floats, states: Floats) -> Iterator[TrueManeuver]:
    """Give when a vehicle is faster than the limit of the lane that its centre is on; states: (6, K)."""
    at = network.to_road(states[0], states[1], heading=states[2])
    limit = np.where(at.on_road, network.speed_limit(at.road, at.lane, at.s), np.inf)
    for a, b in runs_of(t, np.abs(states[3]) > limit + _LIMIT):
        yield TrueManeuver(name, "speeding", a, b, a)
