"""The surface that the EGO may be on."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import shapely

from resim.core.geometry import Floats
from resim.road.opendrive import RoadNetwork

_SEAM = 0.1  # m; closes the seams between lanes
_DRIVEN = 2.0  # m; where something measured drove there is road, whatever the map says


class Surface:
    """The road's surface, and the strips that the recorded objects drove over."""

    def __init__(self, network: RoadNetwork, x: Floats, y: Floats) -> None:
        """Take recorded positions x, y (N, T) [m], NaN where there is none."""
        self._road = _road_surface(network)
        lines = [np.column_stack([px, py])[np.isfinite(px)] for px, py in zip(x, y, strict=True)]
        strips = [shapely.LineString(line[::5]).buffer(_DRIVEN) for line in lines if len(line) > 5]
        self._driven = shapely.union_all(strips)
        shapely.prepare(self._driven)

    def holds(self, x: float, y: float) -> bool:
        """Say whether the point [m] is on it."""
        return bool(shapely.intersects_xy(self._road, x, y) or shapely.intersects_xy(self._driven, x, y))


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
