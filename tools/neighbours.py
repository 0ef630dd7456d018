"""Test drives around those of `drives`: the corner case harder, softer, with more room, and what else a highway holds.

All are driven by highway_pilot-1.0 with the virtual sensors. The map has two lanes at s = 300 m, three at s = 1745 m;
the EGO is on the right one of two, and in the middle of three.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from drives import CUT_BEGIN, CUT_BRAKE, CUT_TIME, LANE, Drive, Motion, Traffic, profile, swerve
from virtual_sensor import SensorErrors

from resim.core.geometry import Floats

CAR = 4.7
"""m, length of every vehicle."""
THREE_LANES = 1745.0
"""m along the road, where the EGO has a lane on either side."""

Mover = Callable[[Floats], Motion]
"""Gives the motion of one object at given times [s]."""


def around(*movers: Mover) -> Traffic:
    """Give the traffic of these objects, named 1, 2, ..."""
    return lambda path, t: {str(n): move(t) for n, move in enumerate(movers, start=1)}


def cut_in(start: float, braking: float | None) -> Mover:
    """The traffic object of the corner case, from `start` [m] on, braking at `braking` [m/s²] or not at all."""
    changes = () if braking is None else ((CUT_BRAKE, 20.0, -braking),)
    return lambda t: (start + profile(t, 32.5, *changes), LANE - swerve(t, CUT_BEGIN, CUT_TIME, LANE))


def keeping(gap: float, v: float, lane: int = 0, changes: Sequence[tuple[float, float, float]] = ()) -> Mover:
    """An object `gap` [m] ahead, bumper to bumper, in the EGO's lane (0), left of it (1) or right of it (-1), that
    changes its speed v [m/s] as `profile` has it."""
    return lambda t: (gap + CAR + profile(t, v, *changes), np.full_like(t, lane * LANE))


def leaving(gap: float, v: float, begin: float) -> Mover:
    """An object ahead that changes to the left lane from `begin` [s] on."""
    return lambda t: (gap + CAR + profile(t, v), swerve(t, begin, 2.5, LANE))


def _drive(
    description: str, duration: float, v: float, *movers: Mover, lane: int = -2, start: float = 300.0
) -> Drive:
    """A drive by the pilot; the seed is given by its place in NEIGHBOURS."""
    return Drive(
        description, "highway_pilot-1.0", duration, lane, v, around(*movers), SensorErrors(), start=start
    )  # fmt: skip


_DRIVES = {
    "cut_in_harder": _drive(
        "The corner case with 5.5 m/s² of braking instead of 4", 8.0, 23.7, cut_in(-11.0, 5.5)
    ),
    "cut_in_softer": _drive("The corner case with 2.5 m/s² of braking", 9.0, 23.7, cut_in(-11.0, 2.5)),
    "cut_in_farther": _drive("The corner case with 20 m more room", 9.0, 23.7, cut_in(9.0, 4.0)),
    "cut_in_only": _drive("The cut-in of the corner case, without braking", 8.0, 23.7, cut_in(-11.0, None)),
    "slow_overtaking": _drive(
        "Overtaken, for long, by one that is hardly faster", 9.0, 25.0, keeping(-22.0, 27.0, lane=1),
        keeping(70.0, 25.0),
    ),
    "lead_slows": _drive(
        "An object ahead slows down to 8 m/s, the left lane free: evades to the left", 9.0, 25.0,
        keeping(75.0, 25.0, changes=((1.5, 5.2, -4.5),)),
    ),
    "lead_slows_right_taken": _drive(
        "As before in the middle of three lanes, one alongside in the right lane: evades to the left", 9.0, 25.0,
        keeping(75.0, 25.0, changes=((1.5, 5.2, -4.5),)), keeping(-9.0, 25.0, lane=-1), start=THREE_LANES,
    ),
    "slow_lead_left_taken": _drive(
        "A very slow object ahead, one alongside in the left lane: brakes", 9.0, 30.0, keeping(150.0, 8.0),
        keeping(6.0, 26.0, lane=1),
    ),
    "lead_brakes_softly": _drive(
        "An object ahead brakes at 2.5 m/s² for 3 s", 9.0, 25.0,
        keeping(40.0, 25.0, changes=((2.0, 5.0, -2.5),)),
    ),
    "lead_brakes_hard": _drive(
        "An object ahead brakes at 6 m/s² to a standstill, the left lane taken", 9.0, 25.0,
        keeping(45.0, 25.0, changes=((2.0, 20.0, -6.0),)), keeping(-8.0, 25.0, lane=1),
    ),
    "cut_out": _drive(
        "An object ahead changes to the left and reveals a very slow one: brakes hard", 9.0, 30.0,
        leaving(35.0, 30.0, 1.5), keeping(104.0, 8.0),
    ),
    "jam_end": _drive(
        "The end of a jam, which is longer on the right lane", 10.0, 28.0,
        *(keeping(gap, 4.0, side) for gap, side in ((140.0, 0), (80.0, -1), (100.0, -1), (120.0, -1))), lane=-1,
    ),
}  # fmt: skip

NEIGHBOURS = {name: replace(drive, seed=seed) for seed, (name, drive) in enumerate(_DRIVES.items(), start=11)}
"""By name, each with a seed of its own."""
