"""Test drives to make recordings of: what the traffic does, who drives, and what it sees."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from virtual_sensor import SensorErrors

from resim.core.geometry import Floats
from resim.road.path import Path as LanePath

LANE = 3.5
"""m, width of a lane of the proving ground."""
Motion = tuple[Floats, Floats]
"""Of an object over time: way along the EGO's lane and offset to its left [m]."""
Traffic = Callable[[LanePath, Floats], dict[str, Motion]]
"""Gives the motion of every object at given times [s]."""


@dataclass(frozen=True)
class Drive:
    """A test drive to make: what the traffic does, who drives, what it sees.

    duration [s]; ego_v [m/s] of the EGO on its lane at s = start [m] of the map's first road; traffic: way [m]
    along that lane from the EGO's start and offset [m] to its left at given times, by object.
    """

    description: str
    build: str
    duration: float
    ego_lane: int
    ego_v: float
    traffic: Traffic
    sensor: SensorErrors | None
    seed: int = 1
    start: float = 300.0


def profile(t: Floats, v: float, *changes: tuple[float, float, float]) -> Floats:
    """Distance [m] at times t of an object at speed v [m/s] that accelerates by a [m/s²] from t0 to t1 [s].

    Accelerations build up and fade over 0.3 s.
    """
    fine = np.arange(t[0], t[-1] + 1e-3, 1e-3)
    a = np.zeros_like(fine)
    for t0, t1, amount in changes:
        a += amount * np.clip(np.minimum((fine - t0) / 0.3, (t1 - fine) / 0.3), 0.0, 1.0)
    speed = np.maximum(v + np.concatenate([[0.0], np.cumsum(0.5e-3 * (a[1:] + a[:-1]))]), 0.0)
    way = np.concatenate([[0.0], np.cumsum(0.5e-3 * (speed[1:] + speed[:-1]))])
    return np.interp(t, fine, way)


def swerve(t: Floats, begin: float, duration: float, to: float) -> Floats:
    """Lateral offset [m] of a lane change to `to` [m] that begins at `begin` [s]."""
    u = np.clip((t - begin) / duration, 0.0, 1.0)
    return to * u**3 * (10.0 - 15.0 * u + 6.0 * u * u)


def cut_in_brake(path: LanePath, t: Floats) -> dict[str, Motion]:
    """The traffic object comes from 11 m behind at 32.5 m/s on the left, cuts in, brakes at 4 m/s²."""
    return {
        "1": (-11.0 + profile(t, 32.5, (CUT_BRAKE, 20.0, -4.0)), LANE - swerve(t, CUT_BEGIN, CUT_TIME, LANE))
    }


CUT_BEGIN, CUT_TIME, CUT_BRAKE = 2.0, 3.0, 3.7


def rear_end(path: LanePath, t: Floats) -> dict[str, Motion]:
    """A slow traffic object 52 m ahead (bumper to bumper)."""
    return {"1": (52.0 + 4.7 + profile(t, 10.0), np.zeros_like(t))}


def overtake(path: LanePath, t: Floats) -> dict[str, Motion]:
    """One overtakes on the left and goes on; one drives well ahead, one well behind."""
    return {
        "1": (-25.0 + profile(t, 30.0), LANE * np.ones_like(t)),
        "2": (90.0 + profile(t, 26.0), np.zeros_like(t)),
        "3": (-60.0 + profile(t, 24.5), np.zeros_like(t)),
    }


DRIVES = {
    "cut_in_brake": Drive(
        "Cut-in and braking of an overtaking object: the corner case of Wagner 2021, Section 5.2",
        "highway_pilot-1.0", 9.2, -2, 23.7, cut_in_brake, SensorErrors(),
    ),
    "rear_end": Drive(
        "Rear-end collision with a slow object that the function ignores: Wagner 2021, Section 4.2.2.1",
        "constant_velocity-1.0", 4.84, -2, 21.0, rear_end, SensorErrors(),
    ),
    "overtake": Drive(
        "An uncritical overtaking on the left", "highway_pilot-1.0", 10.0, -2, 25.0, overtake, SensorErrors()
    ),
}  # fmt: skip
