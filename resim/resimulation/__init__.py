"""One recording, one build: describe, re-simulate, describe again, compare; and a map, looked over and converted."""

from resim.recordings.checked import (
    check_codes,
    finding_line,
    load_checked,
    refuse_findings,
    repair_recording,
)
from resim.resimulation.assessed import AssessmentOptions, ResimulationAssessment
from resim.resimulation.assessments import assess_folder, assess_recording, assess_resimulation
from resim.resimulation.perceived import PerceptionSetup, end_error
from resim.resimulation.result import (
    Basis,
    PreparedRecording,
    Resimulation,
    ResimulationOptions,
    of_seed,
    pipeline_step,
)
from resim.resimulation.run import STAGES, map_name, resimulate
from resim.resimulation.tables import perceived_frame
from resim.road.checked import MapCheck, check_map, refuse_flaws

__all__ = [
    "STAGES",
    "AssessmentOptions",
    "Basis",
    "MapCheck",
    "PerceptionSetup",
    "PreparedRecording",
    "Resimulation",
    "ResimulationAssessment",
    "ResimulationOptions",
    "assess_folder",
    "assess_recording",
    "assess_resimulation",
    "check_codes",
    "check_map",
    "end_error",
    "finding_line",
    "load_checked",
    "map_name",
    "of_seed",
    "perceived_frame",
    "pipeline_step",
    "refuse_findings",
    "refuse_flaws",
    "repair_recording",
    "resimulate",
]
