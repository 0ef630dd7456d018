"""The labels that ship, a file each family; each adds itself to `resim.mining.maneuver.FAMILIES`, in this order."""

from __future__ import annotations

from resim.mining.labels import (  # isort: skip  the order in which they are found
    lane_change,
    cut,
    tailgating,
    speed,
    acceleration,
    turns,
    regions,
    highway,
    passing,
    wrong_way,
    swerving,
    follow_lane,
    others,
    on_foot,
    collision,
    critical,
    starting,
    skidding,
    road_edges,
    right_of_way,
    crashes,
)

__all__ = [
    "acceleration", "collision", "crashes", "critical", "cut", "follow_lane", "highway", "lane_change", "on_foot",
    "others", "passing", "regions", "right_of_way", "road_edges", "skidding", "speed", "starting", "swerving",
    "tailgating", "turns", "wrong_way",
]  # fmt: skip
