"""An object's motion along and across its lane: what kernels are trained on and what is varied.

A kernel that was trained along straight roads would bend what is varied on a curve; so both take places along the lane
that the object begins in and goes on into, and across it, in place of x and y (Wagner 2021, 6.1.2.1 turns traces to
the x axis, which is the same on a straight).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resim.core.clock import regular
from resim.core.geometry import Floats
from resim.road.driven_route import NO_ROUTE, driven_route
from resim.road.opendrive import RoadNetwork
from resim.road.path import Path, lane_path
from resim.scenario.trace import Trace

STEP = 0.04
"""s between the samples of a motion."""
AROUND = 200.0
"""m of the lane before the motion, and beyond its end, that its places are counted along."""
GRID = 20.0
"""m: lanes are followed from whole multiples of it, so that motions on one lane share its path."""


@dataclass(frozen=True, eq=False)
class LaneMotion:
    """Where an object is, K times.

    Attributes:
        path: The lane, with what it goes on into.
        t: (K,) s, its first and its last one that of the object.
        s: (K,) m along the lane.
        d: (K,) m to the left of the lane's centre.
    """

    path: Path
    t: Floats
    s: Floats
    d: Floats


def motion_of(trace: Trace, network: RoadNetwork, z: Floats | None = None, step: float = STEP) -> LaneMotion:
    """Give a trace in coordinates of its lane, all along. z: (1,) height [m] at its start, where it is known.

    Raises InputError where the lane cannot be followed.
    """
    t = times(trace.start, trace.end, step)
    states = trace.states(t)
    path = followed_lane(network, states.x, states.y, states.heading, z)
    s, d = path.project(states.x, states.y)
    return LaneMotion(path, t, s, d)


def times(start: float, end: float, step: float) -> Floats:
    """Give times (K,) [s] from start on, `step` apart, and the end."""
    grid = regular(start, end - start, step)
    return grid if end - grid[-1] < 1e-6 else np.append(grid, end)


def followed_lane(
    network: RoadNetwork, x: Floats, y: Floats, heading: Floats, z: Floats | None = None
) -> Path:
    """Give the lane that positions x, y (K,) [m] with headings [rad] begin in, along the roads that they take."""
    at = network.to_road(x[:1], y[:1], heading=heading[:1], z=z)
    road, lane, s = str(at.road[0]), int(at.lane[0]), float(at.s[0])
    section = network.roads[road].sections[network.roads[road].section_index(s)]
    begin = min(max(GRID * np.floor(s / GRID), section.start), section.end)
    length = float(np.hypot(np.diff(x), np.diff(y)).sum())
    length = 100.0 * np.ceil((length + GRID) / 100.0) + AROUND
    route = driven_route(network, x, y, heading) if network.junctions else NO_ROUTE
    return lane_path(network, road, lane, float(begin), float(length), behind=AROUND, route=route)
