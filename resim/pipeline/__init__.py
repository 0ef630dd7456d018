"""One recording, one build: describe, re-simulate, describe again, compare; and a map, looked over and converted."""

from resim.pipeline.maps import MapCheck, check_map, refuse_flaws
from resim.pipeline.result import Basis, Branch, Options, Resimulation, perceived_frame
from resim.pipeline.run import STAGES, file_hash, map_name, resimulate

__all__ = [
    "STAGES",
    "Basis",
    "Branch",
    "MapCheck",
    "Options",
    "Resimulation",
    "check_map",
    "file_hash",
    "map_name",
    "perceived_frame",
    "refuse_flaws",
    "resimulate",
]
