"""What the shipped functions share: the lane ahead as a path, traffic along it, and steering to it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from resim.core.geometry import Bools, Floats
from resim.road.opendrive import RoadNetwork
from resim.road.path import Path, PathPoint, lane_path
from resim.sim.adfunction import EgoState, Perceived

AHEAD = 600.0  # m of lane to look up at a time
BEHIND = 150.0  # m


@dataclass(frozen=True, slots=True, eq=False)
class Traffic:
    """Perceived objects along the EGO's lane.

    s, d: (N,) m, of the centre along the lane from the EGO's and left of the lane's centre. v_s, v_d: (N,)
    m/s, speed along and to the left of the lane. half_length, half_width: (N,) m.
    """

    s: Floats
    d: Floats
    v_s: Floats
    v_d: Floats
    half_length: Floats
    half_width: Floats


class Lane:
    """The lane that the EGO keeps, looked up on the map and followed as the EGO goes along."""

    def __init__(self, road: RoadNetwork, ego: EgoState) -> None:
        self._road = road
        self.look_up(ego)

    def look_up(self, ego: EgoState, *, ahead: float = 0.0, left: float = 0.0) -> None:
        """Take the lane at a point `ahead` and `left` [m] of the EGO from now on."""
        c, s = math.cos(ego.heading), math.sin(ego.heading)
        x, y = ego.x + c * ahead - s * left, ego.y + s * ahead + c * left
        at = self._road.to_road(np.array([x]), np.array([y]), heading=np.array([ego.heading]))
        road, lane = str(at.road[0]), int(at.lane[0])
        self.path: Path = lane_path(self._road, road, lane, float(at.s[0]), AHEAD, behind=BEHIND)
        self.s, self.d, self.turn = 0.0, 0.0, 0.0
        self.here: PathPoint = self.path.at(0.0)

    def locate(self, perceived: Perceived) -> Traffic:
        """Find the objects along the lane, and the EGO: `s`, `d` [m], `turn` [rad] against it, and the lane `here`."""
        ego = perceived.ego
        x, y = perceived.map_positions()
        s, d = self.path.project(np.append(x, ego.x), np.append(y, ego.y))
        self.s, self.d = float(s[-1]), float(d[-1])
        if self.s > self.path.s[-1] - 250.0 and not self.path.ends:
            self.look_up(ego)
            s, d = self.path.project(np.append(x, ego.x), np.append(y, ego.y))
            self.s, self.d = float(s[-1]), float(d[-1])
        heading = np.interp(s, self.path.s, self.path.heading)
        self.here = self.path.at(self.s)
        self.turn = math.remainder(ego.heading - float(heading[-1]), 2.0 * math.pi)
        turned = perceived.heading_ego + (ego.heading - heading[:-1])
        return Traffic(
            s[:-1] - self.s,
            d[:-1],
            perceived.v * np.cos(turned),
            perceived.v * np.sin(turned),
            0.5 * perceived.length,
            0.5 * perceived.width,
        )

    def steer(self, v: float, offset: float = 0.0, drift: float = 0.0, bend: float = 0.0) -> float:
        """Give the curvature [1/m] that brings the EGO to `offset` [m] left of the lane's centre.

        Critically damped at 0.8 rad/s at any speed. drift [m/s] and bend [m/s²] are the offset's first and
        second derivative, where it is meant to move.
        """
        v = max(v, 3.0)
        omega = 0.8
        off, slant = self.d - offset, v * math.sin(self.turn) - drift
        return self.path.at(self.s + 0.15 * v).curvature + (
            bend - omega * omega * off - 2.0 * omega * slant
        ) / (v * v)


def in_corridor(traffic: Traffic, d: Floats, half_width: float, offset: float = 0.0) -> Bools:
    """Say which objects at lateral positions d (N,) [m] reach into a corridor about `offset` [m]."""
    return np.asarray(np.abs(d - offset) < half_width + traffic.half_width)


def nearest_ahead(traffic: Traffic, mask: Bools) -> int | None:
    """Give the nearest masked object whose centre is ahead, None where there is none."""
    ahead = np.flatnonzero(mask & (traffic.s > 0.0))
    return int(ahead[np.argmin(traffic.s[ahead])]) if len(ahead) else None
