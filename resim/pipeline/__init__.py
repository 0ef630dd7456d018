"""One recording, one build: describe, re-simulate, describe again, compare."""

from resim.pipeline.result import Basis, Branch, Options, Resimulation, perceived_frame
from resim.pipeline.run import STAGES, file_hash, map_name, resimulate

__all__ = [
    "STAGES",
    "Basis",
    "Branch",
    "Options",
    "Resimulation",
    "file_hash",
    "map_name",
    "perceived_frame",
    "resimulate",
]
