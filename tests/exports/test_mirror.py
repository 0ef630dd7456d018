"""Results in MLflow, by MLflow itself: each once, whatever was broken off before."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("mlflow", reason="the extra mlflow is not installed")

from resim.core.errors import InputError
from resim.exports.mlflow_runs import ID
from resim.jobs.mirror import mirror
from resim.results.catalog import Catalog
from resim.results.entry import CatalogEntry, CatalogFact, CatalogInput, CatalogOutcome

pytestmark = pytest.mark.filterwarnings("ignore")  # of MLflow


def entry(name: str, day: int) -> CatalogEntry:
    return CatalogEntry(
        kind="run", name=name, folder=Path("/results") / name, host="cluster", digest=f"{day:064x}", verdict="FAIL",
        written=f"2026-11-{day:02}T05:00:00.000+00:00", resim="0.1.0", counts={"PASS": 1, "FAIL": 1},
        inputs=(
            CatalogInput("recording", "cut in (ü)", hash="a" * 64), CatalogInput("build", "pilot-1.0", hash="b" * 64),
        ),
        outcomes=(CatalogOutcome("cut in (ü)", "pilot-1.0", "rGT", "FAIL", collisions=1),),
        facts=(CatalogFact("risk", "GT", 0.25), CatalogFact("risk", "rGT", float("inf"))),
    )  # fmt: skip


def test_each_result_is_there_once(tmp_path: Path) -> None:
    from mlflow import MlflowClient

    catalog, address = str(tmp_path / "catalog.sqlite"), f"sqlite:///{tmp_path}/mlflow.db"
    Catalog(catalog).add(entry("one", 1), entry("two", 2))
    counts = mirror(address, catalog=catalog)
    assert (counts.new, counts.known) == (2, 0)
    client = MlflowClient(address)
    experiment = client.get_experiment_by_name("resim").experiment_id
    broken = client.create_run(experiment, tags={ID: entry("three", 3).id})  # nobody knows of what
    Catalog(catalog).add(entry("three", 3))
    counts = mirror(address, catalog=catalog)
    assert (counts.new, counts.known) == (1, 2)
    runs = {run.info.run_name: run for run in client.search_runs([experiment])}
    assert sorted(runs) == ["one", "three", "two"]
    assert client.get_run(broken.info.run_id).info.lifecycle_stage == "deleted"
    run = runs["two"]
    assert run.data.params["build"] == "pilot-1.0"
    assert run.data.params["recording"] == "cut in (ü)"
    assert run.data.metrics["risk/GT"] == 0.25
    assert "risk/rGT" not in run.data.metrics
    assert run.data.metrics["count/FAIL"] == 1.0
    assert run.data.tags["resim.verdict"] == "FAIL"
    assert run.data.tags["hash.build.pilot-1.0"] == "b" * 64


def test_a_store_that_is_none_is_refused_without_its_password(tmp_path: Path) -> None:
    catalog = str(tmp_path / "catalog.sqlite")
    with pytest.raises(InputError, match="cannot be used as the store of MLflow") as e:
        mirror("nothing://anna:secret@host/db", catalog=catalog)
    assert "secret" not in str(e.value)
