"""The function along the measured drive: it answers what was recorded as perceived, and its answers move nothing."""

from __future__ import annotations

import numpy as np
import pandas as pd

from resim.core.clock import TICK
from resim.core.geometry import Floats, wrap_angle
from resim.perception.runtime.recorded import RecordedPerception
from resim.resimulation.compute_outcome import PARTED
from resim.resimulation.result import Resimulation, is_recorded_build
from resim.simulation.case import SimulatedDrive
from resim.simulation.function.interface import EgoState
from resim.verification.blame import Function, OpenLoopFinding
from resim.verification.tolerance import Tolerances

HORIZON, STRIDE = 1.0, 0.2
"""s that the vehicle model is left to itself, and from one start of it to the next."""
ALIKE = 0.2
"""s for which plans may be others before the function is: it sees what was recorded within a cycle."""
AHEAD = 2.0
"""s of each plan that are compared."""
SHORTEST = 0.5
"""s that a recorded plan reaches ahead, at least, to say anything."""
UNPLANNED = 1.0
"""s of the drive without such a plan beyond which it is not shown that the function plans as it did."""


def open_loop(result: Resimulation, tolerances: Tolerances) -> OpenLoopFinding | None:
    """Show the function what was recorded as perceived along the measured drive, and drive the vehicle model by it.

    None for an oracle, which is not shown anything, where the function fails, and for less than `HORIZON` of drive.
    """
    if result.build.needs_truth:
        return None
    drive = _answers(result)
    if drive.failure or not len(away := _departures(drive)):
        return None
    size = np.abs(away[:, 1:])
    error: dict[str, float | None] = dict(zip(("d", "v", "heading"), size.max(axis=0).tolist(), strict=True))
    beyond = tuple(tolerances.beyond("vehicle", {"ego": error}))
    off = [size[:, ("d", "v", "heading").index(e.quantity)] > e.limit for e in beyond]
    planned = _planned_otherwise(result.recording.plan, drive)
    return OpenLoopFinding(
        error=error,
        beyond=beyond,
        t=float(away[np.any(off, axis=0), 0][0]) if beyond else None,
        function=_function(result, planned),
        planned=planned,
        senses=result.recording.sd is not None,
    )


def _answers(result: Resimulation) -> SimulatedDrive:
    """The drive whose EGO goes as measured. Recorded errors are taken against the description, as it is what is run."""
    recording, scenario, options = result.recording, result.described["GT"], result.options
    sd, shown = result.prepared.whole.get("SD"), None
    if sd is not None:
        driven = scenario.tracks(result.network, sd.t).joined()
        shown = RecordedPerception(driven, sd, ego=recording.ego, senses_ego=recording.senses_ego)
    return options.case(scenario, result.network, result.build, perception=shown, open_loop=True).drive()


def _departures(drive: SimulatedDrive) -> Floats:
    """Of windows of HORIZON (K, 4): begin [s], and distance [m], speed [m/s] and heading [rad] of drive less model.

    Up to the first collision, which moves a vehicle differently from its actuators.
    """
    truth, model = drive.truth, drive.case.vehicle
    assert truth.a is not None
    assert truth.yaw_rate is not None
    if len(truth.t) < 2:
        return np.empty((0, 4))
    step = float(truth.t[1] - truth.t[0])
    many, every = round(HORIZON / step), max(1, round(STRIDE / step))
    last = drive.collisions[0].t if drive.collisions else np.inf
    columns = (truth.x, truth.y, truth.heading, truth.v, truth.a, truth.yaw_rate)
    states = np.stack([column[0] for column in columns], axis=1)
    out = []
    for begin in range(0, len(states) - many, every):
        commands, end = drive.commands[begin : begin + many], begin + many
        if truth.t[end] >= last or not np.isfinite(commands).all():
            break
        state = model.settle(EgoState(*states[begin].tolist()))
        for acceleration, curvature in commands.tolist():
            state = model.step(state, acceleration, curvature, step)
        x, y, heading, v = states[end, :4].tolist()
        turned = float(wrap_angle(heading - state.heading))
        out.append((float(truth.t[begin]), np.hypot(x - state.x, y - state.y), v - state.v, turned))
    return np.array(out).reshape(-1, 4)


def _function(result: Resimulation, planned: float | None) -> Function:
    recording, build = result.recording, result.build
    if planned is not None and (planned <= ALIKE or recording.sd is not None):
        return "plans otherwise" if planned > ALIKE else "plans as recorded"
    same = bool(is_recorded_build(recording, build)) and recording.build_hash == build.hash
    return "is the build that drove" if same and recording.sd is not None else "unknown"


def _planned_otherwise(recorded: pd.DataFrame | None, drive: SimulatedDrive) -> float | None:
    """For how long [s] the plans are others than those recorded, by `PARTED`; None where that is not known.

    Few or short recorded plans may show that it plans otherwise, but not that it plans as it did.
    """
    if recorded is None or len(drive.plans) < 2:
        return None
    made = np.array([t for t, _ in drive.plans])
    cycle = float(np.median(np.diff(made)))
    off: list[bool] = []
    compared: list[float] = []
    for when, plan in recorded.groupby("t"):
        t = float(when)  # type: ignore[arg-type]
        k = int(np.abs(made - t).argmin())
        own = drive.plans[k][1]
        there = plan[(plan.t_plan >= own[0, 0]) & (plan.t_plan <= min(own[-1, 0], t + AHEAD))]
        if abs(made[k] - t) <= 0.5 * cycle + 1e-6 and len(there):
            x, y, v = (np.interp(there.t_plan, own[:, 0], own[:, n]) for n in (1, 2, 3))
            away = np.hypot(x - there.x, y - there.y).max()
            off.append(away > PARTED["d"] or np.abs(v - there.v).max() > PARTED["v"])
            if float(there.t_plan.max()) - t >= SHORTEST - TICK:
                compared.append(t)
    if not off:
        return None
    otherwise = cycle * sum(off)
    gaps = np.diff([float(made[0]), *compared, float(made[-1])])
    return otherwise if otherwise > ALIKE or gaps.max() <= UNPLANNED + cycle + TICK else None
