"""One run of a sweep: a recording on GT with a build, a perception model and a seed; what it came to is one row."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from resim.core.schema import TEXT_OUTCOMES, Cell, Row
from resim.metrics.criteria import Criteria
from resim.perception.model import PerceptionModel
from resim.perception.runtime.sensor import Sensor
from resim.recordings import Recording
from resim.resimulation.assessed import AssessmentOptions
from resim.resimulation.compute_outcome import seed_outcomes
from resim.resimulation.drive_outcome import COMFORT, DriveOutcome
from resim.resimulation.reaction import ego_tracks
from resim.resimulation.result import PreparedRecording, Resimulation, ResimulationOptions
from resim.resimulation.run import prepare, runs_on_gt
from resim.scenario import maneuvers
from resim.simulation.case import SimulatedDrive
from resim.simulation.function.interface import Build
from resim.sweeps.outcomes.definition import FinishedRun
from resim.sweeps.outcomes.registry import OUTCOMES
from resim.verification.verify import COMPARED

RATE = 5.0
"""Scenes a second [Hz] that are assessed in a sweep."""

LEADING = (
    "end", "failure", "decision", "same_decision", "reaction", "reaction_difference", "collision", "risk",
    "end_position_error", "case",
)  # fmt: skip
"""Columns that stand first in the table, for who reads it; all others follow as they are made."""


@dataclass(frozen=True, eq=False)
class PreparedRuns:
    """A recording, ready to be simulated again and again, and what all runs of a sweep are judged by.

    decision, reaction: what the EGO did in the measured drive, and when [s] it first braked.
    """

    recording: PreparedRecording
    decision: list[str]
    reaction: float | None
    criteria: Criteria


def prepare_sweep(recording: Recording, criteria: Criteria, accept: Collection[str] = ()) -> PreparedRuns:
    """Describe what was measured, once for all runs."""
    prepared, ego = prepare(recording, (), accept), recording.ego
    driven = ego_tracks(prepared.described["GT"], prepared.network)
    decision = maneuvers.decision(driven, prepared.network, ego=ego)
    return PreparedRuns(prepared, decision, maneuvers.reaction_time(driven, ego=ego), criteria)


def run_once(
    prepared: PreparedRuns,
    build: Build,
    model: PerceptionModel | None,
    seed: int,
    options: ResimulationOptions = ResimulationOptions(),
) -> tuple[SimulatedDrive, Row]:
    """Simulate once and give the drive, and what it came to: one value a column, None where there is none.

    Times in s, errors in m, m/s and rad; `reaction_difference` and `same_decision` are against the measured drive.
    """
    return run_together(prepared, build, [(model, seed)], options)[0]


def run_together(
    prepared: PreparedRuns,
    build: Build,
    runs: Sequence[tuple[PerceptionModel | None, int]],
    options: ResimulationOptions = ResimulationOptions(),
) -> list[tuple[SimulatedDrive, Row]]:
    """Give for each model and seed what `run_once` gives; the engine may drive them at once."""
    result = Resimulation(prepared.recording, build, options)
    sensed = [(None if model is None else Sensor(model), seed) for model, seed in runs]
    done = [(one, seed) for one, (_, seed) in zip(runs_on_gt(result, sensed), runs, strict=True)]
    how = AssessmentOptions(criteria=prepared.criteria, only=COMPARED, rate=RATE)
    outcomes = seed_outcomes(done, how)
    return [_came_to(prepared, *of, found) for of, found in zip(done, outcomes, strict=True)]


def _came_to(
    prepared: PreparedRuns, result: Resimulation, seed: int, found: DriveOutcome
) -> tuple[SimulatedDrive, Row]:
    """The drive of a seed, and what it came to."""
    drive, _, pipe = result.of(seed)
    run = FinishedRun(drive, pipe, found, prepared.decision, prepared.reaction)
    row: dict[str, Cell] = {
        "end": drive.end,
        "failure": drive.failure or None,
        "decision": ", ".join(found.decision),
        "reaction": found.reaction,
        "case": drive.case.hash,
        "unpinned": "; ".join(found.asked) or None,
    }
    if drive.case.traffic is not None:
        row["handed_over"] = len({one.id for one in drive.handed_over})
    errors = found.errors or dict.fromkeys(["d", "v", "heading"])
    row |= {f"pipeline_{name}": value for name, value in errors.items()}
    row |= {name: found.comfort[name] for name in COMFORT}
    row |= {outcome.column: outcome.cell(run) for outcome in OUTCOMES}
    row |= _kpis(found, prepared.criteria)
    row = {column: row[column] for column in (*LEADING, *row)}
    return drive, _without_values(row) if drive.failure else row


def _without_values(row: Row) -> Row:
    """The row of a run that failed: what it did until then says nothing of what it would have come to."""
    final = {o.column for o in OUTCOMES if o.final and row[o.column] != o.good}
    return {
        name: value if name in TEXT_OUTCOMES or name in final or name.startswith("kpi ") else None
        for name, value in row.items()
    }


def _kpis(found: DriveOutcome, criteria: Criteria) -> Row:
    """Of each criterion its KPI and worst value in `unit`; a run that ended at once is not judged."""
    row: dict[str, Cell] = {}
    for c in criteria.criteria:
        kpi = found.kpis.get(c.name)
        row[f"kpi {c.name}"] = "INVALID" if kpi is None else kpi.outcome
        row[f"value {c.name}"] = None if kpi is None else kpi.value
        row[f"unit {c.name}"] = None if kpi is None else kpi.unit
    return row
