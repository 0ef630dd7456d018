"""A new sweep plan, as docs/extend/plan.md says."""

from __future__ import annotations

import duckdb
import pytest
from extend import Extended, extended


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Extended:
    return extended("plan.md", tmp_path_factory.mktemp("plan"))


def test_its_code_and_its_test_are_as_ours(copy: Extended) -> None:
    copy.check()


@pytest.mark.slow
def test_a_sweep_runs_its_points_and_reports_on_them(copy: Extended) -> None:
    copy.commands("plan.md")
    out = copy.folder / "out" / "sweep"
    rows = duckdb.sql(f"select * from '{out}/runs/*.parquet' order by run").df()
    swept = rows[["perception.latency.speed", "perception.errors.longitudinal.bias.constant"]]
    assert swept.to_numpy().tolist() == [[0.0, -2.0], [0.0, 2.0], [1.2, -2.0], [1.2, 2.0]]
    assert "corners of the ranges: 4 points" in (out / "report.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_a_plan_that_there_is_not_is_told_with_those_that_there_are(copy: Extended) -> None:
    path = copy.folder / "other.toml"
    path.write_text((copy.folder / "corners.toml").read_text().replace('plan = "corners"', 'plan = "corner"'))
    done = copy.run("-m", "resim", "sweep", path, "--out", copy.folder / "out" / "other")
    assert done.returncode == 2
    assert "'sobol' or 'corners'" in done.stderr
