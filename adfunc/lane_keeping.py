"""What the shipped functions share: the lane ahead as a path, traffic along it, and steering to it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from resim.core.geometry import Bools, Floats
from resim.driving import kernel
from resim.road.driven_route import Route, only_roads
from resim.road.opendrive import RoadNetwork
from resim.road.path import Path, PathPoint, lane_path
from resim.road.paths import Along, Paths
from resim.simulation.function.batch import BatchFunction, Keys, PerceivedBatch, batch_of_one
from resim.simulation.function.interface import Command, EgoState, Perceived, Setup

Integers = NDArray[np.intp]

AHEAD, BEHIND = 800.0, 350.0
"""How much of a lane to look up at a time [m]."""

ANCHOR = 200.0
"""Lanes are looked up from multiples of this [m] on, so that runs on one map share them."""

NEAR = 200.0
"""Objects farther than this [m] from the EGO, ahead or to a side, are not looked at."""


LEVEL, RISE = 2.0, 0.15
"""Objects are on another level that are higher or lower than this [m], and than roads rise on the way [m per m]."""


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


class Lanes:
    """The lanes that the EGOs of B runs keep, looked up on the map and followed as they go, where they can on their
    route.

    s, d: (B,) m, where the EGOs are along them. turn: (B,) rad, their headings against the lanes.
    """

    def __init__(self, setups: Sequence[Setup]) -> None:
        self._setups = setups
        self.paths = Paths([self._path(b, setup.start) for b, setup in enumerate(setups)])
        self._find(np.array([setup.start for setup in setups]))

    def _path(self, b: int, ego: EgoState) -> Path:
        """The lane that the EGO is on."""
        setup = self._setups[b]
        road, lane, s = _lane_at(setup.road, setup.route, ego.x, ego.y, ego.heading)
        anchor = min(max(ANCHOR * round(s / ANCHOR), 0.0), setup.road.roads[road].length)
        if not setup.road.has_lane(road, lane, anchor):
            anchor = s
        return _anchored_path(setup.road, road, lane, anchor, setup.route)

    def look_up(self, runs: Sequence[int], ego: Floats) -> None:
        """Take the lanes that the EGOs (B, 6) of these runs are on from now on."""
        for b in runs:
            self.paths.change(b, self._path(b, EgoState(*ego[b].tolist())))
        if runs:
            self._find(ego)

    def place(self, ego: Floats) -> None:
        """Find the EGOs (B, 6) along the lanes."""
        self._find(ego)
        paths = zip(self.s.tolist(), self.paths.paths, strict=True)
        late = [b for b, (s, path) in enumerate(paths) if s > path.s[-1] - 250.0 and not path.ends]
        if late:
            self.look_up(late, ego)

    def _find(self, ego: Floats) -> None:
        self.s, self.d, heading = self.paths.place(ego)
        turns = (ego[:, 2] - heading).tolist()
        self.turn = np.array([math.remainder(turn, 2.0 * math.pi) for turn in turns])

    def here(self, b: int) -> PathPoint:
        """The lane of a run at the EGO."""
        return self.paths.paths[b].at(float(self.s[b]))

    def locate(self, seen: PerceivedBatch, *, behind: float = NEAR) -> Along:
        """Find the objects up to NEAR ahead and `behind` [m] of the EGOs.

        Who is on another level, such as on a bridge, is left out.
        """
        lists = (seen.x_ego, seen.y_ego, seen.heading_ego, seen.v, seen.length, seen.width, seen.z_ego)
        return self.paths.along(
            seen.ego, seen.count, seen.key, lists, levels=(LEVEL, RISE), behind=behind, near=NEAR
        )

    def steer(self, v: Floats, aim: Floats | None = None) -> Floats:
        """Give the curvatures (B,) [1/m] that keep the EGOs on the lanes' centres, at speeds v (B,) [m/s].

        aim (3, B): where to be left of them [m] instead, and its first and second derivative, where it is meant to
        move.
        """
        out, bend = np.empty(len(v)), self.paths.curvature_at(self.s + 0.15 * np.maximum(v, 3.0))
        kernel.steer(v, self.d, self.turn, bend, np.zeros((3, len(v))) if aim is None else aim, out)
        return out

    def limited(self, desired: float | None, else_: Floats) -> Floats:
        """Give the speeds (B,) [m/s] to drive at: `desired`; without it the limit, and where none is `else_`."""
        if desired is not None:
            return np.full(len(self.s), desired)
        limit = self.paths.speed_limit_at(self.s)
        return np.where(np.isfinite(limit), limit, else_)


def in_corridor(d: Floats, other: Along, half_width: float, offset: Floats | float = 0.0) -> Bools:
    """Say which objects, if at d (B, M) [m], reach into corridors of this half width [m] about `offset` [m], a number
    or (B, 1).
    """
    return np.asarray(np.abs(d - offset) < half_width + other.half_width)


def alone(function: BatchFunction, perceived: Perceived, keys: Keys) -> Command:
    """Give what a function answers in a single run; keys: that the run's ids have had so far."""
    answer = function.step_batch(batch_of_one(perceived, keys.of_list(0, perceived.ids)))
    plan = None if answer.plan is None else answer.plan[0]
    return Command(float(answer.acceleration[0]), float(answer.curvature[0]), plan)
