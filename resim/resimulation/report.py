"""What report.json and run.json hold of a re-simulation."""

from __future__ import annotations

import math
import platform
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from resim.core.finding import Finding
from resim.core.provenance import versions
from resim.resimulation import fidelity
from resim.resimulation.fidelity import EGO_ROW, QUANTITIES, STEPS, TO_ROWS
from resim.resimulation.perceived import difference, end_error, same_decision
from resim.resimulation.reaction import ego_tracks
from resim.resimulation.result import Resimulation, is_recorded_build, of_seed, pipeline_step
from resim.scenario import maneuvers


def report(result: Resimulation) -> dict[str, Any]:
    """Give what report.json holds; `Resimulation.report` keeps it."""
    simulated, driven, ego = result.simulated(), result.driven(), result.ego
    reaction = {b: None if t is None else maneuvers.reaction_time(t, ego=ego) for b, t in driven.items()}
    decision = {
        b: None if t is None else maneuvers.decision(t, result.network, ego=ego) for b, t in driven.items()
    }
    hits = {name: fidelity.collisions(tracks, ego=ego) for name, tracks in result.tracks().items()}
    return {
        "recording": result.recording.name,
        "map": result.recording.map.name,
        "ego": ego,
        "build": {
            "name": result.build.name,
            "version": result.build.version,
            "drove": is_recorded_build(result.recording, result.build),
        },
        "errors": {step: _statistics(result, step) for step in STEPS},
        "sums": fidelity.sums(result.errors),
        "reaction": reaction,
        "reaction_difference": {b: difference(reaction[b], reaction["GT"]) for b in ("rGT", "rSD")},
        "reaction_spread": result.reaction_spread,
        "decision": decision,
        "collision": {name: bool(h) for name, h in hits.items()},
        "collisions": {name: [{"t": t, "id": i} for t, i in h] for name, h in hits.items()},
        "end": {name: drive.end for name, drive in simulated.items()},
        "failure": {name: drive.failure or None for name, drive in simulated.items()},
        "end_position_error": {
            name: end_error(drive, result.errors.get(pipeline_step(name)))
            for name, drive in simulated.items()
        },
        "perception": _perception(result, decision["GT"], reaction["GT"]),
        "warnings": list(result.warnings),
        "findings": [finding_json(f) for f in result.recording.findings],
        "repaired": result.recording.repaired,
        "doubts": {basis: found.to_json() for basis, found in result.prepared.doubts.items()},
    }


def _perception(
    result: Resimulation, decision: list[str] | None, reaction: float | None
) -> dict[str, Any] | None:
    """What the drives with a perception model gave; `decision` and `reaction` [s] of the measured drive."""
    if result.perceiving is None:
        return None
    model = result.perceiving.model
    seeds = [_seed(result, seed, reaction) for seed in result.seeds]
    return {
        "model": {
            "name": model.name,
            "hash": result.perceiving.hash,
            "set": list(result.perceiving.overrides),
        },
        "same_decision": same_decision(seeds, decision),
        "seeds": seeds,
    }


def _seed(result: Resimulation, seed: int, measured: float | None) -> dict[str, Any]:
    """What one of these drives gave; measured: reaction [s] of the measured drive."""
    ego, (drive, refit, pipe) = result.ego, result.of(seed)
    driven = None if refit is None else ego_tracks(refit, result.network)
    reaction = None if driven is None else maneuvers.reaction_time(driven, ego=ego)
    return {
        "seed": seed,
        "decision": [] if driven is None else maneuvers.decision(driven, result.network, ego=ego),
        "reaction": reaction,
        "reaction_difference": difference(reaction, measured),
        "errors": {"PIPE": None if pipe is None else pipe.statistics(EGO_ROW)},
        "end_position_error": end_error(drive, pipe),
        "end": drive.end,
        "failure": drive.failure or None,
        "collision": bool(drive.collisions),
        "collisions": [{"t": c.t, "id": c.id} for c in drive.collisions],
        "outside_validity": drive.outside,
        "shown": drive.shown,
    }


def provenance(result: Resimulation) -> dict[str, Any]:
    """Give what run.json holds: versions, hashes, cases, seeds, times."""
    options = result.options
    return {
        "versions": {**versions(), "python": platform.python_version()},
        "hashes": dict(result.hashes),
        "cases": {name: drive.case.hash for name, drive in result.drives.items()},
        "engine": options.engine.name,
        "vehicle": options.vehicle,
        "seed": options.seed,
        "step": options.step,
        "lead_in": options.lead_in,
        "stop_at_collision": options.stop_at_collision,
        "perception": _perception_provenance(result),
        "control_error": {name: drive.control_error for name, drive in result.simulated().items()},
        "times": dict(result.times),
    }


def _perception_provenance(result: Resimulation) -> dict[str, Any] | None:
    if result.perceiving is None:
        return None
    drives = {seed: result.drives[of_seed(seed)] for seed in result.seeds}
    seeds = [{"seed": seed, "time": d.time, "failure": d.failure or None} for seed, d in drives.items()]
    return {"set": list(result.perceiving.overrides), "seeds": seeds}


def _statistics(result: Resimulation, step: str) -> dict[str, dict[str, fidelity.Statistics | None]]:
    errors = result.errors.get(step)
    if errors is None:
        return {who: dict.fromkeys(QUANTITIES) for who in ("ego", "to")}
    return {"ego": errors.statistics(EGO_ROW), "to": errors.statistics(TO_ROWS)}


def finding_json(finding: Finding) -> dict[str, Any]:
    """Give a finding's fields by name; a number that is NaN is None."""
    return _without_nan(asdict(finding))


def finding_of(fields: Mapping[str, Any]) -> Finding:
    """Inverse of `finding_json`. Raises TypeError for what is none."""
    times = {name: math.nan if fields[name] is None else fields[name] for name in ("start", "end", "value")}
    return Finding(**{**fields, **times})


def _without_nan(fields: Mapping[str, Any]) -> dict[str, Any]:
    return {
        name: _without_nan(value) if isinstance(value, Mapping)
        else None if isinstance(value, float) and math.isnan(value) else value
        for name, value in fields.items()
    }  # fmt: skip
