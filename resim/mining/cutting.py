"""Scenarios as recordings and JSCEN files: what is mined goes straight into `resim run`, a suite, a sweep."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from resim.core.errors import ResimError
from resim.core.tracks import Tracks
from resim.mining.extraction import ExtractedScenario
from resim.recordings import Recording, write_recording
from resim.road.opendrive import RoadNetwork
from resim.scenario.jscen import write_jscen
from resim.scenario.scenario import describe

LEAST = 2
"""Samples of the EGO that a recording needs."""


def cut(recording: Recording, one: ExtractedScenario, name: str, about: str) -> Recording:
    """Give a scenario as a recording: the window of GT with EGO and members, and of SD and plans where there are any.

    A recording needs its EGO at all times: it is the part of the window in which it is there. Times begin at 0.
    about: for its provenance. Raises ResimError where the EGO has fewer than two samples there.
    """
    gt = recording.gt
    steps = np.arange(one.ego_start, one.ego_end + 1)
    steps = steps[gt.valid[one.ego, steps]]
    if len(steps) < LEAST:
        raise ResimError("the EGO has fewer than two samples in it")
    rows = [one.ego, *one.members]
    part = gt.select(gt.ids[rows]).samples(steps)
    part = part.select(part.ids[part.valid.any(axis=1)])
    start, end = float(part.t[0]), float(part.t[-1])
    ego = str(gt.ids[one.ego])
    sd, sd_gt_id, existence = _sensor_data(recording, set(part.ids.tolist()), start, end)
    plan = recording.plan
    own_drive = ego == recording.ego
    if plan is not None and own_drive:
        plan = plan[(plan["t"] >= start - 1e-9) & (plan["t"] <= end + 1e-9)]
        plan = plan.assign(t=plan["t"] - start, t_plan=plan["t_plan"] - start).reset_index(drop=True)
    told = {"mined_from": recording.name, "mined": about, "original_start_s": f"{start:.9g}"}
    return Recording(
        name=name, map=recording.map, ego=ego, gt=part.shifted(-start), gt_rate=recording.gt_rate,
        sd=sd, sd_rate=recording.sd_rate if sd is not None else None, sd_gt_id=sd_gt_id,
        existence_probability=existence,
        build=recording.build if own_drive else None, build_hash=recording.build_hash if own_drive else None,
        plan=plan if own_drive and plan is not None and len(plan) else None,
        environment=recording.environment,
        provenance={**recording.provenance, **told},
    )  # fmt: skip


def _sensor_data(
    recording: Recording, kept: set[str], start: float, end: float
) -> tuple[Tracks | None, np.ndarray | None, np.ndarray | None]:
    """SD of those kept and of nobody, from start to end [s], with their GT ids and probabilities of existence."""
    sd, names = recording.sd, recording.sd_gt_id
    if sd is None or names is None:
        return None, None, None
    inside = np.flatnonzero((sd.t >= start - 1e-9) & (sd.t <= end + 1e-9))
    if not len(inside):
        return None, None, None
    own = np.array([name in kept or not name for name in names.tolist()], dtype=bool)
    rows = np.flatnonzero(own & sd.valid[:, inside].any(axis=1))
    if not len(rows):
        return None, None, None
    part = sd.select(sd.ids[rows]).samples(inside).shifted(-start)
    existence = recording.existence_probability
    return part, names[rows], None if existence is None else existence[np.ix_(rows, inside)]


def write_cut(scenario: Recording, folder: Path, road: Path) -> None:
    """Write a scenario's recording as a new folder that refers to the map at `road`."""
    write_recording(scenario, folder, map_reference=os.path.relpath(road, folder))


def write_described(scenario: Recording, network: RoadNetwork, file: Path) -> None:
    """Fit a scenario and write it as JSCEN beside its map. Raises ResimError."""
    found = describe(
        scenario.gt, network, ego=scenario.ego, map_name=scenario.map.name,
        description=scenario.provenance["mined"], environment=scenario.environment,
    )  # fmt: skip
    beside = file.with_name(f".{file.name}.{os.getpid()}.new")
    write_jscen(replace(found, map=scenario.map.name), beside)
    beside.replace(file)
