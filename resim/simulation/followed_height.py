"""The height of a simulated EGO: that of the road it drives on, followed from where it starts."""

from __future__ import annotations

import math

import numpy as np

from resim.road.opendrive import RoadNetwork

EVERY = 5.0
"""Way [m] after which the map is asked again."""
STEP, STEEPEST = 0.5, 0.2
"""By how much [m] the surface may leap from one place to the next, besides what the steepest road rises on the way."""
APART = 1.0
"""Difference of height [m] from which on two roads that the EGO can be on have parted."""
GAP = 10.0
"""Way [m] without a lane that goes on after which nobody knows on which level it comes back."""
COUNTED = 5.0
"""Way [m] that counts for how far the road can have risen; roads above each other are 3 m apart and more."""


class FollowedHeight:
    """Height [m] of the road under the EGO, given its places one after the other; NaN once it is lost.

    Of several roads above each other it is on one whose surface goes on from where it was. Where there is none, or
    several that part, nobody knows on which it is. The map is asked every EVERY m; between, the road rises as it did
    before.
    """

    def __init__(self, network: RoadNetwork, x: float, y: float, z: float) -> None:
        self._network, self._known, self._grade = network, z, 0.0
        self._may = np.array([z])
        self._place, self._way, self._off = complex(x, y), 0.0, 0.0

    def at(self, x: float, y: float) -> float:
        """Give the height at the EGO's next place [m]."""
        if math.isnan(self._known):
            return self._known
        way = abs(complex(x, y) - self._place)
        self._place, self._way, self._off = complex(x, y), self._way + way, self._off + way
        if self._way >= EVERY:
            self._look(x, y)
        return self._known + self._grade * self._way

    def _look(self, x: float, y: float) -> None:
        """Ask the map for the height at a place."""
        heights = self._network.surfaces(x, y)[1]
        off = np.abs(heights[:, None] - self._may).min(axis=1)
        may = heights[off <= STEP + STEEPEST * min(self._off, COUNTED)]
        if self._off > GAP or (len(heights) and (not len(may) or np.ptp(may) > APART)):
            self._known = math.nan
        elif len(may):
            z = float(may.mean())
            self._grade = (z - self._known) / self._way if self._off == self._way else 0.0
            self._known, self._may, self._off = z, may, 0.0
        else:
            self._known += self._grade * self._way
            self._grade = 0.0
        self._way = 0.0
