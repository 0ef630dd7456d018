"""KPIs of a run or an assessment, read back: as numbers, and the moments at which criteria were not met."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import duckdb

from resim.core.files import plain_names

MOST = 200
"""Moments that are given."""


@dataclass(frozen=True)
class KpiMoment:
    """When [s] a source was at its worst by a criterion that is not met. object: whose id, "" for nobody's."""

    source: str
    criterion: str
    verdict: str
    t: float
    object: str
    reason: str


def kpi_values(folder: Path) -> dict[str, float]:
    """Give the values of kpis.parquet by source and name; none where the file is not there or holds something else."""
    rows = _rows(folder, "SELECT source, name, value FROM read_parquet(?) WHERE isfinite(value::DOUBLE)")
    return {f"kpi/{source}/{name}": float(value) for source, name, value in rows}


def kpi_moments(folder: Path) -> list[KpiMoment]:
    """Give when criteria were not met, by source; none where kpis.parquet is not there or holds something else."""
    rows = _rows(
        folder,
        "SELECT source, name, verdict, t::DOUBLE, coalesce(object::VARCHAR, ''), coalesce(reason::VARCHAR, '') "
        "FROM read_parquet(?) WHERE verdict IN ('FAIL', 'INVALID') AND isfinite(t::DOUBLE) "
        f"ORDER BY source, t LIMIT {MOST}",
    )
    return [KpiMoment(str(s), str(n), str(v), float(t), str(o), str(r)) for s, n, v, t, o, r in rows]


def _rows(folder: Path, query: str) -> list[tuple[Any, ...]]:
    file = folder / "kpis.parquet"
    if not file.is_file():
        return []
    try:
        with duckdb.connect() as db, plain_names([file]) as names:
            return list(db.execute(query, [names]).fetchall())
    except Exception:  # what DuckDB raises for damaged bytes is not always its own
        return []
