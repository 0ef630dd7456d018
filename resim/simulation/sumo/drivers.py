"""SUMO's own models as drivers of traffic that reacts: car following by its IDM, lane changes by its LC2013.

A vehicle in SUMO is where resim says at every step; what it does next SUMO's models decide, with the parameters of its
driver. SUMO changes lanes at once; the motion of it is resim's (`resim.simulation.reactive.lane_changes`).
"""

from __future__ import annotations

import math

import numpy as np

from resim.core.geometry import Floats
from resim.road.links import LaneKey
from resim.road.opendrive import RoadNetwork
from resim.road.sumo import sumo_net
from resim.simulation.guide import Guide
from resim.simulation.reactive.drivers import TrafficDriver, wanted
from resim.simulation.reactive.lanes import Side
from resim.simulation.sumo.session import DriverParameters, Session
from resim.simulation.traffic import Stage

_FREE = 1e6
"""m of gap behind nobody."""
_DIRECTIONS: tuple[tuple[Side, int], ...] = (("left", 1), ("right", -1))
_ROUTE_STEP = 0.5
"""s between the places of a measured way that tell which edges it takes."""


class SumoDrivers:
    """Drivers in the SUMO of one run (`resim.simulation.reactive.traffic.Deciders`); vehicles have a stage's rows."""

    def __init__(self, stage: Stage, network: RoadNetwork, session: Session) -> None:
        self._stage, self._network, self._session = stage, network, session
        self._step = session.step_length
        self._drivers = dict[int, tuple[TrafficDriver, DriverParameters]]()
        self._edges = dict[int, list[str]]()
        self._routed = set[int]()

    def take(self, row: int, driver: TrafficDriver) -> None:
        """Let SUMO's models decide for an object from now on, with its driver's parameters."""
        parameters = DriverParameters(
            driver.acceleration, driver.deceleration, driver.time_gap, driver.standstill, driver.desired
        )
        member = self._stage.members[row]
        self._session.let_decide(f"{row}", member.length, member.width, parameters)
        self._drivers[row] = driver, parameters

    def give_back(self, row: int) -> None:
        """Let nobody decide for an object any longer."""
        self._session.decide_no_longer(f"{row}")
        del self._drivers[row]
        self._routed.discard(row)

    def acceleration(self, row: int, v: float, gap: float, lead_v: float) -> float:
        """Give what SUMO's car-following model does [m/s²] at v [m/s], `gap` [m] behind who drives lead_v [m/s].

        SUMO asks it for vehicles on its lanes only, and breaks down for others: there resim's gives the same.
        """
        driver, parameters = self._drivers[row]
        if not self._session.lane(f"{row}"):
            return float(wanted(driver, v, np.array([gap]), np.array([lead_v]))[0])
        if not math.isfinite(gap):
            gap, lead_v = _FREE, parameters.max_speed
        return (self._session.followed(f"{row}", v, gap, lead_v, parameters) - v) / self._step

    def sides(self, row: int) -> tuple[Side, ...]:
        """Give the sides to which SUMO's lane-change model wants to change, and could; none where it knows no way.

        SUMO said so in the step that it took last.
        """
        if not self._session.lane(f"{row}") or (row not in self._routed and not self._route(row)):
            return ()
        return tuple(side for side, direction in _DIRECTIONS if self._session.changes(f"{row}", direction))

    def _route(self, row: int) -> bool:
        """Tell SUMO the edges of an object's measured way, from the one on which it is; say whether it knows them."""
        if row not in self._edges:
            self._edges[row] = _edges(self._stage.plan, row, self._network)
        edges, now = self._edges[row], self._session.lane(f"{row}").rsplit("_", 1)[0]
        if now in edges and self._session.set_route(f"{row}", edges[edges.index(now) :]):
            self._routed.add(row)
            return True
        return False


def _edges(plan: Guide, row: int, network: RoadNetwork) -> list[str]:
    """The edges of SUMO's net that an object's measured way takes, in order, each once."""
    every = max(round(_ROUTE_STEP / float(plan.t[1] - plan.t[0])), 1)
    there = plan.present[row]
    columns: list[Floats] = [column[row, there][::every] for column in (plan.x, plan.y, plan.heading)]
    x, y, heading = columns
    z = None if plan.z is None else plan.z[row, there][::every]
    at = network.to_road(x, y, heading=heading, z=z)
    lanes, out = sumo_net(network).lanes, dict[str, None]()
    for on, road, lane, s in zip(at.on_road, at.road, at.lane, at.s, strict=True):
        if on:
            key = LaneKey(str(road), network.roads[str(road)].section_index(float(s)), int(lane))
            out |= dict.fromkeys(
                name.rsplit("_", 1)[0] for name in lanes.get(key, ()) if not name.startswith(":")
            )
    return list(out)
