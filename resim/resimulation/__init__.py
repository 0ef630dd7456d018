"""One recording, one build: describe, re-simulate, describe again, compare; and a map, looked over and converted."""

from resim.recordings.checked import (
    check_codes,
    examined,
    finding_line,
    refuse_findings,
    repair_recording,
)
from resim.resimulation.assessed import Assessed, How
from resim.resimulation.assessments import assess_folder, assess_recording, assess_resimulation
from resim.resimulation.perceived import Perceiving, end_error
from resim.resimulation.result import (
    Basis,
    Options,
    PreparedRecording,
    Resimulation,
    of_seed,
    pipeline_step,
)
from resim.resimulation.run import STAGES, map_name, resimulate
from resim.resimulation.tables import perceived_frame
from resim.road.checked import MapCheck, check_map, refuse_flaws

__all__ = [
    "STAGES",
    "Assessed",
    "Basis",
    "How",
    "MapCheck",
    "Options",
    "Perceiving",
    "PreparedRecording",
    "Resimulation",
    "assess_folder",
    "assess_recording",
    "assess_resimulation",
    "check_codes",
    "check_map",
    "end_error",
    "examined",
    "finding_line",
    "map_name",
    "of_seed",
    "perceived_frame",
    "pipeline_step",
    "refuse_findings",
    "refuse_flaws",
    "repair_recording",
    "resimulate",
]
