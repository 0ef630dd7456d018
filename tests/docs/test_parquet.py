"""Every page that names a table of results says how it is read, and the lines that it quotes work."""

from __future__ import annotations

import re
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd
import pytest

from resim.results.writing import write_parquet

DOCS = Path(__file__).parents[2] / "docs"
TABLES = re.compile(r"\b(?:tracks|answers|plans|kpis|times)\.parquet|runs/(?:\*|part-\*)\.parquet")
LINES = re.compile(r"duckdb\.sql\(\"([^\"]+)\"\)\.df\(\)")
HOW = ("#read-a-table", 'duckdb.sql("')
OF_TABLES = [
    page
    for page in sorted(DOCS.rglob("*.md"))
    if TABLES.search(page.read_text(encoding="utf-8")) and page.name not in ("validation.md", "scale.md")
]


def test_every_kind_of_table_is_named_somewhere() -> None:
    told = " ".join(page.read_text(encoding="utf-8") for page in OF_TABLES)
    for name in ("tracks", "answers", "plans", "kpis", "times"):
        assert f"{name}.parquet` ([read by one line](#read-a-table)" in told, name


@pytest.mark.parametrize("page", OF_TABLES, ids=lambda page: page.stem)
def test_a_page_that_names_a_table_says_how_it_is_read(page: Path) -> None:
    text = " ".join(page.read_text(encoding="utf-8").split())
    if page.name == "commands.md":  # the help of the commands
        text = text.replace("read by DuckDB: docs/formats/results.md", HOW[0])
    assert any(way in text for way in HOW), page.name


@pytest.mark.parametrize("page", OF_TABLES, ids=lambda page: page.stem)
def test_the_lines_that_are_quoted_work(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for query in LINES.findall(" ".join(page.read_text(encoding="utf-8").split())):
        (name,) = re.findall(r"'([^']+)'", query)
        path = tmp_path / name.replace("*", "part-0")
        path.parent.mkdir(parents=True, exist_ok=True)
        write_parquet(pd.DataFrame({"t": [0.0, 0.1], "x": [1.0, np.nan]}), path)
        found = duckdb.sql(query).df()
        assert found["t"].tolist() == [0.0, 0.1], query
