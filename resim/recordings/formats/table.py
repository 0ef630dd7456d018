"""Any table, or topics of a log: a mapping file says what their columns mean (`resim.recordings.mapped`)."""

from __future__ import annotations

from pathlib import Path

from resim.recordings.formats.registry import FORMATS, FormatOption, RecordingFormat
from resim.recordings.mapped.reader import read_mapped

TABLES = ("*.csv", "*.parquet", "*.mcap", "*.mf4", "*.db3", "./metadata.yaml")
"""How tables and logs are called."""

FORMATS.add(
    RecordingFormat(
        name="table",
        source="any CSV or Parquet table, or a log (MCAP, rosbag2, MDF4), by a mapping of its columns",
        file="file",
        file_help="CSV or Parquet table, one row per time and object; or a log of topics: MCAP, rosbag2, MDF4.",
        reader=read_mapped,
        patterns=TABLES,
        options=(
            FormatOption(
                "columns",
                Path,
                "Mapping (TOML): what the columns mean; `resim import guess` writes a first one.",
                metavar="MAPPING",
                required=True,
                patterns=("*.toml",),
            ),
            FormatOption("rate", float, "Frames a second [Hz], where times are in frames.", metavar="HZ"),
        ),
        works_out=("ego",),
    )
)
