"""A highway pilot: car following, emergency braking, and a lane change where that is the safer way out.

Its decision threshold is that of Section 5.2 of Wagner 2021: "if the threat is too high, emergency braking
provides remedy at the cost of passenger comfort. This can be avoided if there is still enough space and time
left to overtake the traffic object safely".
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from adfunc.lane_keeping import Lanes, alone, in_corridor
from resim.core.geometry import Bools, Floats
from resim.driving import kernel
from resim.road.paths import Along
from resim.simulation.function.batch import CommandBatch, Keys, PerceivedBatch
from resim.simulation.function.interface import Command, Perceived, Setup

FOLLOW, BRAKE, CHANGE = range(3)
"""Modes."""

PLANNED = np.arange(0.0, 3.01, 0.25)
"""Times [s] ahead of the states of a plan."""
_RETURN = np.exp(-PLANNED)
"""What is left by then of a distance from the lane's centre."""


class _Lead(NamedTuple):
    """The vehicles to mind (B,): the gap [m] between the boxes, infinite without one, the other's speed [m/s] and
    acceleration [m/s²] along the lane, and how soon [s] the gap is gone.
    """

    gap: Floats
    v: Floats
    a: Floats
    soon: Floats


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
        self.keys = Keys(1)
        self.reset_batch([setup])

    def step(self, perceived: Perceived) -> Command:
        """Decide, then accelerate and steer accordingly."""
        return alone(self, perceived, self.keys)

    def reset_batch(self, setups: Sequence[Setup]) -> None:
        """Look up the lanes."""
        runs, one = len(setups), setups[0]
        self.lanes = Lanes(setups)
        self.half_length, self.half_width = 0.5 * one.length, 0.5 * one.width
        self.start_speed = np.array([max(setup.start.v, 1.0) for setup in setups])
        self.cycle, self.smoothing = one.cycle, 1.0 - math.exp(-one.cycle / 0.3)
        self.mode = np.full(runs, FOLLOW)
        self.change_begin, self.change_from, self.change_to = np.zeros((3, runs))
        self.known, self.last = np.full((runs, 1, 3), np.nan), math.nan  # t, v, a by key; t of the last list

    def step_batch(self, perceived: PerceivedBatch) -> CommandBatch:
        """Decide, then accelerate and steer accordingly."""
        ego, t = perceived.ego, perceived.t
        self.lanes.place(ego)
        others = self.lanes.locate(perceived)
        lead = self.mind(t, ego[:, 3], others)
        self.decide(t, ego, others, lead)
        v = ego[:, 3]
        a = self.accelerate(v, lead)
        curvature = self.lanes.steer(v, self.lateral(t))
        return CommandBatch(a, curvature, self.plan(t, v, a))

    def close(self) -> None:
        """Nothing to end."""

    @property
    def changing(self) -> bool:
        """Whether any changes lane."""
        return CHANGE in self.mode.tolist()

    def mind(self, t: float, v: Floats, others: Along) -> _Lead:
        """Find the nearest vehicles that are in the way, or will be by their drift."""
        if (more := self.lanes.paths.room - self.known.shape[1]) > 0:
            self.known = np.pad(self.known, ((0, 0), (0, more), (0, 0)), constant_values=np.nan)
        out, offset = np.empty((4, len(v))), np.zeros(len(v))
        if self.changing:
            offset = np.where(self.mode == CHANGE, self.lanes.d, 0.0)
        how = (self.half_width + 0.1, self.cut_in_horizon, self.half_length, self.cycle, self.smoothing)
        kernel.mind(*others, v, offset, tuple(map(float, how)), self.known, (float(t), self.last), out)
        self.last = float(t)
        return _Lead(*out)

    def decide(self, t: float, ego: Floats, others: Along, lead: _Lead) -> None:
        """Change the modes where the situation asks for it."""
        mode, v = self.mode, ego[:, 3]
        threat = self.threatened(v, lead)
        if threat is None and max(mode.tolist()) == FOLLOW:
            return  # all follow, and go on
        threat = np.zeros(len(v), dtype=bool) if threat is None else threat
        changing = mode == CHANGE
        done = changing & (t > self.change_begin + self.change_time)
        self.lanes.look_up(np.flatnonzero(done).tolist(), ego)
        none = lead.gap == kernel.NO_LEAD
        calm = ~changing & (none | ((mode == BRAKE) & (v < lead.v - 0.5)))
        asked = (mode == FOLLOW) & ~calm & threat
        mode[done | calm] = FOLLOW
        for b in np.flatnonzero(asked).tolist():
            side = self.way_out(b, float(v[b]), others.of(b), lead)
            mode[b] = BRAKE if side == 0.0 else CHANGE
            if side != 0.0:
                self.change_begin[b], self.change_from[b], self.change_to[b] = t, self.lanes.d[b], side

    def threatened(self, v: Floats, lead: _Lead) -> Bools | None:
        """Say whose vehicle ahead is a threat; None where nobody's is."""
        if min(lead.soon.tolist()) >= self.threat_time:
            return None
        towards = v - lead.v + 0.5 * np.maximum(-lead.a, 0.0)
        return np.asarray((lead.soon < self.threat_time) & (towards > self.threat_closing))

    def way_out(self, b: int, v: float, others: Along, lead: _Lead) -> float:
        """Give the lateral offset [m] of the neighbouring lane to evade to, left first; 0 where none is safe."""
        gap, lead_v, lead_a, _ = (float(column[b]) for column in lead)
        braked = 0.5 * max(-lead_a, 0.0) * self.swerve_time**2
        if gap - (v - lead_v) * self.swerve_time - braked < self.swerve_gap:
            return 0.0
        here = self.lanes.here(b)
        for width, sign in ((here.left_width, 1.0), (here.right_width, -1.0)):
            side = sign * (here.half_width + 0.5 * width)
            if width > 2.5 and self.free(v, others, side):
                return side
        return 0.0

    def free(self, v: float, others: Along, side: float) -> bool:
        """Say whether nobody is or comes too near in the lane at lateral offset `side` [m]; others: of one run."""
        closing = np.where(others.s > 0.0, v - others.v_s, others.v_s - v)
        gap = np.abs(others.s) - others.half_length - self.half_length
        near = gap < 5.0 + 2.0 * np.maximum(closing, 0.0)
        return not (in_corridor(others.d, others, self.half_width + 0.3, side) & near).any()

    def accelerate(self, v: Floats, lead: _Lead) -> Floats:
        """Give the accelerations (B,) [m/s²]: towards the desired speed, bounded by the gap ahead."""
        limits = (self.standstill_gap, self.time_gap, self.comfort_braking, self.max_braking)
        out, hard = np.empty(len(v)), self.mode == BRAKE
        kernel.follow(v, self._desired(), *lead[:3], hard, tuple(map(float, limits)), out)
        return out

    def lateral(self, t: float) -> Floats:
        """Give where to be across the lanes [m], and its first and second derivative [m/s, m/s²]: (3, B)."""
        out = np.zeros((3, len(self.mode)))
        if self.changing:
            changing = self.mode == CHANGE
            ends, begin = (self.change_from[changing], self.change_to[changing]), self.change_begin[changing]
            out[:, changing] = quintic(*ends, t - begin, self.change_time)
        return out

    def plan(self, t: float, v: Floats, a: Floats) -> Floats:
        """Give the planned states (B, K, 4) over the next 3 s."""
        plan, places = np.empty((len(v), len(PLANNED), 4)), np.empty((2, len(v), len(PLANNED)))
        kernel.plan(float(t), v, a, self.lanes.s, self.lanes.d, PLANNED, _RETURN, plan, places)
        if self.changing:
            changing = self.mode == CHANGE
            since = t - self.change_begin[changing, None] + PLANNED
            ends = self.change_from[changing, None], self.change_to[changing, None]
            places[1, changing] = quintic(*ends, since, self.change_time)[0]
        plan[:, :, 1], plan[:, :, 2] = self.lanes.paths.xy(*places)
        return plan

    def _desired(self) -> Floats:
        """The speeds (B,) [m/s] to drive at on a free road."""
        limited = self.lanes.limited(self.desired_speed, self.start_speed)
        return limited if self.desired_speed is not None else np.minimum(limited, self.start_speed)


def quintic(
    begin: Floats | float, end: Floats | float, t: ArrayLike, duration: float
) -> tuple[Floats, Floats, Floats]:
    """Give position, speed and acceleration at times t on the smoothest way from rest at `begin` to `end`."""
    u, span = np.clip(np.asarray(t, dtype=float) / duration, 0.0, 1.0), end - begin
    return (
        begin + span * u**3 * (10.0 - 15.0 * u + 6.0 * u * u),
        span * 30.0 * (u * (1.0 - u)) ** 2 / duration,
        span * 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / duration**2,
    )
