"""One recording, one build: describe, re-simulate, describe again, compare. What every command calls."""

from __future__ import annotations

import hashlib
import importlib.metadata
import platform
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd

import resim
from resim import fidelity
from resim.core.errors import ResimError
from resim.core.geometry import wrap_angle
from resim.core.tracks import Tracks
from resim.fidelity import EGO_ROW, QUANTITIES, STEPS, TO_ROWS, Errors
from resim.ingest import Recording
from resim.road.opendrive import RoadNetwork, load
from resim.road.sumo import SumoNet, sumo_net
from resim.scenario.scenario import Scenario, describe
from resim.sim.adfunction import Build, Perceived
from resim.sim.dynamics import VehicleModel
from resim.sim.loop import simulate
from resim.sim.run import Run

Basis = Literal["GT", "SD"]
Progress = Callable[[str], None]


@dataclass(frozen=True)
class Options:
    """How to re-simulate: basis of the scenarios, step and lead-in [s], seed, and when to end."""

    bases: tuple[Basis, ...] = ("GT", "SD")
    step: float = 0.04
    relaxation: float = 3.0
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
    """One basis through the chain: what was measured, its scenario, its run, and the run's scenario.

    refit is None where the run ended before there was anything to describe.
    """

    measured: Tracks
    scenario: Scenario
    run: Run
    refit: Scenario | None


@dataclass(frozen=True, eq=False)
class Resimulation:
    """A re-simulated recording: the branches by basis, and the errors of every step that there is."""

    recording: Recording
    build: Build
    options: Options
    network: RoadNetwork
    branches: Mapping[Basis, Branch]
    errors: Mapping[str, Errors]
    warnings: tuple[str, ...]
    times: Mapping[str, float]
    hashes: Mapping[str, str]

    @property
    def ego(self) -> str:
        """The EGO's id."""
        return self.recording.ego

    @property
    def failure(self) -> str:
        """Why the function failed, or ""."""
        return "; ".join(b.run.failure for b in self.branches.values() if b.run.failure)

    def scenarios(self) -> dict[str, Scenario]:
        """Give the scenarios by what they describe: GT, SD, rGT, rSD."""
        out = {str(basis): branch.scenario for basis, branch in self.branches.items()}
        return out | {f"r{basis}": b.refit for basis, b in self.branches.items() if b.refit is not None}

    def tracks(self) -> dict[str, Tracks]:
        """Give the tracks by source: GT, SD, rGT, rSD."""
        out = {str(basis): branch.measured for basis, branch in self.branches.items()}
        return out | {f"r{basis}": branch.run.truth for basis, branch in self.branches.items()}

    def driven(self) -> dict[str, Tracks | None]:
        """Give how the EGO drove, with accelerations: in GT by its splines, in rGT and rSD as simulated."""
        gt, runs = self.branches.get("GT"), {b: branch.run.truth for b, branch in self.branches.items()}
        measured = None
        if gt is not None:
            begin = gt.scenario.ego.spawn_time
            t = np.round(np.arange(begin, begin + gt.scenario.duration, 0.01), 9)
            measured = gt.scenario.tracks(self.network, t)
        return {"GT": measured, "rGT": runs.get("GT"), "rSD": runs.get("SD")}

    def tracks_frame(self) -> pd.DataFrame:
        """Give all tracks, and what the function perceived in map coordinates, as one table by `source`."""
        parts = [tracks.to_frame().assign(source=source) for source, tracks in self.tracks().items()]
        parts += [
            perceived_frame(branch.run.perceived).assign(source=f"perceived_r{basis}")
            for basis, branch in self.branches.items()
        ]
        table = pd.concat(parts, ignore_index=True)
        return table[["source", *(c for c in table.columns if c != "source")]]

    def report(self) -> dict[str, Any]:
        """Give what report.json holds."""
        runs = {f"r{basis}": b.run for basis, b in self.branches.items()}
        driven = self.driven()
        reaction = {
            b: None if t is None else fidelity.reaction_time(t, ego=self.ego) for b, t in driven.items()
        }
        hits = {name: fidelity.collisions(tracks, ego=self.ego) for name, tracks in self.tracks().items()}
        return {
            "recording": self.recording.name,
            "map": self.recording.map.name,
            "ego": self.ego,
            "build": {"name": self.build.name, "version": self.build.version, "drove": self._drove()},
            "errors": {step: self._statistics(step) for step in STEPS},
            "sums": fidelity.sums(self.errors),
            "reaction": reaction,
            "reaction_difference": {b: _minus(reaction[b], reaction["GT"]) for b in ("rGT", "rSD")},
            "decision": {
                b: None if t is None else fidelity.decision(t, self.network, ego=self.ego)
                for b, t in driven.items()
            },
            "collision": {name: bool(h) for name, h in hits.items()},
            "collisions": {name: [{"t": t, "id": i} for t, i in h] for name, h in hits.items()},
            "end": {name: run.end for name, run in runs.items()},
            "failure": {name: run.failure or None for name, run in runs.items()},
            "warnings": list(self.warnings),
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
            "control_error": {f"r{basis}": b.run.control_error for basis, b in self.branches.items()},
            "times": dict(self.times),
        }

    def _drove(self) -> bool | None:
        return None if not self.recording.build else not _another_build(self.recording, self.build)

    def _statistics(self, step: str) -> dict[str, dict[str, fidelity.Statistics | None]]:
        errors = self.errors.get(step)
        if errors is None:
            return {who: dict.fromkeys(QUANTITIES) for who in ("ego", "to")}
        return {"ego": errors.statistics(EGO_ROW), "to": errors.statistics(TO_ROWS)}


def _minus(later: float | None, earlier: float | None) -> float | None:
    return None if later is None or earlier is None else round(later - earlier, 9)


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


@dataclass
class _Clock:
    """Wall-clock times of the stages, and who wants to hear of them."""

    progress: Progress
    times: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        self.progress(name)
        begin = time.perf_counter()
        yield
        self.times[name] = time.perf_counter() - begin


STAGES = ("map", "fit GT", "run GT", "fit rGT", "fit SD", "run SD", "fit rSD", "errors")
"""What `resimulate` tells its progress, in order, as far as the bases ask for it."""


def resimulate(
    recording: Recording,
    build: Build,
    options: Options = Options(),
    *,
    model: VehicleModel | None = None,
    progress: Progress = lambda stage: None,
) -> Resimulation:
    """Re-simulate a recording with a build, on each basis that the recording has, and compare every step."""
    clock = _Clock(progress)
    with clock.stage("map"):
        network = load(recording.map)
        net = sumo_net(network)
    measured: dict[Basis, Tracks] = {"GT": ego_window(recording.gt, recording.ego)}
    if (sd := recording.sd_by_gt()) is not None:
        measured["SD"] = ego_window(sd, recording.ego)
    branches: dict[Basis, Branch] = {}
    for basis in options.bases:
        if basis in measured:
            branches[basis] = _branch(
                basis, measured[basis], recording, build, network, net, options, model, clock
            )
    with clock.stage("errors"):
        errors = _errors(branches, measured, network, recording.ego)
    return Resimulation(
        recording=recording,
        build=build,
        options=options,
        network=network,
        branches=branches,
        errors=errors,
        warnings=tuple(_warnings(recording, build, net, measured, branches)),
        times=clock.times,
        hashes={
            "build": build.hash,
            "map": file_hash(recording.map),
            "net": net.hash,
            **_recording_hashes(recording),
        },
    )


def ego_window(tracks: Tracks, ego: str) -> Tracks:
    """Give the tracks as long as the EGO is there."""
    first, last = (float(times[tracks.index(ego)]) for times in tracks.span())
    return tracks.window(first, last)


def _branch(
    basis: Basis,
    measured: Tracks,
    recording: Recording,
    build: Build,
    network: RoadNetwork,
    net: SumoNet,
    options: Options,
    model: VehicleModel | None,
    clock: _Clock,
) -> Branch:
    def described(tracks: Tracks, what: str) -> Scenario:
        return describe(
            tracks, network, ego=recording.ego, map_name=recording.map.name,
            description=f"{recording.name}: {what}", environment=recording.environment,
        )  # fmt: skip

    with clock.stage(f"fit {basis}"):
        scenario = described(measured, basis)
    with clock.stage(f"run {basis}"):
        run = simulate(
            scenario, network, net.path, build, step=options.step, relaxation=options.relaxation, seed=options.seed,
            model=model, stop_at_collision=options.stop_at_collision, gui=options.gui,
        )  # fmt: skip
    with clock.stage(f"fit r{basis}"):
        enough = run.truth.valid[0].sum() >= 2
        refit = described(run.truth, f"r{basis}") if enough else None
    return Branch(measured, scenario, run, refit)


def _errors(
    branches: Mapping[Basis, Branch], measured: Mapping[Basis, Tracks], network: RoadNetwork, ego: str
) -> dict[str, Errors]:
    gt = measured["GT"]
    out: dict[str, Errors] = {}
    if "SD" in measured:
        out["S"] = fidelity.sensor_error(gt, measured["SD"], ego=ego)
    for basis, b in branches.items():
        out[f"FIT_{basis}"] = fidelity.fit_error(b.scenario, b.measured, network)
        out[f"SIM_{basis}"] = fidelity.simulation_error(b.run.truth, b.scenario, network)
        if b.refit is not None:
            out[f"FIT_r{basis}"] = fidelity.fit_error(b.refit, b.run.truth, network)
            out[f"PIPE_{basis}"] = fidelity.pipeline_error(b.refit, gt, network)
    return {step: out[step] for step in STEPS if step in out}


def _warnings(
    recording: Recording,
    build: Build,
    net: SumoNet,
    measured: Mapping[Basis, Tracks],
    branches: Mapping[Basis, Branch],
) -> Iterator[str]:
    if net.remark:
        yield f"{recording.map.name}: {net.remark}"
    if recording.build and (other := _another_build(recording, build)):
        yield f"{other} drove the recording, not {build.label}: EGO differences are those of two builds"
    for basis, branch in branches.items():
        described = {branch.scenario.ego.id, *(o.id for o in branch.scenario.objects)}
        if lost := sorted(set(branch.measured.ids.tolist()) - described):
            yield f"{basis}: seen only once and left out: {', '.join(lost)}"
        if branch.run.end in ("collision", "off_road"):
            yield f"r{basis} ended at t = {branch.run.truth.t[-1]:.2f} s: {branch.run.end.replace('_', ' ')}"
        if branch.run.failure:
            yield f"r{basis}: AD function failed: {branch.run.failure}"
    if "SD" in measured:
        unknown = [i for i in measured["SD"].ids.tolist() if i not in set(measured["GT"].ids.tolist())]
        if unknown:
            yield f"SD holds {len(unknown)} object(s) without ground truth: no errors for them, but rSD has them"


def _another_build(recording: Recording, build: Build) -> str:
    """What drove the recording, if it was not this build."""
    if recording.build != build.label:
        return recording.build or ""
    same = recording.build_hash in (None, build.hash)
    return "" if same else f"another state of {build.label} (hash {str(recording.build_hash)[:12]})"


def file_hash(path: Path) -> str:
    """Give the SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _recording_hashes(recording: Recording) -> dict[str, str]:
    if recording.folder is None:
        return {}
    names = ("recording.toml", "gt.csv", "gt.parquet", "sd.csv", "sd.parquet")
    return {name: file_hash(recording.folder / name) for name in names if (recording.folder / name).is_file()}
