"""The table of a sweep, read whole."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import duckdb
import pandas as pd

from resim.core.errors import InputError
from resim.core.files import check_hashes, plain_names

REMEDY = "Write it by `resim sweep ... --resume`."


def read_rows(folder: Path, hashes: Mapping[str, str]) -> pd.DataFrame:
    """Read the parts of a sweep's table, in the order of the runs. hashes: as manifest.json has them.

    Raises InputError where they are not as they were written.
    """
    parts = check_table(folder, hashes)
    try:
        with duckdb.connect(config={"threads": 1}) as connection, plain_names(parts) as names:
            rows: pd.DataFrame = connection.read_parquet(names, hive_partitioning=False).order("run").df()
            return rows
    except Exception as e:  # what DuckDB raises for damaged bytes is not always its own
        problem = f"cannot be read: {' '.join(str(e).splitlines()[:1])}"
        raise InputError(folder / "runs", problem, REMEDY) from e


def check_table(folder: Path, hashes: Mapping[str, str]) -> list[Path]:
    """Give the parts of a sweep's table. Raises InputError where they are not as they were written."""
    if not hashes:
        raise InputError(folder / "manifest.json", "has no checksums of its table", REMEDY)
    check_hashes(folder, hashes, REMEDY)
    return [folder / name for name in hashes]
