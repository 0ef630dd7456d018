"""The table of a sweep, read whole."""

from __future__ import annotations

from pathlib import Path

import duckdb
import pandas as pd

from resim.core.errors import InputError
from resim.core.files import plain_names


def read_rows(folder: Path) -> pd.DataFrame:
    """Read runs/part-*.parquet of a sweep's folder, in the order of the runs. Raises InputError."""
    parts = sorted((folder / "runs").glob("part-*.parquet"))
    if not parts:
        raise InputError(
            folder / "runs", "holds no part-*.parquet", "Write it by `resim sweep ... --resume`."
        )
    try:
        with duckdb.connect(config={"threads": 1}) as connection, plain_names(parts) as names:
            rows: pd.DataFrame = connection.read_parquet(names, hive_partitioning=False).order("run").df()
            return rows
    except duckdb.Error as e:
        problem = f"cannot be read: {str(e).splitlines()[0]}"
        raise InputError(folder / "runs", problem, "Write it by `resim sweep ... --resume`.") from e
