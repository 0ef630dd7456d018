"""The Intelligent Driver Model in its lane (Treiber, Hennecke, Helbing 2000)."""

from __future__ import annotations

import math

from adfunc.lane_keeping import Lane, in_corridor
from resim.simulation.function.interface import Command, Perceived, Setup


class Idm:
    """Follows the lane and the vehicle ahead in it: a (1 - (v/v0)^4 - (s*/s)²).

    desired_speed v0 [m/s]: if not given, the map's limit, and where it has none the speed at the start.
    time_gap [s], standstill_gap [m], acceleration a and comfortable braking b [m/s²] as in the source.
    """

    def __init__(
        self,
        *,
        desired_speed: float | None = None,
        time_gap: float = 1.2,
        standstill_gap: float = 2.0,
        acceleration: float = 1.4,
        braking: float = 2.0,
    ) -> None:
        self.desired_speed, self.time_gap, self.standstill_gap = desired_speed, time_gap, standstill_gap
        self.acceleration, self.braking = acceleration, braking

    def reset(self, setup: Setup) -> None:
        """Look up the lane."""
        self.lane = Lane(setup.road, setup.start, setup.route)
        self.half_length, self.half_width = 0.5 * setup.length, 0.5 * setup.width
        self.start_speed = max(setup.start.v, 1.0)

    def step(self, perceived: Perceived) -> Command:
        """Keep the lane and the gap."""
        self.lane.place(perceived.ego)
        v = perceived.ego.v
        a = self.acceleration * (1.0 - (v / self._desired()) ** 4)
        others = self.lane.locate(perceived, behind=0.0)
        lead = next((o for o in others if o.s > 0.0 and in_corridor(o.d, o, self.half_width)), None)
        if lead is not None:
            gap = max(lead.s - lead.half_length - self.half_length, 0.1)
            closing = v - lead.v_s
            wanted = v * self.time_gap + v * closing / (2.0 * math.sqrt(self.acceleration * self.braking))
            a -= self.acceleration * ((self.standstill_gap + max(wanted, 0.0)) / gap) ** 2
        return Command(max(a, -9.0), self.lane.steer(v))

    def close(self) -> None:
        """Nothing to end."""

    def _desired(self) -> float:
        if self.desired_speed is not None:
            return self.desired_speed
        limit = self.lane.path.speed_limit_at(self.lane.s)
        return limit if math.isfinite(limit) else self.start_speed
