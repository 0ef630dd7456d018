"""Drivers of traffic that reacts: the Intelligent Driver Model, fitted to what an object did in its recording.

Treiber, Hennecke and Helbing (2000), as SUMO has it (carFollowModel IDM), with a reaction time: what a driver wants, it
does that much later, but for braking harder than is comfortable, which who follows attentively does at once. Fitted are
time gap, acceleration and reaction time; the desired speed is a tenth above the largest measured.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from resim.core.geometry import Floats
from resim.simulation.reactive.settings import DriverSettings

SLOWEST = 5.0
"""m/s; nobody wants to be slower, whose recording shows no more."""
_FASTER = 1.1
"""Times the largest measured speed that is desired: without it a driver who fell back never catches up."""
FEWEST = 4.0
"""s of following without which nothing is fitted."""
GRID = 0.2
"""s between samples of a fit, as nearly as steps allow."""
_USUAL = 3e-3
"""Squared relative error of the gaps that a driver's acceleration has to be better by, at e times or 1/e of the usual
one, or at a reaction time of 1 s more or less."""
_GAPS = np.array([0.1, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0, 1.2, 1.5, 1.8, 2.2, 2.7, 3.3])
_ACCELERATIONS = np.array([0.5, 0.9, 1.4, 2.2])
_REACTIONS = np.array([0.4, 0.8, 1.2])


@dataclass(frozen=True)
class TrafficDriver:
    """How one object is driven: desired speed [m/s], and the rest as `DriverSettings`; fitted: to so much time [s]."""

    desired: float
    time_gap: float
    standstill: float
    acceleration: float
    deceleration: float
    reaction: float
    fitted: float = 0.0


@dataclass(frozen=True, eq=False)
class Following:
    """A stretch of following: T samples, `step` [s] apart: s [m] and v [m/s] of the follower, gap [m] and the leader's
    v."""

    s: Floats
    v: Floats
    gap: Floats
    lead_v: Floats
    step: float

    @property
    def time(self) -> float:
        """How long [s] it lasts."""
        return self.step * len(self.s)

    def part(self, share: slice) -> Following:
        """Give a part of it."""
        return Following(self.s[share], self.v[share], self.gap[share], self.lead_v[share], self.step)


def wanted(driver: TrafficDriver, v: Floats | float, gap: Floats, lead_v: Floats) -> Floats:
    """Give accelerations [m/s²] at v behind leaders at these gaps; an infinite gap is none."""
    return _idm(v, gap, lead_v, driver, (driver.time_gap, driver.acceleration))


def driver_of(kind: DriverSettings, v: Floats) -> TrafficDriver:
    """Give the driver of a kind who drove at v (T,) [m/s]."""
    return TrafficDriver(
        max(_FASTER * float(np.max(v)), SLOWEST), kind.time_gap, kind.standstill, kind.acceleration, kind.deceleration,
        kind.reaction,
    )  # fmt: skip


def fitted(driver: TrafficDriver, stretches: Sequence[Following]) -> TrafficDriver:
    """Give the driver that follows as was measured; the same one where too little was.

    Of all time gaps, accelerations and reaction times of a grid those are taken whose gaps, driven from each stretch's
    start on, are nearest to the measured ones, relative to these; of what these tell little about, the usual.
    """
    usable = [one for one in stretches if one.time >= 2.0]
    time = sum(one.time for one in usable)
    if time < FEWEST:
        return driver
    grid = np.array([*itertools.product(_GAPS, _ACCELERATIONS, _REACTIONS)])
    total = np.zeros(len(grid))
    for one in usable:
        gaps = _driven(one, driver, grid)
        total += (((gaps - one.gap) / (one.gap + driver.standstill)) ** 2).sum(axis=1)
    unusual = np.log(grid[:, 1] / driver.acceleration) ** 2 + (grid[:, 2] - driver.reaction) ** 2
    total += _USUAL * unusual * sum(len(one.s) for one in usable)
    time_gap, acceleration, reaction = grid[int(np.argmin(total))].tolist()
    return replace(driver, time_gap=time_gap, acceleration=acceleration, reaction=reaction, fitted=time)


def followed(driver: TrafficDriver, one: Following) -> Floats:
    """Give the gaps (T,) [m] of a driver who follows the measured leader from the measured start on."""
    own = np.array([[driver.time_gap, driver.acceleration, driver.reaction]])
    gaps: Floats = _driven(one, driver, own)[0]
    return gaps


def _driven(one: Following, driver: TrafficDriver, grid: Floats) -> Floats:
    """Gaps (G, T) [m] with the time gaps, accelerations and reaction times of the grid (G, 3)."""
    time_gap, acceleration, reaction = grid.T
    late = np.round(reaction / one.step).astype(int)
    lead = one.s + one.gap
    count = len(grid)
    s, v = np.full(count, one.s[0]), np.full(count, one.v[0])
    first = np.gradient(one.v, one.step)[0] if len(one.v) > 1 else 0.0
    want = np.full((len(one.s), count), first)
    out: Floats = np.empty((count, len(one.s)))
    rows = np.arange(count)
    for k in range(len(one.s)):
        out[:, k] = lead[k] - s
        want[k] = _idm(v, out[:, k], one.lead_v[k], driver, (time_gap, acceleration))
        late_one = np.where(k >= late, want[np.maximum(k - late, 0), rows], first)
        a = np.where(want[k] < -driver.deceleration, want[k], late_one)
        after = np.maximum(v + a * one.step, 0.0)
        s, v = s + 0.5 * (v + after) * one.step, after
    return out


def _idm(
    v: Floats | float,
    gap: Floats,
    lead_v: Floats | float,
    driver: TrafficDriver,
    own: tuple[Floats | float, Floats | float],
) -> Floats:
    """Accelerations by the model; own: time gaps and accelerations in place of the driver's."""
    time_gap, acceleration = own
    closing = v * (v - lead_v) / (2.0 * np.sqrt(acceleration * driver.deceleration))
    keep = driver.standstill + np.maximum(v * time_gap + closing, 0.0)
    return np.asarray(acceleration * (1.0 - (v / driver.desired) ** 4 - (keep / np.maximum(gap, 0.1)) ** 2))
