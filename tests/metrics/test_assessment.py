"""`resim assess`, on what ships and on what a run wrote."""

from __future__ import annotations

import json
import shutil

import duckdb
import numpy as np
import pandas as pd
import pytest
from conftest import ROOT

HIGHWAY = ROOT / "scenarios" / "criteria" / "highway.toml"


def written(path):
    return json.loads((path / "assessment.json").read_text())


def test_a_recording_is_assessed_on_gt_with_sd_beside(call, tmp_path):
    code, out, error = call("assess", ROOT / "scenarios" / "cut_in_brake", "--out", tmp_path / "a")
    assert code == 0, error
    assert "risk" in out
    assert {p.name for p in (tmp_path / "a").iterdir()} >= {"assessment.json", "kpis.parquet"}
    whole = written(tmp_path / "a")
    for found in (whole, whole["SD"]):
        times = len(found["t"])
        assert np.diff(found["t"]) == pytest.approx(0.1)
        assert found["path"] == ["plan"] * times  # the function that drove told what it was about to do
        for values in (found["risk"]["r_ind"], found["risk"]["r_dep"], found["risk"]["r_to"]["1"]):
            assert len(values) == times
        for name, columns in found["measures"].items():
            for who, values in columns.items():
                for number, reason in zip(values, found["reasons"][name][who], strict=True):
                    assert (number is None) == (reason != "")
        assert (np.array(found["risk"]["r_dep"]) <= np.array(found["risk"]["r_ind"]) + 1e-12).all()
    assert 0.005 < max(whole["risk"]["r_ind"]) < 0.2
    assert set(whole["kinds"].values()) == {"functional", "quantitative", "legal"}


def test_without_the_plan_its_state_is_kept(call, tmp_path):
    out = {}
    for path in ("state", "driven"):
        assert (
            call("assess", ROOT / "scenarios" / "cut_in_brake", "--path", path, "--out", tmp_path / path)[0]
            == 0
        )
        out[path] = written(tmp_path / path)
        assert set(out[path]["path"]) == {path}
    assert max(out["state"]["risk"]["r_ind"]) > max(out["driven"]["risk"]["r_ind"])  # it did brake, later


def test_predictions_may_know_the_road_but_not_as_published(call, tmp_path):
    drive = ROOT / "scenarios" / "overtake"
    assert call("assess", drive, "--road-aware", "--out", tmp_path / "a")[0] == 0
    found = written(tmp_path / "a")
    assert (found["road_aware"], found["prediction"]) == (True, "published")
    code, out, error = call("assess", drive, "--road-aware", "--mode", "published")
    assert (code, out) == (2, "")
    assert "--road-aware: the published mode does not use the road" in error


def test_the_rear_end_collision_is_full_risk_and_nothing_is_lost_in_json(call, tmp_path):
    code, out, error = call(
        "assess", ROOT / "scenarios" / "rear_end", "--out", tmp_path / "a", "--mode", "published"
    )
    assert code == 0, error
    found = written(tmp_path / "a")
    assert max(found["risk"]["r_ind"]) > 0.95
    assert min(x for x in found["measures"]["TTC"]["1"] if x is not None) < 0.5
    assert "unbounded" in found["reasons"]["DRAC"]["1"]
    assert "beyond any" in out


def test_the_same_drive_gives_the_same_bytes(call, tmp_path):
    for name in "ab":
        assert call("assess", ROOT / "scenarios" / "rear_end", "--out", tmp_path / name)[0] == 0
    for file in ("assessment.json", "kpis.parquet"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_a_run_is_assessed_on_each_of_its_sources_now_and_later(call, tmp_path):
    build = ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml"
    scenario, run = ROOT / "scenarios" / "cut_in_brake", tmp_path / "run"
    code, out, error = call("run", scenario, "--build", build, "--criteria", HIGHWAY, "--out", run)
    assert code == 1
    assert "does not pass the criteria 'highway': rGT FAIL" in error
    assert "largest accident risk: GT " in out
    found = written(run)
    assert [name for name in found if name in ("GT", "SD", "rGT", "rSD")] == ["GT", "SD", "rGT", "rSD"]
    assert found["GT"]["criteria"]["braking for comfort"]["verdict"] == "FAIL"
    assert found["rGT"]["criteria"]["braking for comfort"]["verdict"] == "PASS"
    peaks = {name: max(found[name]["risk"]["r_ind"]) for name in ("GT", "rGT", "rSD")}
    assert peaks["GT"] > peaks["rSD"] > peaks["rGT"]  # Fig. 5.9: the re-simulated function answers earlier
    assert found["rGT"]["path"][5:] == ["plan"] * (len(found["rGT"]["t"]) - 5)
    assert found["rGT"]["measures"]["detection rate"]["ego"][-1] == 1.0
    assert call("assess", run, "--criteria", HIGHWAY, "--out", tmp_path / "again")[0] == 1
    for file in ("assessment.json", "kpis.parquet"):
        assert (run / file).read_bytes() == (tmp_path / "again" / file).read_bytes()


def test_a_function_without_plans_that_collides_fails_by_its_state(call, tmp_path):
    build = ROOT / "adfunc" / "builds" / "constant_velocity-1.0.toml"
    run = tmp_path / "run"
    code, _, _ = call(
        "run", ROOT / "scenarios" / "rear_end", "--build", build, "--criteria", HIGHWAY, "--out", run
    )
    assert code == 1
    assert json.loads((run / "report.json").read_text())["end"]["rGT"] == "collision"
    found = written(run)["rGT"]
    assert found["criteria"]["no collision"]["verdict"] == "FAIL"
    assert set(found["path"]) == {"state"}
    assert call("assess", run, "--criteria", HIGHWAY, "--out", tmp_path / "again")[0] == 1
    assert (run / "assessment.json").read_bytes() == (tmp_path / "again" / "assessment.json").read_bytes()


def test_kpis_are_rows_that_a_query_finds(call, tmp_path):
    assert (
        call("assess", ROOT / "scenarios" / "rear_end", "--criteria", HIGHWAY, "--out", tmp_path / "a")[0]
        == 1
    )
    kpis = duckdb.sql(f"SELECT * FROM '{tmp_path / 'a' / 'kpis.parquet'}'").df()
    assert set(kpis.source) == {"GT", "SD"}
    gt = kpis[(kpis.source == "GT") & (kpis.row == "criterion")].set_index("name")
    whole = written(tmp_path / "a")
    assert gt.verdict.to_dict() == {name: c["verdict"] for name, c in whole["criteria"].items()}
    assert gt.loc["no collision", ["object", "limit", "weight"]].tolist() == ["1", 0.0, 10.0]
    worst = kpis[(kpis.source == "GT") & (kpis.row == "measure")].set_index("name")
    assert worst.loc["TTC", "value"] == min(x for x in whole["measures"]["TTC"]["1"] if x is not None)
    assert set(worst.kind) == {"functional", "quantitative", "legal"}


@pytest.mark.parametrize("what", ["missing", "empty", "file"])
def test_what_is_no_drive_is_refused(call, tmp_path, what):
    path = tmp_path / what
    if what == "empty":
        path.mkdir()
    elif what == "file":
        path.write_text("no")
    code, out, error = call("assess", path)
    assert (code, out) == (2, "")
    assert error.count("\n") == 1
    assert str(path) in error


FAILS = """from resim.simulation.function.interface import Command


class Fails:
    def reset(self, setup): ...

    def step(self, perceived):
        if perceived.t >= {until}:
            raise ValueError("it broke")
        return Command(0.0, 0.0)

    def close(self): ...
"""


@pytest.mark.parametrize("until", [-99.0, 2.0])
def test_a_run_that_failed_passes_neither_now_nor_later(call, tmp_path, until):
    (tmp_path / "fails.py").write_text(FAILS.format(until=until))
    (tmp_path / "fails.toml").write_text('name = "fails"\nversion = "1"\nfactory = "fails:Fails"\n')
    run, drive = tmp_path / "run", ROOT / "scenarios" / "overtake"
    code, _, _ = call("run", drive, "--build", tmp_path / "fails.toml", "--criteria", HIGHWAY, "--out", run)
    assert code == 3
    code, out, error = call("assess", run, "--criteria", HIGHWAY, "--out", tmp_path / "again")
    assert code == 3
    assert "it broke" in error
    assert "note: rGT: " in out
    found = written(tmp_path / "again")
    assert "it broke" in found["failures"]["rGT"]
    if until > 0.0:
        assert found["rGT"]["verdict"] == "INVALID"
    else:
        assert "rGT" not in found
    assert (run / "assessment.json").read_bytes() == (tmp_path / "again" / "assessment.json").read_bytes()


def test_a_run_that_lost_a_scenario_is_refused(call, tmp_path):
    build = ROOT / "adfunc" / "builds" / "replay-1.0.toml"
    run = tmp_path / "run"
    assert call("run", ROOT / "scenarios" / "rear_end", "--build", build, "--out", run)[0] == 0
    for name in ("rGT", "GT"):
        (run / f"{name}.jscen.json").unlink()
        code, _, error = call("assess", run)
        assert code == 2
        assert ".jscen.json: cannot be read (No such file or directory). Run it again." in error


def test_an_object_that_was_seen_only_once_is_never_a_pass(call, tmp_path):
    folder = tmp_path / "once"
    shutil.copytree(ROOT / "scenarios" / "overtake", folder)
    text = (folder / "recording.toml").read_text()
    (folder / "recording.toml").write_text(text.replace("../../networks", str(ROOT / "networks")))
    gt = pd.read_csv(folder / "gt.csv")
    ego = gt[(gt.id == "ego") & (gt.t > 2.0)].iloc[0]
    ghost = {**ego.to_dict(), "id": "ghost[/1]", "x": ego.x + 40.0}
    pd.concat([gt, pd.DataFrame([ghost])]).sort_values(["t", "id"], kind="stable").to_csv(
        folder / "gt.csv", index=False
    )
    code, out, error = call("assess", folder, "--criteria", HIGHWAY)
    assert code == 1, error
    assert "GT INVALID" in error
    assert "GT: INVALID distance: object ghost[/1] from 0.00 to 10.00 s: not seen" in out


def test_a_run_that_lost_a_file_is_refused(call, tmp_path):
    build = ROOT / "adfunc" / "builds" / "replay-1.0.toml"
    run = tmp_path / "run"
    assert call("run", ROOT / "scenarios" / "rear_end", "--build", build, "--out", run)[0] == 0
    (run / "answers.parquet").write_bytes((run / "answers.parquet").read_bytes()[:100])
    code, _, error = call("assess", run)
    assert code == 2
    assert "answers.parquet: was changed after it was written: its SHA-256 is " in error


@pytest.mark.parametrize(
    ("options", "problem"),
    [(["--verdict-of", "SD"], "--verdict-of: SD without criteria has no effect"),
     (["--verdict-of", "rGT", "--criteria", HIGHWAY], "--verdict-of: rGT is not judged here; there are: GT")],
)  # fmt: skip
def test_who_is_to_decide_is_looked_at(call, options, problem):
    code, _, error = call("assess", ROOT / "scenarios" / "overtake", *options)
    assert (code, problem in error) == (2, True), error


def test_criteria_give_verdicts_and_the_exit_code(call, tmp_path):
    code, out, error = call(
        "assess", ROOT / "scenarios" / "rear_end", "--criteria", HIGHWAY, "--out", tmp_path / "a"
    )
    assert code == 1
    assert "does not pass the criteria 'highway'" in error
    assert "no collision" in out
    found = written(tmp_path / "a")
    assert found["verdict"] == "FAIL"
    collision = found["criteria"]["no collision"]
    assert (collision["verdict"], collision["object"], collision["limit"]) == ("FAIL", "1", 0.0)
    assert found["criteria"]["speed limit"]["verdict"] == "PASS"
    code, _, error = call("assess", ROOT / "scenarios" / "overtake", "--criteria", HIGHWAY)
    assert code == 0, error


def test_paths_of_several_kinds_are_told_with_the_command_that_makes_them_alike(call, tmp_path):
    build = ROOT / "adfunc" / "builds" / "idm-1.0.toml"
    drive = ROOT / "scenarios" / "cut_in_brake"  # its function had plans, and this one has none
    code, out, error = call("run", drive, "--build", build, "--basis", "gt", "--out", tmp_path / "run")
    assert code == 0, error
    told = "`resim assess RESULTS --path state` makes them comparable"
    assert told in " ".join(out.split())
    code, out, error = call("assess", tmp_path / "run", "--path", "state")
    assert code == 0, error
    assert "makes them comparable" not in out
