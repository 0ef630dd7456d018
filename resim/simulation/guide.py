"""Where every object is commanded to be: on its trace, and before its start on a lead-in towards it.

The lead-in (relaxation, Wagner 2021, Section 5.2.3) gives the AD function a history and ends exactly in the
initial state. It follows the curvature of the lane; a start heading across the lane and a start acceleration
fade in over the last second.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from resim.core.errors import ResimError
from resim.core.geometry import Bools, Floats, wrap_angle
from resim.road.opendrive import RoadNetwork
from resim.scenario.scenario import KNOTS, Scenario, ScenarioObject, heights_of
from resim.scenario.trace import Trace, TraceStates
from resim.simulation.function.interface import EgoState

FADE = 1.0
"""Time [s] before the start over which a start acceleration and a heading across the lane come up."""

_ACROSS = 0.5  # rad; farther than this off the lane's direction an object is not following the lane
_GRID = 0.02  # s
_STRONGEST = 6.0  # m/s²; a start acceleration beyond it is taken for a wiggle of the spline


@dataclass(frozen=True, eq=False)
class Guide:
    """Commanded states of EGO (row 0) and traffic objects at the steps' times: (N, T).

    t: (T,) s. present: which objects are there. begin: the step at the scenario's start. z: (N, T) m, heights of the
    road under them, NaN where not known, None where none is.
    """

    t: Floats
    x: Floats
    y: Floats
    heading: Floats
    v: Floats
    a: Floats
    yaw_rate: Floats
    present: Bools
    begin: int
    z: Floats | None = None

    def state(self, n: int, k: int) -> EgoState:
        """Give object n's state at step k."""
        columns = (self.x, self.y, self.heading, self.v, self.a, self.yaw_rate)
        return EgoState(*(float(c[n, k]) for c in columns))


def guide(scenario: Scenario, network: RoadNetwork, *, step: float, lead_in: float) -> Guide:
    """Lay out the commanded motion from `lead_in` [s] before the EGO's start to the scenario's end.

    Raises ResimError for a negative lead-in, and where the EGO is not there for one step.
    """
    begin, end = scenario.ego.spawn_time, float(scenario.ego.v.x[-1])
    before = round(lead_in / step)
    after = int(np.floor(min(scenario.duration, end - begin) / step + 1e-6))
    if lead_in < 0.0 or after < 1:
        raise ResimError(
            f"nothing to simulate: lead-in {lead_in:g} s, EGO there for {end - begin:g} s, step {step:g} s"
        )
    t = np.round(begin + step * np.arange(-before, after + 1), 9)  # 0.6, not 0.6000000000000001
    directions, bends = _lanes((scenario.ego, *scenario.objects), network)
    rows = []
    for trace, direction, bend in zip(scenario.traces(network), directions, bends, strict=True):
        states = _columns(trace.states(t))
        if trace.start <= begin + step:
            early = t < trace.start - 1e-6
            states[:, early] = _lead_in(trace, direction, bend, trace.start - t[early])
        rows.append(states)
    x, y, heading, v, a, yaw_rate = np.stack(rows, axis=1)
    present = np.isfinite(x)
    return Guide(t, x, y, heading, v, a, yaw_rate, present, before, _heights(scenario, t, present))


def _heights(scenario: Scenario, t: Floats, present: Bools) -> Floats | None:
    """Heights (N, T) [m], on before the start as they change there; None where none is known."""
    members = (scenario.ego, *scenario.objects)
    told = heights_of(members, t)
    if told is None:
        return None
    for n, member in enumerate(members):
        if member.z is not None and member.z.x[0] <= member.spawn_time + KNOTS:
            early = t < member.z.x[0]
            told[n, early] = member.z(member.z.x[0]) + member.z(member.z.x[0], 1) * (t[early] - member.z.x[0])
    return np.where(present, told, np.nan)


def _columns(states: TraceStates) -> Floats:
    return np.stack([states.x, states.y, states.heading, states.v, states.a, states.yaw_rate])


def _lanes(members: Sequence[ScenarioObject], network: RoadNetwork) -> tuple[list[float], list[float]]:
    """Directions [rad] and curvatures [1/m] of every object's lane at its start."""
    starts = [m.start for m in members]
    at = (
        np.array([p.road for p in starts]),
        np.array([p.lane for p in starts]),
        np.array([p.s for p in starts]),
    )
    return network.lane_heading(*at).tolist(), network.curvature(*at).tolist()


def _lead_in(trace: Trace, direction: float, bend: float, tau: Floats) -> Floats:
    """States (6, T) tau [s] before the start of a trace."""
    x0, y0, heading0, v0, a0, _ = _columns(trace.states(np.array([trace.start])))[:, 0].tolist()
    a0 = min(max(a0, -_STRONGEST), _STRONGEST)
    across = float(wrap_angle(heading0 - direction))
    if abs(across) > _ACROSS or not np.isfinite(bend):
        across, bend = 0.0, 0.0

    grid = _GRID * np.arange(int(np.ceil((tau.max() if len(tau) else 0.0) / _GRID)) + 2)
    fade = np.minimum(grid / FADE, 1.0)
    v = v0 - a0 * FADE * (fade - 0.5 * fade**2)
    v = np.maximum(v, 0.0) if v0 >= 0.0 else np.minimum(v, 0.0)
    heading = heading0 - bend * _integral(v) - across * fade
    columns = np.stack(
        [
            x0 - _integral(v * np.cos(heading)),
            y0 - _integral(v * np.sin(heading)),
            heading,
            v,
            a0 * (1.0 - fade),
            bend * v + np.where(grid < FADE, across / FADE, 0.0),
        ]
    )
    return np.stack([np.interp(tau, grid, column) for column in columns])


def _integral(f: Floats) -> Floats:
    return np.concatenate([[0.0], np.cumsum(0.5 * _GRID * (f[1:] + f[:-1]))])
