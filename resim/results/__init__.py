"""Results on disk: folders written whole, their files, and (`resim.results.catalog`) where to find them again."""

from resim.results.folders import (
    ASSESSMENT,
    CONVERSION,
    RUN,
    SWEEP,
    VERIFICATION,
    Results,
    check_output,
    locked,
    remove_results,
    told_of,
    whole_file,
    whole_folder,
)
from resim.results.writing import (
    json_text,
    write_assessment,
    write_conversion,
    write_json,
    write_parquet,
    write_resimulation,
)

__all__ = [
    "ASSESSMENT",
    "CONVERSION",
    "RUN",
    "SWEEP",
    "VERIFICATION",
    "Results",
    "check_output",
    "json_text",
    "locked",
    "remove_results",
    "told_of",
    "whole_file",
    "whole_folder",
    "write_assessment",
    "write_conversion",
    "write_json",
    "write_parquet",
    "write_resimulation",
]
