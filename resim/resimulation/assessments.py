"""Recordings and re-simulations, assessed: each of GT, SD, rGT, rSD by its JSCEN, ten times a second."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from resim.core import remedies
from resim.core.errors import InputError
from resim.core.finding import Finding
from resim.metrics.doubts.unseen import WHOLE, Doubts
from resim.recordings import Recording
from resim.recordings.checked import finding_lines, load_checked
from resim.resimulation.assessed import AssessmentOptions, ResimulationAssessment
from resim.resimulation.blocks import (
    Block,
    assess_block,
    functioning_of,
    measured_functioning,
    plans_of,
)
from resim.resimulation.doubts import doubts
from resim.resimulation.fidelity import collisions
from resim.resimulation.notes import misfits
from resim.resimulation.result import Resimulation
from resim.resimulation.run import describe_recording, measured_tracks
from resim.resimulation.run_blocks import (
    RunTables,
    blocks_of_run,
    failures_of,
    model_runs,
)
from resim.resimulation.tables import answers_frame, plans_frame, tracks_frame
from resim.resimulation.unrepaired import without_repairs
from resim.resimulation.written import REMEDY, read_run
from resim.road.opendrive import RoadNetwork, load
from resim.scenario.scenario import Scenario
from resim.simulation.case import SimulatedDrive


def assess_folder(folder: Path, how: AssessmentOptions, accept: Iterable[str] = ()) -> ResimulationAssessment:
    """Assess a recording (GT, and SD where there is one) or what `resim run` wrote (GT, SD, rGT, rSD).

    accept: codes of findings in a recording to continue despite. Raises InputError for a folder that is neither.
    """
    if (folder / "run.json").is_file():
        return _assess_results(folder, how)
    if (folder / "recording.toml").is_file():
        return assess_recording(load_checked(folder, accept=tuple(accept)), how)
    problem = "holds neither recording.toml nor run.json"
    raise InputError(folder, problem, remedies.DRIVE)


def assess_recording(recording: Recording, how: AssessmentOptions) -> ResimulationAssessment:
    """Assess what was measured: GT, and SD where there is one."""
    network = load(recording.map)
    described = describe_recording(recording, network)
    measured = measured_tracks(recording, network)
    plans, sd = plans_of(recording.plan), measured.get("SD")
    seen = None if sd is None else without_repairs(recording, "SD", sd).tracks.to_frame()
    functioning = measured_functioning(
        seen, plans, {f.code: f.value for f in recording.findings if not f.object}
    )
    blocks = {
        str(basis): Block(
            scenario, plans, replace(functioning, of_truth=basis == "GT"),
            tuple(collisions(measured[basis], ego=recording.ego)),
            doubts=doubts(recording, basis, measured[basis], scenario, network),
        )
        for basis, scenario in described.items()
    }  # fmt: skip
    found = _assessed(recording.name, network, blocks, how, {}, recording.findings)
    rows = {str(basis): measured[basis].to_frame() for basis in described}
    scenarios = {str(basis): scenario for basis, scenario in described.items()}
    return replace(found, misfits=tuple(misfits(scenarios, rows, network).values()))


def assess_resimulation(
    result: Resimulation, how: AssessmentOptions, *, model: bool = False
) -> ResimulationAssessment:
    """Assess a re-simulation: GT, SD, rGT, rSD; with `model` and criteria its runs with a perception model as well."""
    tables = RunTables(tracks_frame(result), answers_frame(result), plans_frame(result))
    report = result.report
    blocks = blocks_of_run(result.scenarios(), tables, report)
    failures = failures_of(report, blocks)
    found = _assessed(result.recording.name, result.network, blocks, how, failures, result.recording.findings)
    runs = model_runs(blocks["GT"], tables, report, result.network, how) if model else None
    return replace(found, run=True, model=runs, misfits=tuple(result.misfits.values()))


def drive_block(
    drive: SimulatedDrive, scenario: Scenario, doubts: Doubts = WHOLE, measured: Scenario | None = None
) -> Block:
    """Give the block of one simulation and what describes it. doubts, measured: of what its traffic is of."""
    t, counts, ids = drive.perceived.columns()
    functioning = functioning_of(np.repeat(t, counts), ids, t, t, 0.0)
    hits = tuple((c.t, c.id) for c in drive.collisions)
    left = doubts.simulated(scenario.ego.id)
    return Block(scenario, drive.plans, functioning, hits, drive.flaw, left, measured)


def _assess_results(folder: Path, how: AssessmentOptions) -> ResimulationAssessment:
    run = read_run(folder)
    written, network, scenarios, tables = run.report, run.network, run.scenarios, run.tables
    try:
        blocks = blocks_of_run(scenarios, tables, written)
        failures = failures_of(written, blocks)
        model = model_runs(blocks["GT"], tables, written, network, how)
    except (ValueError, KeyError, TypeError) as e:
        raise InputError(folder / "report.json", "is not what `resim run` writes", REMEDY) from e
    found = _assessed(written.recording, network, blocks, how, failures, written.findings)
    rows = {name: tables.tracks[tables.tracks.source == name] for name in scenarios}
    return replace(found, run=True, model=model, misfits=tuple(misfits(scenarios, rows, network).values()))


def _assessed(
    name: str,
    network: RoadNetwork,
    blocks: Mapping[str, Block],
    how: AssessmentOptions,
    failures: Mapping[str, str],
    findings: Iterable[Finding],
) -> ResimulationAssessment:
    found = {key: assess_block(block, network, how) for key, block in blocks.items()}
    return ResimulationAssessment(
        name, network, False, found, how.criteria, failures, finding_lines(findings), decides=how.decides
    )
