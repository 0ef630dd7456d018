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
    collision,
    critical,
)

__all__ = [
    "acceleration", "collision", "critical", "cut", "follow_lane", "highway", "lane_change", "others", "passing",
    "regions", "speed", "swerving", "tailgating", "turns", "wrong_way",
]  # fmt: skip
