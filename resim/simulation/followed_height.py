"""The height of a simulated EGO: that of the road it drives on, followed from where it starts."""

from __future__ import annotations

import math

import numpy as np

from resim.road.opendrive import RoadNetwork

STEP, STEEPEST = 0.5, 0.2
"""By how much [m] the surface may leap from one place to the next, besides what the steepest road rises on the way."""
BEGIN, GAP = 10.0, 20.0
"""Way [m] beside all lanes that it is taken to have come at first, for a height that is off; and after which nobody
knows on which level it comes back."""


class FollowedHeight:
    """Height [m] of the road under the EGO, given its places one after the other; NaN once it is lost.

    Of several roads above each other it is on that whose surface goes on from where it was.
    """

    def __init__(self, network: RoadNetwork, x: float, y: float, z: float) -> None:
        self._network, self.z = network, z
        self._place, self._off = complex(x, y), BEGIN

    def at(self, x: float, y: float) -> float:
        """Give the height at the EGO's next place [m]."""
        if math.isnan(self.z):
            return self.z
        way = abs(complex(x, y) - self._place)
        self._place = complex(x, y)
        self._off += way
        heights = self._network.surfaces(x, y)[1]
        if len(heights):
            off = np.abs(heights - self.z)
            if off.min() <= STEP + STEEPEST * self._off:
                self.z, self._off = float(heights[off.argmin()]), 0.0
                return self.z
        if self._off > GAP:
            self.z = math.nan
        return self.z
