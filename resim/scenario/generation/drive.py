"""One object of a recipe: its curve, its speed, its states at any time, and what it does."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from resim.core.errors import ResimError
from resim.core.geometry import Floats, wrap_angle
from resim.road.opendrive import RoadNetwork
from resim.scenario.generation.curve import RouteCurve, SplinePiece
from resim.scenario.generation.lane_curve import LanePiece, Shift, lane_curve
from resim.scenario.generation.lanes import LanePlace, route_over
from resim.scenario.generation.recipe import (
    ChangeSpec,
    LaneRoute,
    ObjectSpec,
    PlaceSpec,
    PointRoute,
    SlipSpec,
    SpeedOverTimeSpec,
    SpeedOverWaySpec,
)
from resim.scenario.generation.speed import SpeedOverTime, SpeedOverWay, SpeedProfile
from resim.scenario.generation.told import DrivenRoute, lane_changes, speeding, standing, turns
from resim.scenario.generation.truth import TrueManeuver, lane_name

WALKERS = ("pedestrian", "bicycle", "unknown")
"""Kinds that no speed limit is for."""


@dataclass(frozen=True, eq=False)
class GeneratedObject:
    """An object at its times t (K,) [s].

    states: (6, K) x, y [m] of the box centre, heading [rad, not wrapped], v [m/s], a [m/s²], yaw rate [rad/s].
    maneuvers: what it does.
    """

    spec: ObjectSpec
    t: Floats
    states: Floats
    maneuvers: tuple[TrueManeuver, ...]


def object_motion(network: RoadNetwork, spec: ObjectSpec, duration: float, times: Floats) -> GeneratedObject:
    """Give an object's motion at those of the times (T,) [s] at which it is there.

    With the way w(t), the curve's heading ψ(w) and curvature κ(w), and the slip β(t): heading ψ + β, v = w', a = w'',
    yaw rate κ v + β'. Raises ResimError.
    """
    speed = _profile(spec)
    leaves = min(duration, spec.leaves or duration)
    farthest = float(speed.states(np.array([leaves]))[0, 0])
    if isinstance(spec.route, LaneRoute):
        curve, pieces, changed = _along_lanes(network, spec, spec.route, speed, farthest)
    else:
        curve, pieces, changed = RouteCurve([SplinePiece(_points(network, spec.route))]), (), {}
    t = times[(times >= spec.appears - 1e-9) & (times <= leaves + 1e-9)]
    way, v, a = speed.states(t)
    on = way <= curve.length + 1e-9
    t, way, v, a = t[on], way[on], v[on], a[on]
    x, y, heading, curvature = curve.at(np.minimum(way, curve.length))
    sign = -1.0 if spec.reverse else 1.0
    turned = heading + (np.pi if spec.reverse else 0.0)
    slip, slip_rate = _slip(spec.slip, t)
    states = np.stack([x, y, turned + slip, sign * v, sign * a, curvature * v + slip_rate])
    route = DrivenRoute(curve, pieces, changed, speed)
    return GeneratedObject(spec, t, states, tuple(_told(network, spec, route, leaves, t, states)))


def _slip(spec: SlipSpec | None, t: Floats) -> tuple[Floats, Floats]:
    """Slip [rad] and its rate [rad/s] at times (K,): steps of 10 u^3 - 15 u^4 + 6 u^5 from value to value."""
    slip, rate = np.zeros(len(t)), np.zeros(len(t))
    if spec is None:
        return slip, rate
    slip += spec.values[0]
    for (begin, low), (end, high) in pairwise(zip(spec.times, spec.values, strict=True)):
        u = np.clip((t - begin) / (end - begin), 0.0, 1.0)
        slip += (high - low) * u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
        rate += (high - low) / (end - begin) * 30.0 * u**2 * (1.0 - u) ** 2
    return slip, rate


def _told(
    network: RoadNetwork, spec: ObjectSpec, route: DrivenRoute, leaves: float, t: Floats, states: Floats
) -> Iterator[TrueManeuver]:
    """What an object does while it is there, as its route, its speed and its file say."""
    if not len(t):
        return
    found = [*lane_changes(spec.id, route), *turns(spec.id, network, route)]
    for row in found:
        if row.start <= t[-1] and row.t <= leaves:
            yield row._replace(end=min(row.end, leaves))
    yield from _wrong_way(spec, t)
    yield from standing(spec.id, t, states[3])
    if spec.kind not in WALKERS:
        yield from speeding(spec.id, network, t, states)
    for told in spec.maneuver:
        yield TrueManeuver(spec.id, told.label, told.start, told.end, told.t, told.partner)


def _wrong_way(spec: ObjectSpec, t: Floats) -> Iterator[TrueManeuver]:
    route = spec.route
    if isinstance(route, LaneRoute) and route.against and not spec.change and not spec.reverse:
        lane = lane_name(route.road, route.lane)
        yield TrueManeuver(spec.id, "wrong_way", float(t[0]), float(t[-1]), float(t[0]), "", lane, lane)


def _profile(spec: ObjectSpec) -> SpeedProfile:
    told = spec.speed
    if isinstance(told, SpeedOverTimeSpec):
        return SpeedOverTime(np.array(told.times), np.array(told.values), spec.appears)
    if isinstance(told, SpeedOverWaySpec):
        return SpeedOverWay(np.array(told.ways), np.array(told.values), spec.appears)
    return SpeedOverTime(np.array([spec.appears]), np.array([told]), spec.appears)


def _along_lanes(
    network: RoadNetwork, spec: ObjectSpec, route: LaneRoute, speed: SpeedProfile, farthest: float
) -> tuple[RouteCurve, tuple[LanePiece, ...], dict[int, tuple[int, int]]]:
    if route.road not in network.roads:
        raise ResimError(
            f"route: there is no road {route.road!r}; the map has {', '.join([*network.roads][:20])}"
        )
    road = network.roads[route.road]
    up = road.along(route.lane, road.section_index(route.s)) != route.against
    start = LanePlace(route.road, route.lane, route.s, up)
    shifts = [_shift(n, change, speed) for n, change in enumerate(spec.change)]
    far = max([farthest, *(shift.way + shift.length for shift in shifts)]) + 1.0
    return lane_curve(network, start, route.offset, shifts, route_over(network, route.via), far)


def _shift(number: int, change: ChangeSpec, speed: SpeedProfile) -> Shift:
    """The change by the way. Raises ResimError where nobody moves while it is made."""
    if change.at is not None:
        begins, way = speed.time_at(change.at), change.at
    else:
        assert change.t is not None
        begins, way = change.t, float(speed.states(np.array([change.t]))[0, 0])
    length = change.metres
    if change.seconds is not None:
        if not np.isfinite(begins):
            raise ResimError(f"change.{number}: the object never comes {way:g} m along its route")
        length = float(speed.states(np.array([begins + change.seconds]))[0, 0]) - way
    assert length is not None
    if way < 0.0 or length < 0.1:
        moves = f"the object moves {max(length, 0.0):.2f} m during it"
        raise ResimError(f"change.{number}: {moves}, expected 0.1 m or more")
    lanes = 0 if change.to is None else change.lanes if change.to == "left" else -change.lanes
    return Shift(way, length, lanes, change.offset, number)


def _points(network: RoadNetwork, route: PointRoute) -> Floats:
    if route.points:
        return np.array(route.points, dtype=float)
    return np.array([_place(network, place) for place in route.places])


def _place(network: RoadNetwork, place: PlaceSpec) -> tuple[float, float]:
    road = network.roads.get(place.road)
    if road is None:
        raise ResimError(
            f"route: there is no road {place.road!r}; the map has {', '.join([*network.roads][:20])}"
        )
    if not network.has_lane(place.road, place.lane, place.s):
        raise ResimError(f"route: road {place.road} has no lane {place.lane} at s = {place.s:g} m")
    left = 1.0 if road.along(place.lane, road.section_index(place.s)) else -1.0
    x, y = network.to_xy(place.road, place.lane, place.s, left * place.offset)
    return float(x), float(y)


def wrapped(states: Floats) -> Floats:
    """Give states (6, K) with the heading in (-pi, pi]."""
    return np.concatenate([states[:2], wrap_angle(states[2:3]), states[3:]])
