"""A highway pilot: car following, emergency braking, and a lane change where that is the safer way out.

Its decision threshold is that of Section 5.2 of Wagner 2021: "if the threat is too high, emergency braking
provides remedy at the cost of passenger comfort. This can be avoided if there is still enough space and time
left to overtake the traffic object safely".
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from adfunc.lane_keeping import Lane, Neighbour, in_corridor
from resim.core.geometry import Floats
from resim.simulation.function.interface import Command, EgoState, Perceived, Setup

Mode = Literal["follow", "brake", "change"]

PLANNED = np.arange(0.0, 3.01, 0.25)
"""Times [s] ahead of the states of a plan."""
_RETURN = np.exp(-PLANNED)
"""What is left by then of a distance from the lane's centre."""


@dataclass(frozen=True, slots=True)
class _Lead:
    """The vehicle to mind: gap [m] between the boxes, its speed [m/s] along the lane, its acceleration [m/s²]."""

    gap: float
    v: float
    a: float


class HighwayPilot:
    """Drives on highways.

    desired_speed [m/s]: if not given, the map's limit or the start speed, whichever is lower. time_gap [s]
    and standstill_gap [m]: what following keeps. cut_in_horizon [s]: an object that its present drift takes
    into the lane by then counts as ahead. A threat is a collision at present speeds and accelerations sooner
    than threat_time [s], towards which the closing speed will be over threat_closing [m/s] in half a second.
    swerve_time [s]: what leaving the lane takes; swerve_gap [m]: what must be left of the gap by then, else
    braking is the answer. comfort_braking, max_braking [m/s²]. change_time [s]: length of a lane change.
    """

    def __init__(
        self,
        *,
        desired_speed: float | None = None,
        time_gap: float = 1.0,
        standstill_gap: float = 3.0,
        cut_in_horizon: float = 1.0,
        threat_time: float = 4.0,
        threat_closing: float = 5.0,
        swerve_time: float = 1.6,
        swerve_gap: float = 15.2,
        comfort_braking: float = 2.5,
        max_braking: float = 8.0,
        change_time: float = 3.5,
    ) -> None:
        self.desired_speed, self.time_gap, self.standstill_gap = desired_speed, time_gap, standstill_gap
        self.cut_in_horizon, self.threat_time, self.threat_closing = (
            cut_in_horizon,
            threat_time,
            threat_closing,
        )
        self.swerve_time, self.swerve_gap = swerve_time, swerve_gap
        self.comfort_braking, self.max_braking, self.change_time = comfort_braking, max_braking, change_time

    def reset(self, setup: Setup) -> None:
        """Look up the lane."""
        self.lane = Lane(setup.road, setup.start, setup.route)
        self.half_length, self.half_width = 0.5 * setup.length, 0.5 * setup.width
        self.start_speed, self.cycle = max(setup.start.v, 1.0), setup.cycle
        self.smoothing = 1.0 - math.exp(-setup.cycle / 0.3)
        self.mode: Mode = "follow"
        self.change_begin, self.change_from, self.change_to = 0.0, 0.0, 0.0
        self.speeds: dict[str, tuple[float, float, float]] = {}  # id: t, v, a

    def step(self, perceived: Perceived) -> Command:
        """Decide, then accelerate and steer accordingly."""
        self.lane.place(perceived.ego)
        others = list(self.lane.locate(perceived))
        ego = perceived.ego
        lead = self.mind(perceived, others)
        self.decide(perceived.t, ego, others, lead)
        a = self.accelerate(ego.v, lead)
        offset, drift, bend = self.lateral(perceived.t, ego)
        curvature = self.lane.steer(ego.v, offset, drift, bend)
        return Command(a, curvature, self.plan(perceived.t, ego, a))

    def close(self) -> None:
        """Nothing to end."""

    def mind(self, perceived: Perceived, others: list[Neighbour]) -> _Lead | None:
        """Find the nearest vehicle that is in the way, or will be by its drift."""
        self.remember(perceived.t, others)
        offset = self.lane.d if self.mode == "change" else 0.0
        width, horizon = self.half_width + 0.1, self.cut_in_horizon
        row: Neighbour | None = None
        for o in others:
            if o.s <= 0.0 or (row is not None and o.s >= row.s):
                continue
            if in_corridor(o.d, o, width, offset) or in_corridor(o.d + horizon * o.v_d, o, width, offset):
                row = o
        if row is None:
            return None
        gap = row.s - row.half_length - self.half_length
        return _Lead(max(gap, 0.1), row.v_s, self.speeds[row.id][2])

    def remember(self, t: float, others: list[Neighbour]) -> None:
        """Estimate accelerations from the speeds seen, smoothed over 0.3 s."""
        known, speeds = self.speeds, {}
        for o in others:
            t0, v0, a0 = known.get(o.id, (t - self.cycle, o.v_s, 0.0))
            a = a0 + self.smoothing * ((o.v_s - v0) / max(t - t0, 1e-3) - a0)
            speeds[o.id] = (t, o.v_s, a)
        self.speeds = speeds

    def decide(self, t: float, ego: EgoState, others: list[Neighbour], lead: _Lead | None) -> None:
        """Change the mode where the situation asks for it."""
        if self.mode == "change":
            if t > self.change_begin + self.change_time:
                self.lane.look_up(ego)
                self.mode = "follow"
            return
        if lead is None or (self.mode == "brake" and ego.v < lead.v - 0.5):
            self.mode = "follow"
            return
        if self.mode == "follow" and self.threatened(ego, lead):
            side = self.way_out(ego, others, lead)
            if side == 0.0:
                self.mode = "brake"
            else:
                self.mode, self.change_begin = "change", t
                self.change_from, self.change_to = self.lane.d, side

    def threatened(self, ego: EgoState, lead: _Lead) -> bool:
        """Say whether the vehicle ahead is a threat."""
        closing = ego.v - lead.v
        soon = time_to_collision(lead.gap, closing, lead.a) < self.threat_time
        return soon and closing + 0.5 * max(-lead.a, 0.0) > self.threat_closing

    def way_out(self, ego: EgoState, others: list[Neighbour], lead: _Lead) -> float:
        """Give the lateral offset [m] of the neighbouring lane to evade to, left first; 0 where none is safe."""
        closing = ego.v - lead.v
        left_over = lead.gap - closing * self.swerve_time - 0.5 * max(-lead.a, 0.0) * self.swerve_time**2
        if left_over < self.swerve_gap:
            return 0.0
        here = self.lane.here
        for width, sign in ((here.left_width, 1.0), (here.right_width, -1.0)):
            side = sign * (here.half_width + 0.5 * width)
            if width > 2.5 and self.free(ego, others, side):
                return side
        return 0.0

    def free(self, ego: EgoState, others: list[Neighbour], side: float) -> bool:
        """Say whether nobody is or comes too near in the lane at lateral offset `side` [m]."""
        for o in others:
            closing = ego.v - o.v_s if o.s > 0.0 else o.v_s - ego.v
            gap = abs(o.s) - o.half_length - self.half_length
            if in_corridor(o.d, o, self.half_width + 0.3, side) and gap < 5.0 + 2.0 * max(closing, 0.0):
                return False
        return True

    def accelerate(self, v: float, lead: _Lead | None) -> float:
        """Give the acceleration [m/s²]: towards the desired speed, bounded by the gap ahead."""
        free = min(max(0.6 * (self._desired() - v), -self.comfort_braking), 1.5)
        if lead is None:
            return free
        closing = v - lead.v
        wanted = self.standstill_gap + self.time_gap * v
        keep = 0.25 * (lead.gap - wanted) - 0.9 * closing
        if closing < 0.0:  # the gap opens: no need to brake for it
            keep = max(keep, -0.3)
        bounded = min(free, max(keep, -self.comfort_braking))
        if self.mode != "brake":
            return bounded
        room = max(lead.gap - self.standstill_gap, 0.5)
        needed = max(-lead.a, 0.0) + max(closing, 0.0) ** 2 / (2.0 * room)
        return max(min(bounded, -1.1 * needed), -self.max_braking)

    def lateral(self, t: float, ego: EgoState) -> tuple[float, float, float]:
        """Give where to be across the lane [m], and its first and second derivative [m/s, m/s²]."""
        if self.mode != "change":
            return 0.0, 0.0, 0.0
        d, drift, bend = quintic(self.change_from, self.change_to, t - self.change_begin, self.change_time)
        return float(d), float(drift), float(bend)

    def plan(self, t: float, ego: EgoState, a: float) -> Floats:
        """Give the planned states over the next 3 s."""
        v = max(ego.v, 0.0)
        driving = np.minimum(PLANNED, v / -a) if a < 0.0 else PLANNED  # until it stands
        plan = np.empty((len(PLANNED), 4))
        plan[:, 0] = t + PLANNED
        speed = plan[:, 3] = np.maximum(v + a * driving, 0.0)  # a rounding below 0 would be reversing
        run = 0.5 * (v + speed) * driving
        if self.mode == "change":
            since = t - self.change_begin + PLANNED
            d, _, _ = quintic(self.change_from, self.change_to, since, self.change_time)
        else:
            d = self.lane.d * _RETURN
        plan[:, 1], plan[:, 2] = self.lane.path.xy(self.lane.s + run, d)
        return plan

    def _desired(self) -> float:
        if self.desired_speed is not None:
            return self.desired_speed
        limit = self.lane.path.speed_limit_at(self.lane.s)
        return min(limit, self.start_speed) if math.isfinite(limit) else self.start_speed


def time_to_collision(gap: float, closing: float, lead_a: float) -> float:
    """Give the time [s] until the gap [m] is gone, at this closing speed [m/s] and the lead's braking [m/s²]."""
    braking = max(-lead_a, 0.0)
    if braking < 0.1:
        return gap / closing if closing > 0.0 else math.inf
    return (-closing + math.sqrt(closing * closing + 2.0 * braking * gap)) / braking


def quintic(begin: float, end: float, t: ArrayLike, duration: float) -> tuple[Floats, Floats, Floats]:
    """Give position, speed and acceleration at times t on the smoothest way from rest at `begin` to `end`."""
    u, span = np.clip(np.asarray(t, dtype=float) / duration, 0.0, 1.0), end - begin
    return (
        begin + span * u**3 * (10.0 - 15.0 * u + 6.0 * u * u),
        span * 30.0 * (u * (1.0 - u)) ** 2 / duration,
        span * 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / duration**2,
    )
