"""What report.json and run.json say of a re-simulation."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeVar

from resim.core.finding import Finding
from resim.core.provenance import versions
from resim.core.spec import EXACT
from resim.metrics.doubts.unseen import Doubts
from resim.resimulation import fidelity
from resim.resimulation.decision import decision as ego_decision
from resim.resimulation.fidelity import EGO_ROW, QUANTITIES, STEPS, TO_ROWS, Statistics
from resim.resimulation.perceived import difference, end_error, same_decision
from resim.resimulation.reaction import ego_tracks
from resim.resimulation.result import Resimulation, is_recorded_build, of_seed, pipeline_step
from resim.scenario import maneuvers
from resim.simulation.case import Collision, End, HandedOver
from resim.simulation.reactive.settings import ReactiveSettings

T = TypeVar("T")
ByQuantity = Mapping[str, Statistics | None]
"""Statistics of d [m], v [m/s] and heading [rad], None where there is no sample."""


@dataclass(frozen=True)
class BuildReport:
    """The build: name, version, and whether it drove the recording (None: the recording does not say)."""

    name: str
    version: str
    drove: bool | None


@dataclass(frozen=True)
class ModelReport:
    """The perception model: name, hash of its file, and the parameters that were set by hand."""

    name: str
    hash: str
    set: tuple[str, ...]


@dataclass(frozen=True)
class SeedReport:
    """A drive with the perception model; fields as in `RunReport`.

    outside_validity: how many of the objects `shown` were outside of what the model was trained for.
    """

    seed: int
    decision: tuple[str, ...]
    reaction: float | None
    reaction_difference: float | None
    errors: Mapping[str, ByQuantity | None]
    end_position_error: float | None
    end: End
    failure: str | None
    left_route: float | None
    collision: bool
    collisions: tuple[Collision, ...]
    outside_validity: int
    shown: int


@dataclass(frozen=True)
class PerceptionReport:
    """The drives with a perception model; same_decision: how many decide as the measured drive, and last to the end."""

    model: ModelReport
    same_decision: int
    seeds: tuple[SeedReport, ...]


@dataclass(frozen=True)
class RunReport:
    """What report.json says. Times are in s, by source (GT, SD, rGT, rSD) where they are several.

    Attributes:
        recording: Name of the recording.
        map: Name of the map's file.
        ego: Id of the EGO.
        build: The AD function.
        errors: By step, "ego" or "to", and quantity.
        sums: Whether the steps add up to PIPE (`fidelity.sums`).
        reaction: First braking.
        reaction_difference: First braking minus that in GT.
        reaction_spread: How uncertain that difference is.
        decision: What the EGO did, None where it is not known.
        collision: Whether the EGO collided.
        collisions: With whom the EGO collided.
        end: What ended a run.
        failure: Why the function failed in a run.
        handed_over: Which traffic objects left their traces, when and why, by run.
        left_route: When the EGO left the roads and connections that the measured EGO took, None where it did not.
        end_position_error: Distance [m] from the measured EGO at the end.
        perception: The runs with a perception model, None where there are none.
        warnings: What to know to believe the results.
        findings: What is wrong with the recording, worst first.
        repaired: Samples by source and code of the finding.
        doubts: What GT and SD leave open.
    """

    __pydantic_config__ = EXACT

    recording: str
    map: str
    ego: str
    build: BuildReport
    errors: Mapping[str, Mapping[str, ByQuantity]]
    sums: Mapping[str, Mapping[str, Mapping[str, Mapping[str, float]]]]
    reaction: Mapping[str, float | None]
    reaction_difference: Mapping[str, float | None]
    reaction_spread: float | None
    decision: Mapping[str, tuple[str, ...] | None]
    collision: Mapping[str, bool]
    collisions: Mapping[str, tuple[Collision, ...]]
    end: Mapping[str, End]
    failure: Mapping[str, str | None]
    handed_over: Mapping[str, tuple[HandedOver, ...]]
    left_route: Mapping[str, float | None]
    end_position_error: Mapping[str, float | None]
    perception: PerceptionReport | None
    warnings: tuple[str, ...]
    findings: tuple[Finding, ...]
    repaired: Mapping[str, Mapping[str, int]]
    doubts: Mapping[str, Doubts]


def report(result: Resimulation) -> RunReport:
    """Report on a re-simulation; `Resimulation.report` keeps it."""
    simulated, driven, ego = result.simulated(), result.driven(), result.ego
    reaction = {b: None if t is None else maneuvers.reaction_time(t, ego=ego) for b, t in driven.items()}
    decision = {
        b: None if t is None else tuple(ego_decision(t, result.network, ego, simulated.get(b)))
        for b, t in driven.items()
    }
    hits = {name: fidelity.collisions(tracks, ego=ego) for name, tracks in result.tracks().items()}
    return RunReport(
        recording=result.recording.name,
        map=result.recording.map.name,
        ego=ego,
        build=BuildReport(
            result.build.name, result.build.version, is_recorded_build(result.recording, result.build)
        ),
        errors={step: _statistics(result, step) for step in STEPS},
        sums=fidelity.sums(result.errors),
        reaction=reaction,
        reaction_difference={b: difference(reaction[b], reaction["GT"]) for b in ("rGT", "rSD")},
        reaction_spread=result.reaction_spread,
        decision=decision,
        collision={name: bool(h) for name, h in hits.items()},
        collisions={name: tuple(Collision(t, i) for t, i in h) for name, h in hits.items()},
        end={name: drive.end for name, drive in simulated.items()},
        failure={name: drive.failure or None for name, drive in simulated.items()},
        handed_over={name: drive.handed_over for name, drive in simulated.items()},
        left_route={name: drive.left_route for name, drive in simulated.items()},
        end_position_error={
            name: end_error(drive, result.errors.get(pipeline_step(name)))
            for name, drive in simulated.items()
        },
        perception=_perception(result, decision["GT"], reaction["GT"]),
        warnings=result.warnings,
        findings=result.recording.findings,
        repaired=result.recording.repaired,
        doubts={str(basis): found for basis, found in result.prepared.doubts.items()},
    )


def _perception(
    result: Resimulation, decision: tuple[str, ...] | None, reaction: float | None
) -> PerceptionReport | None:
    """What the drives with a perception model gave; `decision` and `reaction` [s] of the measured drive."""
    if result.perceiving is None:
        return None
    given = result.perceiving
    seeds = tuple(_seed(result, seed, reaction) for seed in result.seeds)
    return PerceptionReport(
        ModelReport(given.model.name, given.hash, given.overrides),
        same_decision(((s.decision, s.end, s.failure) for s in seeds), decision),
        seeds,
    )


def _seed(result: Resimulation, seed: int, measured: float | None) -> SeedReport:
    """What one of these drives gave; measured: reaction [s] of the measured drive."""
    ego, (drive, refit, pipe) = result.ego, result.of(seed)
    driven = None if refit is None else ego_tracks(refit, result.network)
    reaction = None if driven is None else maneuvers.reaction_time(driven, ego=ego)
    return SeedReport(
        seed=seed,
        decision=() if driven is None else tuple(ego_decision(driven, result.network, ego, drive)),
        reaction=reaction,
        reaction_difference=difference(reaction, measured),
        errors={"PIPE": None if pipe is None else pipe.statistics(EGO_ROW)},
        end_position_error=end_error(drive, pipe),
        end=drive.end,
        failure=drive.failure or None,
        left_route=drive.left_route,
        collision=bool(drive.collisions),
        collisions=drive.collisions,
        outside_validity=drive.outside,
        shown=drive.shown,
    )


@dataclass(frozen=True)
class SeedProvenance:
    """A drive with the perception model: how long it took [s], and why the function failed in it, or None."""

    seed: int
    time: float
    failure: str | None


@dataclass(frozen=True)
class FailureProvenance:
    """Why the function failed in a drive.

    traceback: where it raised, a line a call, from its own file on. last_words: the end of what the failed call, or a
    process that it started, wrote to the standard error.
    """

    reason: str
    traceback: tuple[str, ...]
    last_words: str | None


@dataclass(frozen=True)
class PerceptionProvenance:
    """The parameters of the perception model that were set by hand, and its drives."""

    set: tuple[str, ...]
    seeds: tuple[SeedProvenance, ...]


@dataclass(frozen=True)
class RunProvenance:
    """What run.json says: what a re-simulation was made from and by.

    hashes: of all inputs. cases: of all that is simulated, by drive. step, lead_in: s. control_error: largest distance
    [m] between where a vehicle was commanded to be and where the engine had it. times: s of wall clock by stage.
    failures: of the function, by drive. files: hashes of what was written.
    """

    __pydantic_config__ = EXACT

    versions: Mapping[str, str]
    hashes: Mapping[str, str]
    cases: Mapping[str, str]
    engine: str
    vehicle: str
    seed: int
    step: float
    lead_in: float
    stop_at_collision: bool
    traffic: ReactiveSettings | None
    perception: PerceptionProvenance | None
    control_error: Mapping[str, float]
    times: Mapping[str, float]
    failures: Mapping[str, FailureProvenance]
    files: Mapping[str, str]


def provenance(result: Resimulation, files: Mapping[str, str]) -> RunProvenance:
    """Give what run.json says. files: hashes of what was written, by name."""
    options = result.options
    return RunProvenance(
        versions={**versions(), "python": platform.python_version()},
        hashes=result.hashes,
        cases={name: drive.case.hash for name, drive in result.drives.items()},
        engine=options.engine.name,
        vehicle=options.vehicle,
        seed=options.seed,
        step=options.step,
        lead_in=options.lead_in,
        stop_at_collision=options.stop_at_collision,
        traffic=options.traffic,
        perception=_perception_provenance(result),
        control_error={name: drive.control_error for name, drive in result.simulated().items()},
        times=result.times,
        failures={
            name: FailureProvenance(drive.failure, drive.traceback, drive.last_words or None)
            for name, drive in result.drives.items()
            if drive.failure
        },
        files=files,
    )


def _perception_provenance(result: Resimulation) -> PerceptionProvenance | None:
    if result.perceiving is None:
        return None
    drives = {seed: result.drives[of_seed(seed)] for seed in result.seeds}
    seeds = tuple(SeedProvenance(seed, d.time, d.failure or None) for seed, d in drives.items())
    return PerceptionProvenance(result.perceiving.overrides, seeds)


def _statistics(result: Resimulation, step: str) -> Mapping[str, ByQuantity]:
    errors = result.errors.get(step)
    if errors is None:
        return {who: dict.fromkeys(QUANTITIES) for who in ("ego", "to")}
    return {"ego": errors.statistics(EGO_ROW), "to": errors.statistics(TO_ROWS)}
