"""Scenarios with the motion of one traffic object changed: along its lane, and across it.

What is changed is where the object is along the lane that it starts in, and across it, over time; so a faster one
follows the same road, and an earlier lane change goes to the same lane.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from resim.core.clock import regular
from resim.core.errors import ResimError
from resim.core.geometry import Floats
from resim.core.tracks import Tracks
from resim.road.opendrive import RoadNetwork
from resim.road.path import lane_path
from resim.scenario.maneuvers import VARIED_ACROSS, VARIED_BRAKING
from resim.scenario.scenario import Scenario, describe

STEP = 0.04
"""s between the samples that are changed."""
FARTHEST = 5.0
"""Height [m] by which a road may differ from that before; what is farther is another one."""
BEHIND = 200.0
"""Length [m] of the lane before the object's start, and beyond its end, that its place is counted along."""
Changed = tuple[Floats, Floats]
"""Where an object is along and across its lane [m]."""


@dataclass(frozen=True)
class VariationParameter:
    """What can be changed: the unit of its amount, the largest one that is tried either way, and how exactly.

    change: from times, places along and across, and the amount, to new places.
    """

    unit: str
    most: float
    resolution: float
    change: Callable[[Floats, Floats, Floats, float], Changed]
    told: str


def _speed(t: Floats, s: Floats, d: Floats, amount: float) -> Changed:
    return s + amount * (t - t[0]), d


def _gap(t: Floats, s: Floats, d: Floats, amount: float) -> Changed:
    return s + amount, d


def _braking(t: Floats, s: Floats, d: Floats, amount: float) -> Changed:
    v = np.gradient(s, t, edge_order=2)
    a = np.gradient(v, t, edge_order=2)
    hardest = float(-a.min())
    if hardest < VARIED_BRAKING:
        raise ResimError(f"brakes at {max(hardest, 0.0):.2f} m/s² at most, so there is no braking to change")
    a = np.where(a < 0.0, a * max(1.0 + amount / hardest, 0.0), a)
    gained = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(t) * (a[1:] + a[:-1]))])
    v = np.maximum(v[0] + gained, 0.0)
    return s[0] + np.concatenate([[0.0], np.cumsum(0.5 * np.diff(t) * (v[1:] + v[:-1]))]), d


def _lane_change(t: Floats, s: Floats, d: Floats, amount: float) -> Changed:
    if np.ptp(d) < VARIED_ACROSS:
        raise ResimError("keeps its place across the lane, so there is no lane change to move in time")
    return s, np.interp(t - amount, t, d)


PARAMETERS: Mapping[str, VariationParameter] = {
    "speed": VariationParameter("m/s", 6.0, 0.05, _speed, "is faster all the time"),
    "gap": VariationParameter("m", 30.0, 0.25, _gap, "is further ahead all the time"),
    "braking": VariationParameter("m/s²", 4.0, 0.05, _braking, "brakes harder where it brakes"),
    "lane_change": VariationParameter("s", 2.0, 0.02, _lane_change, "moves across the lanes later"),
}
"""By name; what an object does where the amount is above 0."""


def vary(scenario: Scenario, network: RoadNetwork, object_id: str, parameter: str, amount: float) -> Scenario:
    """Give the scenario with a parameter of one object changed by an amount, in the parameter's unit.

    Raises ResimError for an object that the scenario has not, or that has nothing to change.
    """
    if amount == 0.0:
        return scenario
    row = next((k for k, o in enumerate(scenario.objects) if o.id == object_id), None)
    if row is None:
        raise ResimError(f"there is no object {object_id!r} to vary")
    one = scenario.objects[row]
    t = regular(one.spawn_time, float(one.v.x[-1]) - one.spawn_time, STEP)
    if len(t) < 3:
        raise ResimError(f"object {object_id!r} is there for less than {2 * STEP:g} s")
    whole = scenario.tracks(network, t).select([object_id])
    length = float(np.hypot(np.diff(whole.x[0]), np.diff(whole.y[0])).sum())
    path = lane_path(
        network, one.start.road, one.start.lane, one.start.s, length + 2.0 * BEHIND, behind=BEHIND
    )
    try:
        s, d = PARAMETERS[parameter].change(t, *path.project(whole.x[0], whole.y[0]), amount)
    except ResimError as e:
        raise ResimError(f"object {object_id!r} {e}") from e
    x, y = path.xy(s, d)
    moved = moved_tracks(whole, t, x, y)
    if whole.z is not None:
        moved = replace(moved, z=moved_heights(network, whole, moved))
    made = describe(moved, network, ego=object_id, map_name=scenario.map).ego
    made = replace(made, color=one.color, description=one.description)
    return replace(scenario, objects=(*scenario.objects[:row], made, *scenario.objects[row + 1 :]))


def moved_heights(network: RoadNetwork, was: Tracks, moved: Tracks) -> Floats:
    """Give heights (1, T) [m] of the road where an object is now: of the lane nearest to its height before."""
    assert was.z is not None
    x, y, heading, z = moved.x[0], moved.y[0], moved.heading[0], was.z[0]
    at = network.to_road(x, y, heading=heading, z=z)
    out = np.full(len(x), np.nan)
    on = at.on_road & np.isfinite(z)
    out[on] = network.z(at.road[on], at.s[on], at.t[on], lane=at.lane[on])
    return np.where(np.abs(out - z) <= FARTHEST, out, np.nan)[None]


def moved_tracks(tracks: Tracks, t: Floats, x: Floats, y: Floats) -> Tracks:
    """Give tracks of one object that is at x, y (T,) [m] at times t [s] instead; standing, it looks as it did."""
    vx, vy = np.gradient(x, t, edge_order=2), np.gradient(y, t, edge_order=2)
    v = np.hypot(vx, vy)
    heading = np.where(v > 0.1, np.arctan2(vy, vx), tracks.heading[0])
    return replace(
        tracks, x=x[None], y=y[None], v=v[None], heading=heading[None], valid=np.isfinite(x)[None], a=None,
        yaw_rate=None,
    )  # fmt: skip
