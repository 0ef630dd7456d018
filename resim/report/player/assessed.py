"""An assessment as the player shows it: each source as its splines have it, and the criteria that are not met."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from resim.core.errors import ResimError
from resim.metrics.assessment import Assessment
from resim.metrics.assessment_report import DriveAssessment, drive_assessment
from resim.metrics.drive import Plans
from resim.report.player.drive import AccelerationCurve, Layer, PlayedDrive, TimelineMark, danger
from resim.resimulation import ResimulationAssessment

TITLES = {"GT": "ground truth", "SD": "sensor data", "rGT": "re-simulated on GT", "rSD": "re-simulated on SD"}


def of_assessment(assessed: ResimulationAssessment) -> PlayedDrive:
    """Give what was assessed, at the times of its scenes; plans are the paths by which the EGO's risk is predicted.

    Raises ResimError where nothing was.
    """
    if not assessed.blocks:
        raise ResimError(f"{assessed.name}: nothing was assessed, so there is nothing to play")
    layers: list[Layer] = []
    marks: list[TimelineMark] = []
    for source, found in assessed.blocks.items():
        told = drive_assessment(found)
        layers.append(_layer(source, found, told))
        marks += criterion_marks(source, told)
        marks += [TimelineMark("collision", t, t, source, i, f"touches {i}") for t, i in found.contacts]
    ego = str(next(iter(assessed.blocks.values())).drive.own.ids[0])
    lost = [
        f"{source} is not shown: {why}."
        for source, why in assessed.failures.items()
        if source not in assessed.blocks
    ]
    note = (
        "Each source as its splines have it, at the times of the assessment; plan: the EGO's predicted path."
    )
    return PlayedDrive(assessed.name, ego, assessed.network, tuple(layers), tuple(marks), (note, *lost))


def _layer(source: str, found: Assessment, told: DriveAssessment) -> Layer:
    drive = found.drive
    own = drive.own.a
    a = None if own is None else AccelerationCurve(drive.t, own[0], of_splines=True)
    return Layer(source, TITLES[source], drive.tracks, _paths(found), danger(told), a)


def _paths(found: Assessment) -> Plans:
    """The EGO's predicted path of each scene, in the form of plans; its times and speeds are not drawn."""
    out = []
    for t, poses in zip(found.drive.t.tolist(), found.drive.scenes.plan, strict=True):
        unknown = np.full(len(poses), np.nan)
        out.append((t, np.column_stack([unknown, poses[:, 0], poses[:, 1], unknown])))
    return out


def criterion_marks(source: str, found: DriveAssessment) -> Iterator[TimelineMark]:
    """Give the criteria that are not met, or cannot be judged, at their worst moment."""
    for name, verdict in found.criteria.items():
        if verdict.verdict != "PASS" and verdict.t is not None:
            severity = "error" if verdict.verdict == "FAIL" else "warning"
            what = f"{verdict.measure} " if verdict.verdict == "FAIL" else ""
            text = f"{severity}: {name}: {verdict.verdict}, {what}{verdict.reason}"
            yield TimelineMark("criterion", verdict.t, verdict.t, source, verdict.object, text)
