"""A new outcome of sweeps, as docs/extend/outcome.md says."""

from __future__ import annotations

import json

import duckdb
import pytest
from extend import Extended, extended


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Extended:
    return extended("outcome.md", tmp_path_factory.mktemp("outcome"))


def test_its_code_and_its_test_are_as_ours(copy: Extended) -> None:
    copy.check()


@pytest.mark.slow
def test_runs_are_told_apart_by_it_and_an_adaptive_plan_looks_for_it(copy: Extended) -> None:
    printed = copy.commands("outcome.md")
    out = copy.folder / "out"
    rows = duckdb.sql(f"select * from '{out}/sweep/runs/*.parquet'").df()
    tracks = duckdb.sql(
        f"select * from '{out}/again/tracks.parquet' where source = 'rGT' and id = 'ego'"
    ).df()
    assert bool(rows["standstill"][0]) == (tracks["v"].min() < 0.1)
    (section,) = json.loads((out / "sweep" / "report.json").read_text())["sections"]
    boundary = section["boundary"]
    assert (boundary["name"], boundary["label"]) == ("standstill", "no standstill of the EGO")
    assert boundary["good"] == (~rows["standstill"].astype(bool)).sum()
    assert "the EGO keeps moving" in printed


@pytest.mark.slow
def test_an_outcome_that_there_is_not_is_told_with_those_that_there_are(copy: Extended) -> None:
    path = copy.folder / "other.toml"
    path.write_text((copy.folder / "standstill.toml").read_text().replace('"no standstill"', '"no stand"'))
    done = copy.run("-m", "resim", "sweep", path, "--out", copy.folder / "out" / "other")
    assert done.returncode == 2
    assert "There are: verdict, same_decision, no collision, no standstill" in done.stderr
