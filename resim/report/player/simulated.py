"""A re-simulation, in memory or as `resim run` wrote it, as the player shows it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd

from resim.core.tracks import Tracks
from resim.metrics.assessment_report import DriveAssessment, drive_assessment
from resim.report.player.assessed import criterion_marks
from resim.report.player.drive import Layer, PlayedDrive, TimelineMark, danger, differenced
from resim.report.player.measured import TITLES, event_marks, finding_marks, splines
from resim.resimulation import Resimulation, ResimulationAssessment
from resim.resimulation.blocks import plans_of
from resim.resimulation.report import RunReport
from resim.resimulation.run_blocks import RunTables
from resim.resimulation.tables import answers_frame, plans_frame, tracks_frame
from resim.road.opendrive import RoadNetwork
from resim.scenario.scenario import Scenario

PLANS = {"GT": "recorded"}
"""Whose plans stand in the table under another name."""
ENDS = {
    "collision": "ended by a collision",
    "off_road": "ended off the road",
    "function_failed": "the function failed",
}


def of_resimulation(result: Resimulation, assessed: ResimulationAssessment) -> PlayedDrive:
    """Give a re-simulation: GT, SD, rGT, rSD, what was perceived, and one run with the perception model."""
    tables = RunTables(tracks_frame(result), answers_frame(result), plans_frame(result))
    found = {name: drive_assessment(a) for name, a in assessed.blocks.items()}
    return of_run(result.report, result.network, result.scenarios(), tables, found)


def of_run(
    report: RunReport,
    network: RoadNetwork,
    scenarios: Mapping[str, Scenario],
    tables: RunTables,
    assessed: Mapping[str, DriveAssessment],
) -> PlayedDrive:
    """Give a re-simulation of what `resim run` writes; assessed: by source, as far as it is known."""
    sources = list(dict.fromkeys(tables.tracks.source))
    seeds = [s for s in sources if s.startswith("rGT+M")]
    kept = [s for s in sources if "+M" not in s or s.endswith(seeds[0])]
    kept.sort(key=lambda s: ("+M" in s, s.startswith("perceived")))
    layers = []
    for source in kept:
        tracks = _tracks(tables.tracks[tables.tracks.source == source])
        if tracks is None:
            continue
        plans = plans_of(tables.plans[tables.plans.source == PLANS.get(source, source)])
        curves = danger(assessed[source]) if source in assessed else None
        made = scenarios.get(source)
        a = differenced(tracks, report.ego) if made is None else splines(made, network)
        shown = source in ("GT", "SD", "rGT", "rSD")
        own = assessed.get(source)
        layers.append(Layer(source.replace("_", " "), _title(source), tracks, plans, curves, a, shown, own))
    notes = []
    if len(seeds) > 1:
        notes.append(f"Of {len(seeds)} runs with the perception model, that of seed {seeds[0][5:]} is shown.")
    drawn = {layer.name for layer in layers}
    notes += [note for source, note in broken_off(report).items() if source in drawn]
    notes += [
        f"{source} is not shown: {why}"
        for source, why in report.failure.items()
        if why and source not in drawn
    ]
    start = float(min(layer.tracks.t[0] for layer in layers))
    marks = [*finding_marks(report.findings, start), *_marks(report, network, scenarios, layers)]
    for source, found in assessed.items():
        marks += criterion_marks(source, found)
    return PlayedDrive(report.recording, report.ego, network, tuple(layers), tuple(marks), tuple(notes))


def broken_off(report: RunReport) -> dict[str, str]:
    """Say which runs ended before their scenario did: who sees their tracks alone takes them for whole drives."""
    return {
        source: f"{source} broke off ({end.replace('_', ' ')}): what would have followed is not known"
        for source, end in report.end.items()
        if end != "duration"
    }


def _title(source: str) -> str:
    """What a source is, in words."""
    if "+M" not in source:
        return TITLES.get(source, source)
    seed = source.partition("+M")[2]
    if source.startswith("perceived"):
        return f"what the function was shown with the perception model, seed {seed}"
    return f"EGO with the perception model, seed {seed}"


def _tracks(rows: pd.DataFrame) -> Tracks | None:
    """The tracks in rows, of which those that lack a number are left out; None where none is left."""
    rows = rows[np.isfinite(rows[["x", "y", "heading", "v"]].to_numpy(dtype=float)).all(axis=1)]
    rows = rows.drop_duplicates(["t", "id"])
    return Tracks.from_frame(rows) if len(rows) else None


def _marks(
    report: RunReport, network: RoadNetwork, scenarios: Mapping[str, Scenario], layers: list[Layer]
) -> Iterator[TimelineMark]:
    """Reactions, decisions, collisions and early ends of all sources."""
    for source, scenario in scenarios.items():
        if source != "SD":  # what the EGO did is told of GT, rGT and rSD
            yield from event_marks(source, scenario, network)
    for source, hits in report.collisions.items():
        for hit in hits:
            yield TimelineMark("collision", hit.t, hit.t, source, hit.id, f"collides with {hit.id}")
    for source, left in report.left_route.items():
        if left is not None:
            yield TimelineMark("decision", left, left, source, report.ego, "leaves the measured route")
    last = {layer.name: float(layer.tracks.t[-1]) for layer in layers}
    for source, end in report.end.items():
        if end in ENDS and source in last:
            yield TimelineMark(
                "end", last[source], last[source], source, report.ego, report.failure[source] or ENDS[end]
            )
