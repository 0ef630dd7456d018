"""A recording, and a scenario of a JSCEN file, as the player shows them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from resim.core.clock import regular
from resim.core.finding import Finding
from resim.metrics.assessment import Assessment
from resim.metrics.assessment_report import drive_assessment
from resim.recordings import Recording
from resim.report.player.drive import (
    AccelerationCurve,
    Layer,
    PlayedDrive,
    TimelineMark,
    danger,
    differenced,
    grid,
)
from resim.resimulation.blocks import plans_of
from resim.resimulation.reaction import ego_tracks
from resim.road.opendrive import RoadNetwork
from resim.scenario import maneuvers
from resim.scenario.scenario import Scenario

MOST_FINDINGS = 400
"""Findings that are marked one by one."""
TITLES: Mapping[str, str] = {
    "GT": "ground truth", "SD": "sensor data", "rGT": "re-simulated on GT", "rSD": "re-simulated on SD",
    "perceived_rGT": "what the function was shown in rGT", "perceived_rSD": "what the function was shown in rSD",
}  # fmt: skip


def of_recording(
    recording: Recording, network: RoadNetwork, assessed: Mapping[str, Assessment] | None = None
) -> PlayedDrive:
    """Give a recording: GT and SD, its recorded plans and findings; with an assessment by source risk and TTC, too."""
    found = assessed or {}
    layers = [_measured("GT", recording, found.get("GT"))]
    notes = []
    if recording.sd is not None:
        layers.append(_measured("SD", recording, found.get("SD")))
        if not recording.senses_ego:
            notes.append("SD has no track of the EGO: ground truth stands in for it.")
    start = float(min(layer.tracks.t[0] for layer in layers if len(layer.tracks.t)))
    marks = finding_marks(recording.findings, start)
    if len(recording.findings) > MOST_FINDINGS:
        notes.append(
            f"{MOST_FINDINGS} of {len(recording.findings)} findings are marked; `resim check` lists all."
        )
    return PlayedDrive(recording.name, recording.ego, network, tuple(layers), tuple(marks), tuple(notes))


def _measured(name: str, recording: Recording, assessed: Assessment | None) -> Layer:
    tracks = recording.gt if name == "GT" else recording.sd_by_gt()
    assert tracks is not None
    plans = plans_of(recording.plan) if name == "GT" else ()
    own = None if assessed is None else danger(drive_assessment(assessed))
    return Layer(name, TITLES[name], tracks, plans, own, differenced(tracks, recording.ego))


def of_scenario(scenario: Scenario, network: RoadNetwork, name: str) -> PlayedDrive:
    """Give a scenario as its splines have it, and what its EGO did."""
    begin = scenario.ego.spawn_time
    t = regular(begin, scenario.duration, 0.04)
    tracks = scenario.tracks(network, t)
    layer = Layer("JSCEN", "scenario", tracks, acceleration=splines(scenario, network))
    return PlayedDrive(
        name, scenario.ego.id, network, (layer,), tuple(event_marks("JSCEN", scenario, network))
    )


def splines(scenario: Scenario, network: RoadNetwork) -> AccelerationCurve | None:
    """Give the EGO's acceleration as its splines have it."""
    begin = scenario.ego.spawn_time
    t = grid(begin, begin + scenario.duration)
    own = scenario.tracks(network, t).select([scenario.ego.id])
    return None if own.a is None else AccelerationCurve(t, own.a[0], of_splines=True)


EVENTS = {"brake": "first braking", "lane_change_left": "changes lane to the left",
          "lane_change_right": "changes lane to the right"}  # fmt: skip


def event_marks(source: str, scenario: Scenario, network: RoadNetwork) -> Iterable[TimelineMark]:
    """Give what the EGO did and when, by the splines of its trace."""
    ego = scenario.ego.id
    for t, what in maneuvers.events(ego_tracks(scenario, network), network, ego=ego):
        kind = "reaction" if what == "brake" else "decision"
        yield TimelineMark(kind, t, t, source, ego, EVENTS[what])  # type: ignore[arg-type]


def finding_marks(findings: Sequence[Finding], start: float) -> list[TimelineMark]:
    """Give the findings that have a time, worst first, and at the start [s] those of the whole drive."""
    out = []
    for f in findings[:MOST_FINDINGS]:
        begin, end = (start if np.isnan(t) else float(t) for t in (f.start, f.end))
        text = f"{f.severity}: {f.code}: {f.text}"
        out.append(
            TimelineMark(
                "finding", begin, max(begin, end), {"gt": "GT", "sd": "SD"}.get(f.source, ""), f.object, text
            )
        )
    return out
