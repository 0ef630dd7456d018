"""The JSON Schema of every file that users write, and of the JSON files that resim writes: from what reads them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel

from resim.core.spec import json_schema, sealed_schema
from resim.jobs.export import ExportReport
from resim.metrics.criteria_file import CriteriaFile
from resim.metrics.risk.prediction import PredictionSet
from resim.mining.catalog import KindsFile
from resim.mining.report import MiningReport
from resim.mining.settings import MiningSettings
from resim.perception.model import PerceptionModel
from resim.recordings.mapped.mapping import Mapping as ColumnMapping
from resim.recordings.settings import Settings
from resim.resimulation.assessment_report import RecordingAssessment, RunAssessment
from resim.resimulation.report import RunProvenance, RunReport
from resim.road.checked import ConversionReport
from resim.scenario.augmentation.settings import AugmentationSettings
from resim.scenario.generation.recipe import Recipe
from resim.scenario.jscen import JscenFile
from resim.simulation.function.interface import BuildFile
from resim.simulation.naturalistic.settings import NaturalisticSettings
from resim.simulation.reactive.settings import ReactiveSettings
from resim.space.comparison import SpaceComparison
from resim.space.limits import ReleaseLimits
from resim.space.release_report import ReleaseReport
from resim.space.report import SpaceReport
from resim.space.risk import CoverReport
from resim.space.settings import SpaceSettings
from resim.sweeps.manifest import SweepBegun, SweepManifest
from resim.sweeps.report import SweepReport
from resim.sweeps.sweep_file import SweepFile
from resim.variations.kernels import KernelFile
from resim.variations.report import VariationReport
from resim.variations.settings import VariationSettings
from resim.verification.cases import CaseFile
from resim.verification.inputs import VerificationBegun
from resim.verification.report import VerificationReport
from resim.verification.suite import SuiteFile

DIALECT = "https://json-schema.org/draft/2020-12/schema"


@dataclass(frozen=True)
class FileFormat:
    """A kind of file.

    Attributes:
        file: What it is called.
        kind: The model or dataclass that reads it.
        sealed: Whether it has a checksum of itself.
    """

    file: str
    kind: type
    sealed: bool = False

    def schema(self) -> dict[str, Any]:
        """Give its JSON Schema; a TOML file is valid where what it says is, as JSON."""
        if issubclass(self.kind, BaseModel):
            return {"$schema": DIALECT, **self.kind.model_json_schema()}
        return {"$schema": DIALECT, **(sealed_schema if self.sealed else json_schema)(self.kind)}


FORMATS: Mapping[str, FileFormat] = {
    "recording": FileFormat("recording.toml", Settings),
    "mapping": FileFormat("*.toml", ColumnMapping),
    "jscen": FileFormat("*.jscen.json", JscenFile),
    "build": FileFormat("*.toml", BuildFile),
    "criteria": FileFormat("*.toml", CriteriaFile),
    "traffic": FileFormat("*.toml", ReactiveSettings),
    "recipe": FileFormat("*.toml", Recipe),
    "naturalistic": FileFormat("*.toml", NaturalisticSettings),
    "augmentation": FileFormat("*.toml", AugmentationSettings),
    "labels": FileFormat("*.toml", MiningSettings),
    "kinds": FileFormat("*.toml", KindsFile),
    "variation": FileFormat("*.toml", VariationSettings),
    "kernels": FileFormat("kernels.json", KernelFile, sealed=True),
    "variations": FileFormat("variations.json", VariationReport, sealed=True),
    "suite": FileFormat("*.toml", SuiteFile),
    "sweep": FileFormat("*.toml", SweepFile),
    "perception": FileFormat("*.json", PerceptionModel),
    "prediction": FileFormat("*.json", PredictionSet),
    "report": FileFormat("report.json", RunReport),
    "run": FileFormat("run.json", RunProvenance, sealed=True),
    "run_assessment": FileFormat("assessment.json", RunAssessment, sealed=True),
    "assessment": FileFormat("assessment.json", RecordingAssessment, sealed=True),
    "export": FileFormat("export.json", ExportReport, sealed=True),
    "conversion": FileFormat("conversion.json", ConversionReport, sealed=True),
    "verification": FileFormat("verification.json", VerificationReport, sealed=True),
    "inputs": FileFormat("inputs.json", VerificationBegun, sealed=True),
    "case": FileFormat("cases/*.json", CaseFile, sealed=True),
    "sweep_begun": FileFormat("sweep.json", SweepBegun, sealed=True),
    "manifest": FileFormat("manifest.json", SweepManifest, sealed=True),
    "mined": FileFormat("mined.json", MiningReport, sealed=True),
    "sweep_report": FileFormat("report.json", SweepReport),
    "space_settings": FileFormat("*.toml", SpaceSettings),
    "release_limits": FileFormat("*.toml", ReleaseLimits),
    "space": FileFormat("space.json", SpaceReport, sealed=True),
    "cover": FileFormat("cover.json", CoverReport, sealed=True),
    "release": FileFormat("release.json", ReleaseReport, sealed=True),
    "space_comparison": FileFormat("comparison.json", SpaceComparison, sealed=True),
}
"""By name; report.json of a run is "report", that of a sweep "sweep_report"; assessment.json of a run is
"run_assessment", that of a recording "assessment"."""


def schema_of(name: str) -> dict[str, Any]:
    """Give the JSON Schema of a kind of file.

    Args:
        name: Of `FORMATS`.

    Returns:
        A schema of draft 2020-12.

    Raises:
        KeyError: There is no such kind.
    """
    return FORMATS[name].schema()
