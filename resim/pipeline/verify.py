"""One recording, one build: may simulation stand in for the drive? (Groh 2018, III.B; Wagner 2021, 5.3.2)."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain

from resim.assess.assessment import Assessment
from resim.assess.criteria import Criteria
from resim.core.errors import ResimError
from resim.ingest import Recording
from resim.ingest.settings import Settings
from resim.perception.recorded import Recorded
from resim.pipeline.assessed import How
from resim.pipeline.assessments import assess_resimulation
from resim.pipeline.locality import critical, validity
from resim.pipeline.openloop import open_loop
from resim.pipeline.outcomes import outcomes, perceived_outcome, rms
from resim.pipeline.perceived import PerceivedRun, Perceiving
from resim.pipeline.result import Options, Resimulation, drove
from resim.pipeline.run import measured_tracks, perceived_runs, resimulate, run_on_gt, with_seeds
from resim.pipeline.verified import Verified
from resim.sim.adfunction import Build
from resim.verification.cause import Cause, cause
from resim.verification.compare import Comparison, Judged, Way, compare
from resim.verification.outcome import COMFORT, Outcome, Rms
from resim.verification.sequential import SequentialTest
from resim.verification.tolerance import Tolerances
from resim.verification.vehicle import OpenLoop

COMPARED = (*COMFORT, "risk", "collision")
"""Objectifications that are compared whether criteria ask for them or not."""
UNKNOWN = "unknown"
"""Stands for the build that drove a recording that does not say which did."""


@dataclass(frozen=True, eq=False)
class Demands:
    """What a recording is verified by.

    agreement: more than this share of seeds must agree, as `SequentialTest` tells it. vary: parameters
    (`resim.variation.PARAMETERS`) whose range is searched in which a verified recording's KPIs stay.
    """

    criteria: Criteria
    tolerances: Tolerances
    agreement: float = 0.9
    vary: tuple[str, ...] = ()

    def how(self, result: Resimulation, more: Collection[PerceivedRun] = ()) -> How:
        """How drives are assessed: no more than what is compared, and all with the EGO's path from the same source.

        more: runs beside those of the re-simulation.
        """
        planned = result.recording.plan is not None and has_plans(result) and all(p.run.plans for p in more)
        return How(criteria=self.criteria, only=COMPARED, path="plan" if planned else "state")


def has_plans(result: Resimulation) -> bool:
    """Say whether the function gave plans in every run; else drives can be compared by the EGO's state alone."""
    runs = [b.run for b in result.branches.values()] + [p.run for p in result.perceived_runs]
    return all(run.plans for run in runs)


def may_verify(recording: Recording | Settings, build: Build, driven_by: tuple[str, ...]) -> bool:
    """Say whether a build may be verified on a recording: it drove it, or is an oracle, or was asked for by name.

    driven_by: labels of builds whose recordings are taken for those of `build`, UNKNOWN where none is recorded. The
    method compares what one function did twice.
    """
    return build.needs_truth or bool(drove(recording, build)) or (recording.build or UNKNOWN) in driven_by


def verify_recording(
    recording: Recording,
    build: Build,
    demands: Demands,
    options: Options = Options(),
    perceiving: Perceiving | None = None,
    accept: Collection[str] = (),
) -> Verified:
    """Re-simulate a recording and set every re-simulation beside the measured drive.

    The verdict rests on GT with the perception model, where there is one, else on GT, else on SD. accept: codes of
    errors in the map in spite of which to go on.
    """
    if "GT" not in options.bases and perceiving is None and recording.sd is None:
        raise ResimError(
            f"{recording.folder or recording.name}: has no sensor data, so basis SD has nothing to run"
        )
    result = resimulate(recording, build, options, accept=accept)
    first, every = _first(result, perceiving)
    how = demands.how(result, first)
    assessed = assess_resimulation(result, how)
    found, errors = outcomes(result, assessed), rms(result.errors)
    judged = _judged(found, errors, demands)
    seeds: dict[int, Outcome] = {}
    if perceiving is not None:
        result, seeds, judged["rGT+M"] = _over_seeds(
            result, perceiving, every, found["GT"], errors, demands, how
        )
    recorded = None
    if any(j.verdict == "not verified" for j in judged.values()):
        recorded = _as_recorded(result, found["GT"], errors, demands, how)
    driven = open_loop(result, demands.tolerances)
    shown = {"rGT": "the truth", "rSD": "the traffic of the sensor data, as smooth as its splines"}
    if perceiving is not None:
        shown["rGT+M"] = f"what {perceiving.model.name} shows"
    causes: dict[Way, Cause | None] = {
        way: cause(j, errors, demands.tolerances, recorded, shown[way], driven, oracle=build.needs_truth)
        for way, j in judged.items()
    }
    notes = tuple(dict.fromkeys([*result.warnings, *assessed.notes(), *_driven_otherwise(driven)]))
    out = Verified(result, found, seeds, errors, judged, causes, recorded, driven, notes=notes)
    if demands.vary and out.verdict == "verified":
        return _varied(out, assessed.blocks["GT"], demands.vary, how)
    return out


def _varied(found: Verified, measured: Assessment, parameters: tuple[str, ...], how: How) -> Verified:
    """Search how far the parameters can be varied; a note says where that cannot be done."""
    ranges, notes = [], []
    for parameter in parameters:
        try:
            ranges.append(
                validity(found.result, found.outcomes["GT"].kpis, parameter, critical(measured), how)
            )
        except ResimError as e:
            notes.append(f"{parameter} is not varied: {e}")
    return replace(found, validity=tuple(ranges), notes=(*found.notes, *notes))


def _judged(found: Mapping[str, Outcome], errors: Rms, demands: Demands) -> dict[Way, Judged]:
    ways: tuple[Way, ...] = ("rGT", "rSD")
    return {
        way: Judged(way, (compare(way, found["GT"], found[way], errors, demands.tolerances),))
        for way in ways
        if way in found
    }


def _first(
    result: Resimulation, perceiving: Perceiving | None
) -> tuple[tuple[PerceivedRun, ...], Iterator[PerceivedRun]]:
    """The run with the first seed, and the runs with each, one after the other."""
    if perceiving is None:
        return (), iter(())
    runs = perceived_runs(result, perceiving)
    first = next(runs)
    return (first,), chain([first], runs)


def _over_seeds(
    result: Resimulation, perceiving: Perceiving, every: Iterator[PerceivedRun], measured: Outcome, errors: Rms,
    demands: Demands, how: How,
) -> tuple[Resimulation, dict[int, Outcome], Judged]:  # fmt: skip
    """Run seed after seed until the test of their share has ended."""
    test = SequentialTest(demands.agreement, len(perceiving.seeds))
    runs: list[PerceivedRun] = []
    seeds: dict[int, Outcome] = {}
    beside: list[Comparison] = []
    for run in every:
        runs.append(run)
        seeds[run.seed] = perceived_outcome(run, result, how)
        beside.append(compare("rGT+M", measured, seeds[run.seed], errors, demands.tolerances))
        judged = Judged("rGT+M", tuple(beside), test)
        if judged.verdict != "undecided":
            break
    return with_seeds(result, replace(perceiving, seeds=tuple(seeds)), runs), seeds, judged


def _driven_otherwise(driven: OpenLoop | None) -> Iterator[str]:
    """A note where the vehicle moved otherwise than its model, whatever the verdict."""
    if driven is not None and driven.blamed not in (None, "function"):
        yield str(driven)


def _as_recorded(
    result: Resimulation, measured: Outcome, errors: Rms, demands: Demands, how: How
) -> Comparison | None:
    """The run on GT that shows the function what was recorded as perceived; None where nothing was, or for oracles."""
    recording, whole = result.recording, measured_tracks(result.recording)
    if "SD" not in whole or result.build.needs_truth:
        return None
    shown = Recorded(whole["GT"], whole["SD"], ego=recording.ego, senses_ego=recording.senses_ego)
    run = run_on_gt(result, perception=shown)
    return compare("rGT+M", measured, perceived_outcome(run, result, how), errors, demands.tolerances)
