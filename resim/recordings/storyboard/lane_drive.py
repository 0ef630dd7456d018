"""The way along a lane from a place on it: of who does nothing but keep its lane."""

from __future__ import annotations

import numpy as np

from resim.core.geometry import Floats, wrap_angle
from resim.recordings.storyboard.document import ScenarioElement
from resim.recordings.storyboard.places import ScenarioPlace, ScenarioPlaces
from resim.road.lane_following import RouteStretch, follow
from resim.road.links import Graph, LaneKey

_STEP = 0.25
"""m between points on whose chords ways are measured: 1e-5 m of 300 m on a radius of 250 m."""
_FARTHEST = 1e5
"""m that somebody drives along lanes."""
_ASKEW = 0.2
"""rad by which one who keeps its lane may head off it."""
_TRAJECTORY = "Give its trajectory instead (FollowTrajectoryAction)."


class LaneDrive:
    """The way along a lane, at the distance from its centre that the place has.

    Attributes:
        length: m that there are, up to those asked for.
    """

    def __init__(
        self, places: ScenarioPlaces, place: ScenarioPlace, way: float, element: ScenarioElement
    ) -> None:
        """Follow the lane for so many metres of way.

        Raises:
            InputError: The place is on no lane, heads off it, or the lane goes on into several.
        """
        net = places.network
        if way > _FARTHEST:
            raise element.refused(f"is left to drive {way:g} m along its lane, expected up to {_FARTHEST:g}")
        heading = None if place.heading is None and place.spot is None else place.faced
        found = net.to_road(place.x, place.y, heading=heading)
        road, lane, s = str(found.road[0]), int(found.lane[0]), float(found.s[0])
        if not found.on_road[0]:
            raise element.refused(
                "is on no lane that vehicles drive on, and has a speed: where it drives, the player decides",
                _TRAJECTORY,
            )
        along = float(net.lane_heading(road, lane, s))
        if heading is not None and abs(float(wrap_angle(heading - along))) > _ASKEW:
            problem = f"heads {abs(float(wrap_angle(heading - along))):.2f} rad off its lane, and has a speed"
            raise element.refused(f"{problem}: where it drives, the player decides", _TRAJECTORY)
        self._net, self._t, self._element = net, float(found.t[0]), element
        self._points(places.lanes, LaneKey(road, net.roads[road].section_index(s), lane), s, way)

    def _points(self, graph: Graph, start: LaneKey, s: float, way: float) -> None:
        before: LaneKey | None = None
        at, numbers, reached = [np.array([0.0])], [np.array([0])], 0.0
        self._stretches: list[RouteStretch] = []
        places = [np.array([s])]
        for stretch in follow(self._net, start.road, start.lane, s, ahead=True):
            key = LaneKey(stretch.road, stretch.section, stretch.lane)
            if before is not None and len(graph.get(before, ())) > 1:
                raise self._element.refused(
                    f"comes to the end of {before} after {reached:.1f} m, which goes on into several lanes: the player "
                    "decides", _TRAJECTORY,
                )  # fmt: skip
            before = key
            nodes = np.linspace(stretch.s_from, stretch.s_to, max(int(stretch.length / _STEP), 1) + 1)
            x, y = self._net.to_xy(stretch.road, stretch.lane, nodes, self._t)
            at.append(reached + np.r_[0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
            numbers.append(np.full(len(nodes), len(self._stretches)))
            places.append(nodes)
            self._stretches.append(stretch)
            reached = float(at[-1][-1])
            if reached >= way:
                break
        self.length = min(reached, way)
        self._way, self._s, self._number = (np.concatenate(one[1:] or one) for one in (at, places, numbers))

    def at(self, way: Floats) -> Floats:
        """Give x, y [m] and heading [rad] (3, T) after ways (T,) [m]."""
        way = np.clip(way, 0.0, self._way[-1])
        k = np.clip(np.searchsorted(self._way, way, side="right") - 1, 0, max(len(self._way) - 2, 0))
        number = self._number[k]
        out = np.empty((3, len(way)))
        for n in np.unique(number).tolist():
            rows, stretch = np.flatnonzero(number == n), self._stretches[n]
            own = self._number == n
            s = np.interp(way[rows], self._way[own], self._s[own])
            out[:2, rows] = self._net.to_xy(stretch.road, stretch.lane, s, self._t)
            out[2, rows] = self._net.lane_heading(stretch.road, stretch.lane, s)
        return out
