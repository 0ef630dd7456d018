"""One run of a sweep once more."""

from __future__ import annotations

import json
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import duckdb
import pytest
from conftest import ROOT
from resealed import edit
from swept import state_hashes

from resim.results import write_parquet

Call = Callable[..., tuple[int, str, str]]

SWEEP = """
name = "small"
criteria = "highway.toml"
build = ["{root}/adfunc/builds/highway_pilot-1.0.toml"]
perception = "model.json"
seeds = 2
plan = "one_at_a_time"
parameter = [{{name = "perception.latency.speed", values = [0.0, 0.8], base = 0.0}}]
recording = [{{folder = "{root}/scenarios/cut_in_brake"}}]
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a sweep's file, its inputs and, in `out`, its results."""
    from typer.testing import CliRunner

    from resim.cli import app

    folder = tmp_path_factory.mktemp("repeat")
    shutil.copyfile(ROOT / "scenarios" / "criteria" / "highway.toml", folder / "highway.toml")
    shutil.copyfile(ROOT / "adfunc" / "perception" / "proving_ground.json", folder / "model.json")
    (folder / "sweep.toml").write_text(SWEEP.format(root=ROOT))
    done = CliRunner().invoke(app, ["sweep", str(folder / "sweep.toml"), "--out", str(folder / "out")])
    assert done.exit_code == 0, done.output
    return folder


@pytest.fixture
def swept(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The same, to be changed by one test, which is done in it."""
    shutil.copytree(made, tmp_path / "here")
    monkeypatch.chdir(tmp_path / "here")
    manifest = Path("out") / "manifest.json"

    def where(said: dict[str, Any]) -> None:
        for file in (*said["inputs"]["builds"].values(), *said["inputs"]["recordings"].values()):
            file["path"] = str((made / "out" / file["path"]).resolve())

    edit(manifest, where)
    return Path()


def test_the_command_of_the_report_repeats_the_run(swept: Path, call: Call) -> None:
    assert call("sweep", "report", "out")[0] == 0
    worst = json.loads(Path("out/report.json").read_text())["sections"][0]["worst"][0]
    program, *command = shlex.split(worst["command"])
    code, said, error = call(*command)
    assert (program, code, error) == ("resim", 0, "")
    assert f"run {worst['run']}: the same as in the sweep" in said
    folder = Path(command[-1])
    tracks = duckdb.sql(f"select distinct source from '{folder}/tracks.parquet'").fetchall()
    assert (f"rGT+M{worst['seed']}",) in tracks
    seed = json.loads((folder / "report.json").read_text())["perception"]["seeds"][0]
    row = duckdb.sql(
        f"select reaction, end_position_error from 'out/runs/*.parquet' where run = {worst['run']}"
    )
    assert [(seed["reaction"], seed["end_position_error"])] == row.fetchall()
    assert (folder / "report.html").is_file()
    of_it = f"'{folder}/kpis.parquet' where starts_with(source, 'rGT+M') and row = 'criterion'"
    told = duckdb.sql(f"select name, value, verdict from {of_it}").fetchall()
    rows = duckdb.sql(f"select * from 'out/runs/*.parquet' where run = {worst['run']}").df().iloc[0]
    assert told
    for name, value, verdict in told:  # judged as the sweep did, at as many scenes
        assert (rows[f"value {name}"], rows[f"kpi {name}"]) == (pytest.approx(value, nan_ok=True), verdict)
    listed = json.loads(call("runs", "list", "--kind", "run", "--json")[1])["results"]
    assert str(folder.resolve()) in [entry["folder"] for entry in listed]


@pytest.mark.slow
def test_what_differs_is_named(swept: Path, call: Call) -> None:
    part = Path("out/runs/part-00000.parquet")
    rows = duckdb.sql(f"select * from '{part}'").df()
    rows.loc[rows.run == 1, ["risk", "decision"]] = 0.5, "swerve"
    write_parquet(rows, part)
    state_hashes(Path("out"))
    code, _, error = call("sweep", "repeat", "out", 1, "--out", "again")
    assert code == 1
    assert "run 1 differs from the sweep" in error
    assert "risk 0.5 in the sweep, now " in error
    assert "decision 'swerve' in the sweep" in error
    assert "reaction" not in error


def test_a_changed_input_is_refused(swept: Path, call: Call) -> None:
    model = Path("model.json")
    model.write_text(model.read_text() + "\n")
    code, said, error = call("sweep", "repeat", "out", 0, "--out", "again")
    assert (code, said) == (2, "")
    assert "model.json: has changed since the sweep" in error
    model.unlink()
    code, _, error = call("sweep", "repeat", "out", 0, "--out", "again")
    assert code == 2
    assert "model.json" in error
    assert not Path("again").exists()


def test_a_run_that_is_not_there(swept: Path, call: Call) -> None:
    code, _, error = call("sweep", "repeat", "out", 4, "--out", "again")
    assert code == 2
    assert "has no run 4" in error
    assert "0 to 3" in error


@pytest.mark.slow
def test_a_sweep_with_another_vehicle_is_another_sweep(made: Path, call: Call, tmp_path: Path) -> None:
    out = tmp_path / "out"
    code, _, error = call("sweep", made / "sweep.toml", "--out", out, "--vehicle", "single-track")
    assert (code, "resim: " in error) == (0, False)
    assert json.loads((out / "manifest.json").read_text())["inputs"]["vehicle"] == "single-track"
    cases = [
        duckdb.sql(f"select \"case\" from '{folder}/runs/*.parquet' order by run").fetchall()
        for folder in (made / "out", out)
    ]
    assert len({case for each in cases for case in each}) == len(cases[0]) + len(cases[1])
    code, _, error = call("sweep", made / "sweep.toml", "--out", out, "--resume")
    assert code == 2
    assert "vehicle has changed when the sweep began" in error
    assert call("sweep", "repeat", out, "0", "--out", tmp_path / "same")[0] == 0
    assert json.loads((tmp_path / "same" / "run.json").read_text())["vehicle"] == "single-track"
    code, _, error = call("sweep", "repeat", out, "0", "--out", tmp_path / "other", "--vehicle", "kinematic")
    assert code == 1
    assert "case '" in error
    code, _, error = call("sweep", "repeat", out, "0", "--out", tmp_path / "none", "--vehicle", "boat")
    assert code == 2
    assert "there is no vehicle model 'boat'; there are: kinematic, single-track" in error
