"""What a re-simulation gives: tracks, scenarios, errors, and what the report files hold of them."""

from __future__ import annotations

import importlib.metadata
import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np
import pandas as pd

import resim
from resim import fidelity
from resim.assess.unseen import Doubts
from resim.core.errors import ResimError
from resim.core.finding import Finding
from resim.core.geometry import Floats, wrap_angle
from resim.core.tracks import Tracks
from resim.fidelity import EGO_ROW, QUANTITIES, STEPS, TO_ROWS, Errors
from resim.ingest import Recording
from resim.ingest.folder import PLAN_COLUMNS
from resim.ingest.settings import Settings
from resim.pipeline.perceived import (
    PerceivedRun,
    Perceiving,
    difference,
    end_error,
    same_decision,
    seed_reports,
)
from resim.pipeline.reaction import ego_tracks, reaction_spread
from resim.road.opendrive import RoadNetwork
from resim.scenario.scenario import Scenario
from resim.sim.adfunction import Build, Perceived
from resim.sim.loop import RELAXATION
from resim.sim.run import Run

Basis = Literal["GT", "SD"]


@dataclass(frozen=True)
class Options:
    """How to re-simulate: basis of the scenarios, step and lead-in [s], seed, and when to end."""

    bases: tuple[Basis, ...] = ("GT", "SD")
    step: float = 0.04
    relaxation: float = RELAXATION
    seed: int = 0
    stop_at_collision: bool = True
    gui: bool = False

    def __post_init__(self) -> None:
        if not 0.0 < self.step <= 1.0:
            raise ResimError(f"step {self.step:g} s: expected more than 0 and at most 1 s")
        if not 0.0 <= self.relaxation <= 60.0:
            raise ResimError(f"relaxation {self.relaxation:g} s: expected 0 to 60 s")


@dataclass(frozen=True, eq=False)
class Branch:
    """What was run on one basis, and the run's scenario.

    refit is None where the run ended before there was anything to describe.
    """

    run: Run
    refit: Scenario | None


def scenarios_of(
    described: Mapping[Basis, Scenario], branches: Mapping[Basis, Branch]
) -> dict[str, Scenario]:
    """Give the scenarios by what they describe: GT, SD, rGT, rSD."""
    out = {str(basis): scenario for basis, scenario in described.items()}
    return out | {f"r{basis}": b.refit for basis, b in branches.items() if b.refit is not None}


def tracks_of(measured: Mapping[Basis, Tracks], branches: Mapping[Basis, Branch]) -> dict[str, Tracks]:
    """Give the tracks by source: GT, SD, rGT, rSD."""
    out = {str(basis): tracks for basis, tracks in measured.items()}
    return out | {f"r{basis}": branch.run.truth for basis, branch in branches.items()}


@dataclass(frozen=True, eq=False)
class Resimulation:
    """A re-simulated recording: what was measured and described, the branches that were run, and the errors.

    measured holds GT, and SD where there is one, as long as the EGO is there; described and branches by basis,
    GT always described; doubts: what each measurement leaves open; misfits: by source a line that names the objects
    whose traces are not where they were.
    """

    recording: Recording
    build: Build
    options: Options
    network: RoadNetwork
    measured: Mapping[Basis, Tracks]
    described: Mapping[Basis, Scenario]
    branches: Mapping[Basis, Branch]
    errors: Mapping[str, Errors]
    warnings: tuple[str, ...]
    times: Mapping[str, float]
    hashes: Mapping[str, str]
    perceiving: Perceiving | None = None
    perceived_runs: tuple[PerceivedRun, ...] = ()
    doubts: Mapping[Basis, Doubts] = field(default_factory=dict)
    misfits: Mapping[str, str] = field(default_factory=dict)

    @property
    def ego(self) -> str:
        """The EGO's id."""
        return self.recording.ego

    @property
    def failure(self) -> str:
        """Why the function failed, and in which run, or ""."""
        whys = {f"r{basis}": b.run.failure for basis, b in self.branches.items() if b.run.failure}
        whys |= {f"rGT+M, seed {p.seed}": p.run.failure for p in self.perceived_runs if p.run.failure}
        return "; ".join(f"{name}: {why}" for name, why in whys.items())

    def scenarios(self) -> dict[str, Scenario]:
        """Give the scenarios by what they describe: GT, SD, rGT, rSD."""
        return scenarios_of(self.described, self.branches)

    def tracks(self) -> dict[str, Tracks]:
        """Give the tracks by source: GT, SD, rGT, rSD."""
        return tracks_of(self.measured, self.branches)

    def driven(self) -> dict[str, Tracks | None]:
        """Give how the EGO drove in GT, rGT and rSD, with accelerations: as splines have it, of all alike."""
        made = self.scenarios()
        return {
            name: ego_tracks(made[name], self.network) if name in made else None
            for name in ("GT", "rGT", "rSD")
        }

    @cached_property
    def reaction_spread(self) -> float | None:
        """Give how far [s] first braking in GT is off in two of three cases, and with it each difference from it."""
        return reaction_spread(self.measured["GT"], self.described["GT"], self.network)

    def tracks_frame(self) -> pd.DataFrame:
        """Give all tracks, and what the function perceived in map coordinates, as one table by `source`."""
        parts = [tracks.to_frame().assign(source=source) for source, tracks in self.tracks().items()]
        parts += [
            perceived_frame(branch.run.perceived).assign(source=f"perceived_r{basis}")
            for basis, branch in self.branches.items()
        ]
        for p in self.perceived_runs:  # the traffic is that of rGT
            parts.append(p.run.truth.select([self.ego]).to_frame().assign(source=f"rGT+M{p.seed}"))
            parts.append(perceived_frame(p.run.perceived).assign(source=f"perceived_rGT+M{p.seed}"))
        table = pd.concat(parts, ignore_index=True)
        return table[["source", *(c for c in table.columns if c != "source")]]

    def answers_frame(self) -> pd.DataFrame:
        """Give the function's answers, one row each, by `source` rGT, rSD, and rGT+M with its seed.

        acceleration [m/s²] and curvature [1/m] that acted from t on, NaN for an oracle; objects that it perceived.
        """
        parts = []
        for source, run in self._runs().items():
            t = np.array([p.t for p in run.perceived])
            step = np.clip(np.searchsorted(run.truth.t, t - 1e-9), 0, max(len(run.truth.t) - 1, 0))
            acceleration, curvature = run.commands[step].T if len(t) else np.empty((2, 0))
            counts = np.array([len(p.ids) for p in run.perceived], dtype=int)
            columns = {"t": t, "acceleration": acceleration, "curvature": curvature, "objects": counts}
            parts.append(pd.DataFrame({"source": source, **columns}))
        return pd.concat(parts, ignore_index=True)

    def plans_frame(self) -> pd.DataFrame:
        """Give the EGO's plans by `source`: recorded, rGT, rSD, rGT+M with its seed; a row per `t` and `t_plan` [s]."""
        made = plan_frame({source: run.plans for source, run in self._runs().items()})
        if self.recording.plan is None:
            return made
        recorded = self.recording.plan[list(PLAN_COLUMNS)].assign(source="recorded")
        return pd.concat([recorded, made], ignore_index=True)[["source", *PLAN_COLUMNS]]

    def _runs(self) -> dict[str, Run]:
        """The runs by source: rGT, rSD, and rGT+M with its seed."""
        runs = {f"r{basis}": branch.run for basis, branch in self.branches.items()}
        return runs | {f"rGT+M{p.seed}": p.run for p in self.perceived_runs}

    def report(self) -> dict[str, Any]:
        """Give what report.json holds."""
        runs = {f"r{basis}": b.run for basis, b in self.branches.items()}
        driven = self.driven()
        reaction = {
            b: None if t is None else fidelity.reaction_time(t, ego=self.ego) for b, t in driven.items()
        }
        decision = {
            b: None if t is None else fidelity.decision(t, self.network, ego=self.ego)
            for b, t in driven.items()
        }
        hits = {name: fidelity.collisions(tracks, ego=self.ego) for name, tracks in self.tracks().items()}
        return {
            "recording": self.recording.name,
            "map": self.recording.map.name,
            "ego": self.ego,
            "build": {
                "name": self.build.name,
                "version": self.build.version,
                "drove": drove(self.recording, self.build),
            },
            "errors": {step: self._statistics(step) for step in STEPS},
            "sums": fidelity.sums(self.errors),
            "reaction": reaction,
            "reaction_difference": {b: difference(reaction[b], reaction["GT"]) for b in ("rGT", "rSD")},
            "reaction_spread": self.reaction_spread,
            "decision": decision,
            "collision": {name: bool(h) for name, h in hits.items()},
            "collisions": {name: [{"t": t, "id": i} for t, i in h] for name, h in hits.items()},
            "end": {name: run.end for name, run in runs.items()},
            "failure": {name: run.failure or None for name, run in runs.items()},
            "end_position_error": {
                f"r{basis}": end_error(b.run.end, self.errors.get(f"PIPE_{basis}"))
                for basis, b in self.branches.items()
            },
            "perception": self._perception(decision["GT"], reaction["GT"]),
            "warnings": list(self.warnings),
            "findings": [finding_json(f) for f in self.recording.findings],
            "repaired": self.recording.repaired,
            "doubts": {basis: found.to_json() for basis, found in self.doubts.items()},
        }

    def _perception(self, decision: list[str] | None, reaction: float | None) -> dict[str, Any] | None:
        """What the runs with a perception model gave; `decision` and `reaction` [s] of the measured drive."""
        if self.perceiving is None:
            return None
        model = self.perceiving.model
        seeds = seed_reports(self.perceived_runs, self.network, ego=self.ego, measured=reaction)
        return {
            "model": {
                "name": model.name,
                "hash": self.perceiving.hash,
                "set": list(self.perceiving.overrides),
            },
            "same_decision": same_decision(seeds, decision),
            "seeds": seeds,
        }

    def provenance(self) -> dict[str, Any]:
        """Give what run.json holds: versions, hashes, seeds, times."""
        packages = ("numpy", "scipy", "pandas", "shapely", "duckdb", "libsumo", "eclipse-sumo")
        return {
            "versions": {
                "resim": resim.__version__,
                "python": platform.python_version(),
                **{p: importlib.metadata.version(p) for p in packages},
            },
            "hashes": dict(self.hashes),
            "seed": self.options.seed,
            "step": self.options.step,
            "relaxation": self.options.relaxation,
            "stop_at_collision": self.options.stop_at_collision,
            "perception": self._perception_provenance(),
            "control_error": {f"r{basis}": b.run.control_error for basis, b in self.branches.items()},
            "times": dict(self.times),
        }

    def _perception_provenance(self) -> dict[str, Any] | None:
        if self.perceiving is None:
            return None
        seeds = [
            {"seed": p.seed, "time": p.time, "failure": p.run.failure or None} for p in self.perceived_runs
        ]
        return {"set": list(self.perceiving.overrides), "seeds": seeds}

    def _statistics(self, step: str) -> dict[str, dict[str, fidelity.Statistics | None]]:
        errors = self.errors.get(step)
        if errors is None:
            return {who: dict.fromkeys(QUANTITIES) for who in ("ego", "to")}
        return {"ego": errors.statistics(EGO_ROW), "to": errors.statistics(TO_ROWS)}


def plan_frame(plans: Mapping[str, Sequence[tuple[float, Floats]]]) -> pd.DataFrame:
    """Give plans by source as one table: source, and PLAN_COLUMNS."""
    every = [(source, when, plan) for source, made in plans.items() for when, plan in made]
    counts = [len(plan) for _, _, plan in every]
    rows = np.concatenate([np.empty((0, 4)), *(plan for _, _, plan in every)])
    made_at = np.repeat([when for _, when, _ in every], counts)
    columns = dict(zip(PLAN_COLUMNS, (made_at, *rows.T), strict=True))
    return pd.DataFrame(
        {"source": np.repeat([source for source, _, _ in every], counts).astype(str), **columns}
    )


def drove(recording: Recording | Settings, build: Build) -> bool | None:
    """Say whether this build drove the recording, None where the recording does not say what did."""
    if not recording.build:
        return None
    return recording.build == build.label and recording.build_hash in (None, build.hash)


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


def perceived_frame(perceived: tuple[Perceived, ...]) -> pd.DataFrame:
    """Give perceived lists as a table in map coordinates, one row per time and object."""
    if not perceived:
        return pd.DataFrame({"t": [], "id": []})
    counts = [len(p.ids) for p in perceived]
    positions = [p.map_positions() for p in perceived]

    def column(name: str) -> np.ndarray[Any, Any]:
        return np.concatenate([getattr(p, name) for p in perceived])

    return pd.DataFrame(
        {
            "t": np.repeat([p.t for p in perceived], counts),
            "id": column("ids"),
            "x": np.concatenate([x for x, _ in positions]),
            "y": np.concatenate([y for _, y in positions]),
            "heading": wrap_angle(
                column("heading_ego") + np.repeat([p.ego.heading for p in perceived], counts)
            ),
            "v": column("v"),
            "length": column("length"),
            "width": column("width"),
            "kind": column("kind"),
        }
    )
