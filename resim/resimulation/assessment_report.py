"""What assessment.json says, of a run or of a recording, as dataclasses: their fields are those of the file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated

from pydantic import MISSING, Field

from resim.core.provenance import versions
from resim.core.spec import EXACT
from resim.metrics.assessment_report import DriveAssessment, drive_assessment
from resim.resimulation.assessed import ResimulationAssessment
from resim.resimulation.model_runs import ModelRunsReport


@dataclass(frozen=True)
class HashedName:
    """A recording, or a file of criteria: its name, and the SHA-256 of what it held."""

    name: str
    hash: str


@dataclass(frozen=True)
class HashedBuild:
    """A build: its name and version, and its hash, None where a recording does not say it."""

    label: str
    hash: str | None


@dataclass(frozen=True)
class AssessmentInputs:
    """What was assessed; build: that drives the runs, of a recording the one that drove, as far as it is known.

    run: of a run, the SHA-256 of its report.json.
    """

    recording: HashedName
    build: HashedBuild | None
    criteria: HashedName | None
    run: str | None


@dataclass(frozen=True)
class _Assessed:
    versions: Mapping[str, str]
    inputs: AssessmentInputs


@dataclass(frozen=True, kw_only=True)
class RunAssessment(_Assessed):
    """What assessment.json says of a run: of each drive, as far as it is there.

    over_seeds: of the runs with a perception model, where there are criteria. decides: whose verdict is that on the
    drive. failures: of runs that failed, and why.
    findings: what is wrong with the recording. notes: what to know before comparing.
    """

    __pydantic_config__ = EXACT

    GT: DriveAssessment
    SD: DriveAssessment | MISSING = MISSING
    rGT: DriveAssessment | MISSING = MISSING
    rSD: DriveAssessment | MISSING = MISSING
    over_seeds: Annotated[ModelRunsReport | MISSING, Field(alias="rGT+M")] = MISSING
    decides: tuple[str, ...]
    failures: Mapping[str, str]
    findings: tuple[str, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class RecordingAssessment(DriveAssessment, _Assessed):
    """What assessment.json says of a recording: of GT, and in `SD` of SD.

    decides: whose verdict is that on the drive. findings: what is wrong with it.
    """

    __pydantic_config__ = EXACT

    SD: DriveAssessment | MISSING = MISSING
    decides: tuple[str, ...]
    findings: tuple[str, ...]


def report(found: ResimulationAssessment, inputs: AssessmentInputs) -> RunAssessment | RecordingAssessment:
    """Give what assessment.json says of an assessment."""
    drives = {name: drive_assessment(a) for name, a in found.blocks.items()}
    notes = tuple(found.notes())
    if found.run:
        return RunAssessment(
            versions(),
            inputs,
            **drives,
            over_seeds=MISSING if found.model is None else found.model.report(),
            decides=found.deciding(),
            failures=found.failures,
            findings=found.findings,
            notes=notes,
        )
    gt = vars(replace(drives["GT"], notes=notes))
    return RecordingAssessment(
        versions(),
        inputs,
        SD=drives.get("SD", MISSING),
        decides=found.deciding(),
        findings=found.findings,
        **gt,
    )
