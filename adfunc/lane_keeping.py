"""What the shipped functions share: the lane ahead as a path, traffic along it, and steering to it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from operator import itemgetter
from typing import Any, NamedTuple

import numpy as np

from resim.road.driven_route import Route, only_roads
from resim.road.opendrive import RoadNetwork
from resim.road.path import Path, PathPoint, lane_path
from resim.simulation.function.interface import EgoState, Perceived

AHEAD, BEHIND = 800.0, 350.0
"""How much of a lane to look up at a time [m]."""

ANCHOR = 200.0
"""Lanes are looked up from multiples of this [m] on, so that runs on one map share them."""

NEAR = 200.0
"""Objects farther than this [m] from the EGO, ahead or to a side, are not looked at."""


LEVEL, RISE = 2.0, 0.15
"""Objects are on another level that are higher or lower than this [m], and than roads rise on the way [m per m]."""


class Neighbour(NamedTuple):
    """A perceived object along the EGO's lane.

    s, d: m, of its centre along the lane from the EGO's and left of the lane's centre. v_s, v_d: m/s, speed
    along and to the left of the lane. half_length, half_width: m.
    """

    id: str
    s: float
    d: float
    v_s: float
    v_d: float
    half_length: float
    half_width: float


SMOOTH = 12.0
"""The lane's bend is taken over this length [m]: digitised maps have kinks that nobody steers along."""


@lru_cache(maxsize=256)
def _anchored_path(road: RoadNetwork, road_id: str, lane: int, s: float, route: Route) -> Path:
    path = lane_path(road, road_id, lane, s, AHEAD, behind=BEHIND, route=route)
    ends = (np.interp(path.s + side * 0.5 * SMOOTH, path.s, path.heading) for side in (-1.0, 1.0))
    return replace(path, curvature=-np.subtract(*ends) / SMOOTH)


@lru_cache(maxsize=256)
def _lane_at(road: RoadNetwork, route: Route, x: float, y: float, heading: float) -> tuple[str, int, float]:
    place, towards = (np.array([x]), np.array([y])), np.array([heading])
    at = only_roads(road, route.roads).to_road(*place, heading=towards) if route.roads else None
    if at is None or not at.on_road[0]:
        at = road.to_road(*place, heading=towards)
    return str(at.road[0]), int(at.lane[0]), float(at.s[0])


class Lane:
    """The lane that the EGO keeps, looked up on the map and followed as the EGO goes along, where it can on its route.

    s, d: m, where the EGO is along it. turn: rad, its heading against the lane.
    """

    def __init__(self, road: RoadNetwork, ego: EgoState, route: Route) -> None:
        self._road, self._route = road, route
        self.look_up(ego)

    def look_up(self, ego: EgoState) -> None:
        """Take the lane that the EGO is on from now on."""
        road, lane, s = _lane_at(self._road, self._route, ego.x, ego.y, ego.heading)
        anchor = min(max(ANCHOR * round(s / ANCHOR), 0.0), self._road.roads[road].length)
        if not self._road.has_lane(road, lane, anchor):
            anchor = s
        self.path = _anchored_path(self._road, road, lane, anchor, self._route)
        self._segments: dict[str, int] = {}
        self._segment = -1
        self.s, self.d, heading, self._segment = self.path.track(ego.x, ego.y)
        self.turn = math.remainder(ego.heading - heading, 2.0 * math.pi)

    def place(self, ego: EgoState) -> None:
        """Find the EGO along the lane."""
        self.s, self.d, heading, self._segment = self.path.track(ego.x, ego.y, self._segment)
        self.turn = math.remainder(ego.heading - heading, 2.0 * math.pi)
        if self.s > self.path.s[-1] - 250.0 and not self.path.ends:
            self.look_up(ego)

    @property
    def here(self) -> PathPoint:
        """The lane at the EGO."""
        return self.path.at(self.s)

    def locate(self, perceived: Perceived, *, behind: float = NEAR) -> Iterator[Neighbour]:
        """Find the objects up to NEAR ahead and `behind` [m] of the EGO, rearmost first, each when it is asked for.

        Who is on another level, such as on a bridge, is left out.
        """
        ego, seen = perceived.ego, perceived
        columns: tuple[Any, ...] = (
            seen.x_ego,
            seen.y_ego,
            seen.heading_ego,
            seen.v,
            seen.length,
            seen.width,
            seen.ids,
        )
        if not np.isnan(seen.z_ego).all():
            here = ~(np.abs(seen.z_ego) > LEVEL + RISE * np.hypot(seen.x_ego, seen.y_ego))
            columns = tuple(column[here] for column in columns)
        rows = sorted(zip(*[column.tolist() for column in columns], strict=True), key=itemgetter(0))
        c, s = math.cos(ego.heading), math.sin(ego.heading)
        track, segments = self.path.track, self._segments
        for far, aside, turned, v, length, width, name in rows:
            if far < -behind or far > NEAR or abs(aside) > NEAR:
                continue
            x, y = ego.x + c * far - s * aside, ego.y + s * far + c * aside
            along, d, heading, segments[name] = track(x, y, segments.get(name, -1))
            course = turned + ego.heading - heading
            v_s, v_d = v * math.cos(course), v * math.sin(course)
            yield Neighbour(name, along - self.s, d, v_s, v_d, 0.5 * length, 0.5 * width)

    def steer(self, v: float, offset: float = 0.0, drift: float = 0.0, bend: float = 0.0) -> float:
        """Give the curvature [1/m] that brings the EGO to `offset` [m] left of the lane's centre.

        Critically damped at 0.8 rad/s at any speed. drift [m/s] and bend [m/s²] are the offset's first and
        second derivative, where it is meant to move.
        """
        v = max(v, 3.0)
        omega = 0.8
        off, slant = self.d - offset, v * math.sin(self.turn) - drift
        return self.path.curvature_at(self.s + 0.15 * v) + (
            bend - omega * omega * off - 2.0 * omega * slant
        ) / (v * v)


def in_corridor(d: float, other: Neighbour, half_width: float, offset: float = 0.0) -> bool:
    """Say whether an object at d [m] reaches into a corridor of this half width about `offset` [m]."""
    return abs(d - offset) < half_width + other.half_width
