"""The net that is simulated in: SUMO measures the distance to every point of every lane nearby, step by step."""

from __future__ import annotations

import shapely
from lxml import etree

from resim.road.sumo.conversion import net_shapes
from resim.road.sumo.plainxml import shape_text

COARSE = 0.1
"""Distance [m] that a lane's line may lie off that of the exact net; positions are those that SUMO is told, always."""


def coarse(net: bytes) -> bytes:
    """Give the net with the fewest points a lane that stay within COARSE of its line; lengths and ends are kept."""
    root = etree.fromstring(net)
    shapes = net_shapes(net)
    for lane in root.iter("lane"):
        line = shapely.simplify(shapely.linestrings(shapes[lane.get("id", "")]), COARSE)
        lane.set("shape", shape_text(shapely.get_coordinates(line)))
    return etree.tostring(root, xml_declaration=True, encoding="UTF-8")
