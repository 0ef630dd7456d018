"""How far a variation is from its verified origin, in the terms of `resim verify --vary` (Groh 2018, III.C).

`resim verify --vary` finds, for one parameter at a time, within which amounts every KPI of the simulation stays as
measured. A variation changes everything a little; so it is held against the hull of what was simulated there:

* place along the lane: between what `gap` moves, and what `speed` moves by that time;
* speed: between what `speed` changes, where the object brakes also what `braking` does by that time;
* place across the lane: between the original's with its lane change moved in time as far as `lane_change` allows, or
  ACROSS to either side of the original's.

All of that holds in every moment that both are there for, and for every object that is varied. What a variation changes
by less than the parameter's own resolution is no change; it widens no range, as a KPI may flip so little beyond one.
Readings of ours: the source says only that a variation between a verified scenario and a re-checked one is trusted.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.interpolate import CubicSpline

from resim.core.geometry import Floats
from resim.variations.lane_motion import LaneMotion
from resim.verification.validity_interval import ValidityInterval

ACROSS = 0.1
"""m across the lane that is no change: a third of how far people are off what they did the time before (our choice)."""
SAME = 1e-6
"""m or m/s by which a range is left before it is told: rounding."""
TrustLevel = Literal["inside", "outside", "unknown"]


@dataclass(frozen=True)
class Trust:
    """Whether a variation lies within what was verified.

    Attributes:
        level: "inside" and legitimised by it; "outside"; "unknown" where nothing was verified of it.
        reason: Why it is not inside; "" where it is.
    """

    level: TrustLevel
    reason: str


UNVERIFIED = Trust("unknown", "no verification was given (--verified)")


def judged_trust(
    before: Mapping[str, LaneMotion], after: Mapping[str, LaneMotion], ranges: Sequence[ValidityInterval],
    other: str = "",
) -> Trust:  # fmt: skip
    """Say whether motions of objects, by id, lie within verified ranges around those before.

    other: what else is not as in the origin, "" for nothing: types of vehicles and weathers are not verified by ranges.
    """
    if other:
        return Trust("outside", f"{other}: verified is the origin's own")
    for name, motion in after.items():
        own = {one.parameter: one for one in ranges if one.object == name}
        if not own:
            return Trust("unknown", f"no range of object {name} was verified")
        if why := next(_outside(before[name], motion, own), ""):
            return Trust("outside", f"object {name}: {why}")
    return Trust("inside", "")


def _outside(before: LaneMotion, after: LaneMotion, ranges: Mapping[str, ValidityInterval]) -> Iterator[str]:
    """Why a motion is outside."""
    t = before.t - before.t[0]
    hull = {name: (one.low.amount, one.high.amount) for name, one in ranges.items()}
    room = {name: one.resolution for name, one in ranges.items()}
    speed, gap = hull.get("speed", (0.0, 0.0)), hull.get("gap", (0.0, 0.0))
    along, more = after.s - before.s, np.gradient(after.s, t) - np.gradient(before.s, t)
    low, high = np.minimum(gap[0], speed[0] * t), np.maximum(gap[1], speed[1] * t)
    yield from _beyond("along its lane", "m", along, low, high, room.get("gap", 0.25))
    braking = hull.get("braking", (0.0, 0.0))
    low, high = np.minimum(speed[0], -braking[1] * t), np.maximum(speed[1], -braking[0] * t)
    yield from _beyond("speed", "m/s", more, low, high, room.get("speed", 0.05))
    shifts = np.linspace(*hull.get("lane_change", (0.0, 0.0)), 41)
    spline = CubicSpline(before.t, before.d)
    moved = np.stack([spline(np.clip(before.t - shift, before.t[0], before.t[-1])) for shift in shifts])
    low, high = moved.min(axis=0) - before.d, moved.max(axis=0) - before.d
    yield from _beyond("across its lane", "m", after.d - before.d, low, high, ACROSS)


def _beyond(what: str, unit: str, changed: Floats, low: Floats, high: Floats, room: float) -> Iterator[str]:
    """Where a change (K,) leaves its range (K,). room: what is no change."""
    over = np.maximum(changed - np.maximum(high, room), np.minimum(low, -room) - changed)
    k = int(over.argmax())
    if over[k] > SAME:
        yield f"{what} {changed[k]:+.2f} {unit}, verified {low[k]:+.2f} to {high[k]:+.2f}"
