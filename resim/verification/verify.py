"""One recording, one build: may simulation stand in for the drive? (Groh 2018, III.B; Wagner 2021, 5.3.2)."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

from resim.core.errors import ResimError
from resim.metrics.assessment import Assessment
from resim.metrics.criteria import Criteria
from resim.perception.runtime.recorded import RecordedPerception
from resim.recordings import Recording
from resim.recordings.settings import Settings
from resim.resimulation.assessed import AssessmentOptions
from resim.resimulation.assessments import assess_resimulation
from resim.resimulation.compute_outcome import outcomes, rms, seed_outcome
from resim.resimulation.drive_outcome import COMFORT, DriveOutcome, Rms
from resim.resimulation.perceived import PerceptionSetup
from resim.resimulation.result import Resimulation, ResimulationOptions, is_recorded_build
from resim.resimulation.run import over_seeds, resimulate, run_on_gt, with_notes
from resim.simulation.function.interface import Build
from resim.verification.blame import OpenLoopFinding
from resim.verification.cause import Cause, cause
from resim.verification.compare import DriveComparison, SeedVerdict, SimulatedSource, compare
from resim.verification.openloop import open_loop
from resim.verification.result import VerificationResult
from resim.verification.sequential import SequentialTest
from resim.verification.tolerance import Tolerances
from resim.verification.validity_runs import DemandedShare, critical, validity

COMPARED = (*COMFORT, "risk", "collision")
"""Measures that are compared whether criteria ask for them or not."""
UNKNOWN = "unknown"
"""Stands for the build that drove a recording that does not say which did."""


@dataclass(frozen=True, eq=False)
class Demands:
    """What a recording is verified by.

    agreement: more than this share of seeds must agree, as `SequentialTest` tells it. vary: parameters
    (`resim.scenario.variation.PARAMETERS`) whose range is searched in which a verified recording's KPIs stay.
    """

    criteria: Criteria
    tolerances: Tolerances
    agreement: float = 0.9
    vary: tuple[str, ...] = ()

    def how(self, result: Resimulation) -> AssessmentOptions:
        """How drives are assessed: no more than what is compared, and all with the EGO's path from the same source."""
        planned = result.recording.plan is not None and has_plans(result)
        return AssessmentOptions(criteria=self.criteria, only=COMPARED, path="plan" if planned else "state")


def has_plans(result: Resimulation) -> bool:
    """Say whether the function gave plans in every drive; else drives can be compared by the EGO's state alone."""
    return all(drive.plans for drive in result.drives.values())


def may_verify(recording: Recording | Settings, build: Build, driven_by: tuple[str, ...]) -> bool:
    """Say whether a build may be verified on a recording: it drove it, or is an oracle, or was asked for by name.

    driven_by: labels of builds whose recordings are taken for those of `build`, UNKNOWN where none is recorded. The
    method compares what one function did twice.
    """
    return (
        build.needs_truth
        or bool(is_recorded_build(recording, build))
        or (recording.build or UNKNOWN) in driven_by
    )


def verify_recording(
    recording: Recording,
    build: Build,
    demands: Demands,
    options: ResimulationOptions = ResimulationOptions(),
    perceiving: PerceptionSetup | None = None,
    accept: Collection[str] = (),
) -> VerificationResult:
    """Re-simulate a recording and set every re-simulation beside the measured drive.

    The verdict is judged by GT with the perception model, where there is one, else on GT, else on SD. accept: codes of
    errors in the map to continue despite.
    """
    if "GT" not in options.bases and perceiving is None and recording.sd is None:
        raise ResimError(
            f"{recording.folder or recording.name}: has no sensor data, so basis SD has nothing to run"
        )
    result = resimulate(recording, build, options, accept=accept)
    every = iter(()) if perceiving is None else over_seeds(result, perceiving)
    first = next(every, result)
    how = demands.how(first)
    assessed = assess_resimulation(result, how)
    found, errors = outcomes(result, assessed), rms(result.errors)
    judged = _judged(found, errors, demands)
    seeds: dict[int, DriveOutcome] = {}
    if perceiving is not None:
        result, seeds, judged["rGT+M"] = _over_seeds(
            perceiving, chain([first], every), found["GT"], errors, demands, how
        )
    recorded = None
    if any(j.verdict == "not verified" for j in judged.values()):
        recorded = _as_recorded(result, found["GT"], errors, demands, how)
    driven = open_loop(result, demands.tolerances)
    shown = {"rGT": "the truth", "rSD": "the traffic of the sensor data, as smoothed by its splines"}
    if perceiving is not None:
        shown["rGT+M"] = f"what {perceiving.model.name} shows"
    causes: dict[SimulatedSource, Cause | None] = {
        way: cause(j, errors, demands.tolerances, recorded, shown[way], driven, oracle=build.needs_truth)
        for way, j in judged.items()
    }
    of_code = (note for came_to in (*found.values(), *seeds.values()) for note in came_to.asked)
    notes = tuple(dict.fromkeys([*result.warnings, *assessed.notes(), *_driven_otherwise(driven), *of_code]))
    out = VerificationResult(
        result, (first, assessed), found, seeds, errors, judged, causes, recorded, driven, notes=notes
    )
    if demands.vary and out.verdict == "verified":
        asked = () if perceiving is None else perceiving.seeds
        return _varied(out, assessed.blocks["GT"], demands, how, asked)
    return out


def _varied(
    found: VerificationResult,
    measured: Assessment,
    demands: Demands,
    how: AssessmentOptions,
    seeds: Sequence[int],
) -> VerificationResult:
    """Search how far the parameters can be varied, with up to the `seeds` of the verdict; a note says where not."""
    ranges, notes = [], []
    demanded = DemandedShare(seeds, SequentialTest(demands.agreement, len(seeds))) if seeds else None
    for parameter in demands.vary:
        try:
            ranges.append(
                validity(found.result, found.outcomes["GT"], parameter, critical(measured), how, demanded)
            )
        except ResimError as e:
            notes.append(f"{parameter} is not varied: {e}")
    return replace(found, validity=tuple(ranges), notes=(*found.notes, *notes))


def _judged(
    found: Mapping[str, DriveOutcome], errors: Rms, demands: Demands
) -> dict[SimulatedSource, SeedVerdict]:
    ways: tuple[SimulatedSource, ...] = ("rGT", "rSD")
    return {
        way: SeedVerdict(way, (compare(way, found["GT"], found[way], errors, demands.tolerances),))
        for way in ways
        if way in found
    }


def _over_seeds(
    perceiving: PerceptionSetup, every: Iterator[Resimulation], measured: DriveOutcome, errors: Rms, demands: Demands,
    how: AssessmentOptions,
) -> tuple[Resimulation, dict[int, DriveOutcome], SeedVerdict]:  # fmt: skip
    """Take seed after seed until the test of their share has ended."""
    test = SequentialTest(demands.agreement, len(perceiving.seeds))
    seeds: dict[int, DriveOutcome] = {}
    beside: list[DriveComparison] = []
    for result in every:
        seed = result.seeds[-1]
        seeds[seed] = seed_outcome(result, seed, how)
        beside.append(compare("rGT+M", measured, seeds[seed], errors, demands.tolerances))
        judged = SeedVerdict("rGT+M", tuple(beside), test)
        if judged.verdict != "undecided":
            break
    return with_notes(result, replace(perceiving, seeds=tuple(seeds))), seeds, judged


def _driven_otherwise(driven: OpenLoopFinding | None) -> Iterator[str]:
    """A note where the vehicle moved differently from its model, whatever the verdict."""
    if driven is not None and driven.blamed not in (None, "function"):
        yield str(driven)


def _as_recorded(
    result: Resimulation, measured: DriveOutcome, errors: Rms, demands: Demands, how: AssessmentOptions
) -> DriveComparison | None:
    """The run on GT that shows the function what was recorded as perceived; None where nothing was, or for oracles."""
    recording, whole = result.recording, result.prepared.whole
    if "SD" not in whole or result.build.needs_truth:
        return None
    shown = RecordedPerception(whole["GT"], whole["SD"], ego=recording.ego, senses_ego=recording.senses_ego)
    again = run_on_gt(Resimulation(result.prepared, result.build, result.options), perception=shown)
    return compare("rGT+M", measured, seed_outcome(again, 0, how), errors, demands.tolerances)
