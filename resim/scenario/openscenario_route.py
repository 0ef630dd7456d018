"""An object's drive as a route and a speed over time, for players that steer by themselves.

Source: ASAM OpenSCENARIO XML 1.3, "AssignRouteAction", "SpeedProfileAction".
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from resim.core.geometry import Floats
from resim.road.opendrive import RoadNetwork
from resim.scenario.scenario import RoadPosition

SLACK = 0.02
"""m/s by which the speed between two entries may be off their straight line."""
SHORTEST = 5.0
"""m that somebody drives on a lane at least that is worth a waypoint."""
_STANDS = 0.5
"""m; who moves less has no route."""


class TimedAction(NamedTuple):
    """An action, and from when on [s] it holds."""

    t: float
    name: str
    action: Any


def route_actions(xosc: Any, network: RoadNetwork, own: str, t: Floats, states: Floats) -> list[TimedAction]:
    """Give what makes a player drive an object's way: its route, and its speed over time.

    Args:
        xosc: scenariogeneration's module, its version set.
        network: The map.
        own: Name of the entity.
        t: (T,) s.
        states: (4, T) x, y [m], heading [rad] and v [m/s] of its reference point.
    """
    found = []
    waypoints = _waypoints(network, states)
    if len(waypoints) > 1:
        route = xosc.Route(f"route {own}")
        for one in waypoints:
            if isinstance(one, RoadPosition):
                place = xosc.LanePosition(one.s, one.t, one.lane, one.road)
            else:
                place = xosc.WorldPosition(*one)
            route.add_waypoint(place, xosc.RouteStrategy.shortest)
        found.append(TimedAction(float(t[0]), f"{own} is routed", xosc.AssignRouteAction(route)))
    return found + _speeds(xosc, own, t, np.maximum(states[3], 0.0))


def _speeds(xosc: Any, own: str, t: Floats, v: Floats) -> list[TimedAction]:
    """The speed, straight between corners: a profile, or before 1.2 a chain of linear changes."""
    rows = _corners(t, v)
    lasts, speeds = np.diff(t[rows]).tolist(), v[rows].tolist()
    if xosc.VersionBase().isVersionEqLarger(minor=2):
        profile = xosc.SpeedProfileAction(speeds, xosc.FollowingMode.position, [0.0, *lasts])
        return [TimedAction(float(t[0]), f"{own} speeds", profile)]
    found = []
    if t[0] > 0.0:  # whoever is there from the start has its first speed from Init
        how = xosc.TransitionDynamics(xosc.DynamicsShapes.step, xosc.DynamicsDimension.time, 0.0)
        first = xosc.AbsoluteSpeedAction(speeds[0], how)
        found.append(TimedAction(float(t[0]), f"{own} has a speed", first))
    for begin, length, target in zip(t[rows[:-1]].tolist(), lasts, speeds[1:], strict=True):
        how = xosc.TransitionDynamics(xosc.DynamicsShapes.linear, xosc.DynamicsDimension.time, length)
        found.append(
            TimedAction(begin, f"{own} speeds from {begin:.3f} s", xosc.AbsoluteSpeedAction(target, how))
        )
    return found


def _corners(t: Floats, v: Floats) -> list[int]:
    """Rows of the fewest corners found between which v (T,) is within SLACK of straight lines (Douglas and Peucker)."""
    kept, todo = {0, len(t) - 1}, [(0, len(t) - 1)]
    while todo:
        a, b = todo.pop()
        line = np.interp(t[a : b + 1], t[[a, b]], v[[a, b]])
        off = np.abs(v[a : b + 1] - line)
        if off.max() > SLACK:
            middle = a + int(np.argmax(off))
            kept.add(middle)
            todo += [(a, middle), (middle, b)]
    return sorted(kept)


def _waypoints(network: RoadNetwork, states: Floats) -> list[RoadPosition | tuple[float, float]]:
    """Where it begins, where it is in the middle of each lane's stretch, and where it ends."""
    x, y, heading = states[:3]
    way = np.r_[0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y)))]
    if way[-1] < _STANDS:
        return []
    found = network.to_road(x, y, heading=heading)
    key = [*zip(found.road.tolist(), found.lane.tolist(), found.on_road.tolist(), strict=True)]
    borders = [0, *(k for k in range(1, len(key)) if key[k] != key[k - 1]), len(key)]
    rows = [0]
    for a, b in pairwise(borders[1:]):
        if way[b - 1] - way[a] >= SHORTEST and b < len(key):
            rows.append(int(np.searchsorted(way, 0.5 * (way[a] + way[b - 1]))))
    rows = sorted({*rows, len(key) - 1})
    return [
        RoadPosition(key[k][0], key[k][1], float(found.s[k]), float(found.t[k]))
        if key[k][2] else (float(x[k]), float(y[k]))
        for k in rows
    ]  # fmt: skip
