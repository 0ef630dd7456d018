"""The blocks of a re-simulation, and its runs with a perception model, from what `resim run` writes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import pandas as pd

from resim.core.tracks import Tracks
from resim.resimulation.assessed import AssessmentOptions
from resim.resimulation.blocks import Block, assess_blocks, listed, measured_functioning, plans_of
from resim.resimulation.model_runs import ModelRuns
from resim.resimulation.report import RunReport, SeedReport
from resim.resimulation.result import of_seed, with_own
from resim.road.opendrive import RoadNetwork
from resim.scenario.scenario import Scenario, describe
from resim.simulation.case import why_not_whole


@dataclass(frozen=True, eq=False)
class RunTables:
    """Tables by `source` that `resim run` writes."""

    tracks: pd.DataFrame
    answers: pd.DataFrame
    plans: pd.DataFrame


def described_runs(report: RunReport) -> list[str]:
    """Give the runs that lasted long enough to be described, as report.json has it."""
    return [f"r{basis}" for basis in ("GT", "SD") if report.errors[f"FIT_r{basis}"]["ego"]["d"] is not None]


def failures_of(report: RunReport, blocks: Mapping[str, Block]) -> dict[str, str]:
    """Give the runs that failed, each seed's too, or ended before there was anything to assess, and why."""
    out: dict[str, str] = {}
    for name, end in report.end.items():
        if (why := report.failure.get(name)) is not None:
            out[name] = str(why)
        elif name not in blocks:
            out[name] = f"ended by {end} before there was anything to assess"
    seeds = () if report.perception is None else report.perception.seeds
    return out | {of_seed(seed.seed): seed.failure for seed in seeds if seed.failure}


def blocks_of_run(
    scenarios: Mapping[str, Scenario], tables: RunTables, report: RunReport
) -> dict[str, Block]:
    """Give the blocks of a run, of its tables and what its report.json says."""
    tracks, answers, plans = tables.tracks, tables.answers, tables.plans
    hits = {name: tuple((float(h.t), str(h.id)) for h in found) for name, found in report.collisions.items()}
    findings = {f.code: f.value for f in report.findings if not f.object}
    recorded = plans_of(plans[plans.source == "recorded"])
    seen = tracks[tracks.source == "SD"]
    measured = measured_functioning(seen if len(seen) else None, recorded, findings)
    open_ = report.doubts
    out = {
        name: Block(
            _simulated(name, scenarios, report), recorded, replace(measured, of_truth=name == "GT"), hits[name],
            doubts=open_[name],
        )
        for name in ("GT", "SD")
        if name in scenarios
    }  # fmt: skip
    for name in ("rGT", "rSD"):
        if name in scenarios:
            t = answers.t[answers.source == name].to_numpy(dtype=float)
            functioning = listed(tracks[tracks.source == f"perceived_{name}"], t, t, 0.0)
            last = float(tracks.t[tracks.source == name].max())
            flaw = why_not_whole(report.end[name], report.failure.get(name) or "", last)
            out[name] = Block(
                scenarios[name], plans_of(plans[plans.source == name]), functioning, hits[name], flaw,
                open_[name[1:]].simulated(scenarios[name].ego.id), scenarios[name[1:]],
            )  # fmt: skip
    return out


def model_runs(
    gt: Block, tables: RunTables, report: RunReport, network: RoadNetwork, how: AssessmentOptions
) -> ModelRuns | None:
    """Give the runs with a perception model, judged; None where there are none, or no criteria."""
    told = report.perception
    if told is None or how.criteria is None:
        return None
    blocks = {seed.seed: _model_block(gt, tables, seed, network) for seed in told.seeds}
    whole = {seed: block for seed, block in blocks.items() if block is not None}
    judged = assess_blocks([*whole.values()], network, replace(how, only=()))
    found = dict.fromkeys(blocks, None) | dict(zip(whole, judged, strict=True))
    collided = tuple(seed.seed for seed in told.seeds if seed.collisions)
    return ModelRuns(told.model.name, how.criteria, found, collided)


def _model_block(gt: Block, tables: RunTables, seed: SeedReport, network: RoadNetwork) -> Block | None:
    """One run with a perception model: the EGO and who was handed over as they drove, other traffic of GT; None where
    it ended at once."""
    source, ego = of_seed(seed.seed), gt.scenario.ego.id
    rows = tables.tracks[tables.tracks.source == source]
    if len(rows) < 2:
        return None
    driven = describe(Tracks.from_frame(rows), network, ego=ego, map_name=gt.scenario.map)
    t = tables.answers.t[tables.answers.source == source].to_numpy(dtype=float)
    return Block(
        replace(driven, objects=with_own(gt.scenario, driven)), plans_of(tables.plans[tables.plans.source == source]),
        listed(tables.tracks[tables.tracks.source == f"perceived_{source}"], t, t, 0.0),
        tuple((float(h.t), str(h.id)) for h in seed.collisions),
        why_not_whole(seed.end, seed.failure or "", float(rows.t.max())), gt.doubts.simulated(ego),
        gt.scenario,
    )  # fmt: skip


def _simulated(basis: str, scenarios: Mapping[str, Scenario], report: RunReport) -> Scenario:
    """What was measured, up to the last whole step of a simulation of all of it: both are judged at the same times."""
    again = scenarios.get(f"r{basis}")
    if again is None or report.end[f"r{basis}"] != "duration":
        return scenarios[basis]
    return replace(scenarios[basis], duration=again.duration)
