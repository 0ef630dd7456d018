"""A highway pilot with a fault, made on purpose: evading, it looks whether the lane on the other side is free.

It ships so that a verification can be seen to find it; nobody may drive with it.
"""

from __future__ import annotations

from adfunc.highway_pilot import HighwayPilot
from resim.road.paths import Along


class MirroredHighwayPilot(HighwayPilot):
    """The highway pilot with the sides of its lane check swapped; parameters as of `HighwayPilot`."""

    def free(self, v: float, others: Along, side: float) -> bool:
        """Say whether nobody is or comes too near in the lane on the wrong side, at -side [m]."""
        return super().free(v, others, -side)
