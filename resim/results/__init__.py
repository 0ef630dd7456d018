"""Results on disk: folders written whole, their files, and (`resim.results.catalog`) where to find them again."""

from resim.results.folders import (
    ASSESSMENT,
    CONVERSION,
    RUN,
    SWEEP,
    VERIFICATION,
    FolderKind,
    check_output,
    explain_os_errors,
    locked,
    remove_results,
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
    "FolderKind",
    "check_output",
    "explain_os_errors",
    "json_text",
    "locked",
    "remove_results",
    "whole_file",
    "whole_folder",
    "write_assessment",
    "write_conversion",
    "write_json",
    "write_parquet",
    "write_resimulation",
]
