"""KPIs of a run or an assessment, read back as numbers."""

from __future__ import annotations

from pathlib import Path

import duckdb

from resim.core.files import plain_names


def kpi_values(folder: Path) -> dict[str, float]:
    """Give the values of kpis.parquet by source and name; none where the file is not there or holds something else."""
    file = folder / "kpis.parquet"
    if not file.is_file():
        return {}
    try:
        with duckdb.connect() as db, plain_names([file]) as names:
            rows = db.execute(
                "SELECT source, name, value FROM read_parquet(?) WHERE isfinite(value::DOUBLE)", [names]
            ).fetchall()
    except Exception:  # what DuckDB raises for damaged bytes is not always its own
        return {}
    return {f"kpi/{source}/{name}": float(value) for source, name, value in rows}
