"""When the EGO first brakes, told alike of measured and simulated drives, and how sure that time is."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from resim.core.geometry import unwrap_angle
from resim.core.tracks import Tracks
from resim.road.opendrive import RoadNetwork
from resim.scenario import maneuvers
from resim.scenario.fit import fit_trace
from resim.scenario.scenario import Scenario

STEP = 0.01
"""Times [s] at which splines are asked for accelerations."""

DRAWS = 16
AROUND = 15.0
"""How far [s] before and after first braking a drive is fitted anew."""

ROUNDED = 1.0 / 6.0
"""1/s; times the lengths [s] of the segment of the speed's spline that braking is read in and of the next: by how much
they round its beginning off in two of three cases and more (drawn drives of known braking, tools/validate_reaction.py).
"""
USUAL = 0.68
"""Share of readings that are off by no more than the spread: of normal ones one standard deviation."""


def ego_tracks(scenario: Scenario, network: RoadNetwork) -> Tracks:
    """Give how the EGO drove as its splines have it, with accelerations, every 0.01 s.

    A measured drive has accelerations by its splines alone, and splines round off where braking begins: a simulated
    drive is described in the same way before the two are compared, never taken as simulated.
    """
    begin = scenario.ego.spawn_time
    t = np.round(np.arange(begin, begin + scenario.duration, STEP), 9)
    return replace(scenario, objects=()).tracks(network, t)


def reaction_spread(measured: Tracks, described: Scenario, network: RoadNetwork) -> float | None:
    """Give how far [s] the measured first braking is off in two of three cases.

    None for an EGO that does not brake, or from the start on: then nothing tells when it began.

    The EGO's fitted trace is fitted again DRAWS times, each with the residuals of the fit at other times and with
    other signs, and read as the drive itself: as the bootstrap has it, that strays as much as the drive's own reading.
    Who does not brake in a draw counts as braking at its end. Simulated drives have no noise to add to it. No draw
    shows how far the fit itself is off: noisier tracks have longer segments, and braking begins earlier there.
    """
    drive = ego_tracks(described, network)
    found = maneuvers.reaction_time(drive, ego=described.ego.id)
    if found is None or found == drive.t[0]:
        return None
    own = measured.window(found - AROUND, found + AROUND).select([described.ego.id])
    there = own.valid[0]
    t, heading = own.t[there], unwrap_angle(own.heading[0, there])
    x, y, v = own.x[0, there], own.y[0, there], own.v[0, there]
    trace = described.traces(network)[0]
    told = trace.states(t)
    off, rng = (x - told.x) + 1j * (y - told.y), np.random.default_rng(0)
    late = np.empty(DRAWS)
    for n in range(DRAWS):
        drawn = rng.choice([-1.0, 1.0]) * np.roll(off, rng.integers(len(off)))
        again = fit_trace(t, told.x + drawn.real, told.y + drawn.imag, heading, v).trace
        at = np.arange(t[0], t[-1], STEP)
        braking = np.flatnonzero(again.v(at, 1) < maneuvers.REACTED)
        late[n] = (at[braking[0]] if len(braking) else t[-1]) - found
    segments = np.diff(trace.v.x)
    here = int(np.clip(np.searchsorted(trace.v.x, found) - 1, 0, len(segments) - 1))
    rounded = ROUNDED * float(segments[here] * segments[min(here + 1, len(segments) - 1)])
    return max(math.hypot(float(np.quantile(np.abs(late), USUAL)), rounded), STEP)
