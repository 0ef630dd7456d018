"""The surface that the EGO may be on."""

from __future__ import annotations

from functools import cached_property, lru_cache

import numpy as np
import shapely

from resim.core.geometry import Bools, Floats
from resim.road.opendrive import RoadNetwork
from resim.simulation.guide import Guide

_SEAM = 0.1  # m; closes the seams between lanes
_DRIVEN = 2.0  # m; where something measured drove there is road, whatever the map says


class Surface:
    """The road's surface, and the strips that the recorded objects drove over."""

    def __init__(self, network: RoadNetwork, plan: Guide) -> None:
        self._road, self._plan = _road_surface(network), plan

    @cached_property
    def _driven(self) -> shapely.Geometry:
        lines = [
            np.column_stack([x, y])[np.isfinite(x)] for x, y in zip(self._plan.x, self._plan.y, strict=True)
        ]
        driven = shapely.union_all(
            [shapely.LineString(line).buffer(_DRIVEN) for line in lines if len(line) > 1]
        )
        shapely.prepare(driven)
        return driven

    def holds(self, x: Floats, y: Floats) -> Bools:
        """Say which points (K,) [m] are on it."""
        on = np.asarray(shapely.intersects_xy(self._road, x, y))
        if not on.all():
            on |= shapely.intersects_xy(self._driven, x, y)
        return on


@lru_cache(maxsize=4)
def _road_surface(network: RoadNetwork) -> shapely.Geometry:
    outlines = [
        np.vstack([lane.left, lane.right[::-1]]) for lane in network.lane_shapes() if lane.type != "none"
    ]
    polygons = shapely.make_valid(
        np.array([shapely.Polygon(o) for o in outlines if len(o) >= 4], dtype=object)
    )
    surface = shapely.union_all(shapely.buffer(polygons, _SEAM))
    shapely.prepare(surface)
    return surface
