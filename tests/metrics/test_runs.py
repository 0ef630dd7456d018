"""What `resim run` judges besides: runs with a perception model, and what the recording leaves open."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pandas as pd
import pytest
from conftest import ROOT

TRAFFIC = ROOT / "scenarios" / "criteria" / "traffic.toml"
PILOT = ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml"
BLIND = '{"schema": "resim-perception-1", "name": "blind", "field_of_view": {"range": 1.0, "bearing": 1.0}}'


def assessment(folder):
    return json.loads((folder / "assessment.json").read_text())


@pytest.fixture
def gap(tmp_path):
    """A shipped drive whose lead is left out for 4 s while the EGO closes in."""
    folder = tmp_path / "gap"
    shutil.copytree(ROOT / "scenarios" / "neighbours" / "lead_brakes_softly", folder)
    text = (folder / "recording.toml").read_text()
    folder.joinpath("recording.toml").write_text(text.replace("../../../networks", str(ROOT / "networks")))
    gt = pd.read_csv(folder / "gt.csv")
    gt[(gt.id == "ego") | ((gt.t - 6.0).abs() > 2.0)].to_csv(folder / "gt.csv", index=False)
    return folder


def test_the_runs_with_a_perception_model_are_judged(call, tmp_path):
    (tmp_path / "blind.json").write_text(BLIND)
    criteria = tmp_path / "crash.toml"
    criteria.write_text(
        'name = "c"\n[[criterion]]\nname = "no collision"\nmeasure = "collision"\nabove = 0.0\n'
    )
    code, out, error = call(
        "run", ROOT / "scenarios" / "neighbours" / "lead_brakes_hard", "--build", PILOT, "--out", tmp_path / "out",
        "--basis", "gt", "--criteria", criteria, "--perception", tmp_path / "blind.json", "--seeds", "2",
    )  # fmt: skip
    found = assessment(tmp_path / "out")
    assert {name: found[name]["verdict"] for name in ("GT", "rGT", "rGT+M")} == {
        "GT": "PASS", "rGT": "PASS", "rGT+M": "FAIL",
    }  # fmt: skip
    assert code == 1
    assert "rGT+M FAIL (0 of 2 seeds pass)" in error
    assert "rGT+M: FAIL no collision: 2 of 2 seeds; seed 0: above 0" in out
    assert "rGT+M: collides in 2 of 2 seeds" in out
    model = found["rGT+M"]
    assert (model["collisions"], model["counts"]) == (2, {"PASS": 0, "INVALID": 0, "FAIL": 2})
    assert model["criteria"]["no collision"]["share"] == 0.0
    assert "0 of 2 seeds pass" in (tmp_path / "out" / "report.html").read_text()
    code, out, error = call("assess", tmp_path / "out", "--criteria", criteria, "--out", tmp_path / "again")
    assert code == 1
    assert assessment(tmp_path / "again")["rGT+M"] == model


@pytest.mark.slow
def test_what_a_recording_leaves_open_is_open_in_its_re_simulation(call, gap, tmp_path):
    code, out, _ = call(
        "run", gap, "--build", PILOT, "--out", tmp_path / "out", "--basis", "gt", "--criteria", TRAFFIC
    )  # fmt: skip
    assert code == 1
    assert "gt 1 at 3.96 s: GAP" in out
    found = assessment(tmp_path / "out")
    for source in ("GT", "rGT"):
        verdicts = found[source]["criteria"]
        assert verdicts["time to collision"]["verdict"] == "INVALID"
        assert verdicts["time to collision"]["reason"].startswith("object 1 from 3.96 to 8.04 s: not seen")
        assert verdicts["hard braking"]["verdict"] == "PASS"
    code, out, _ = call("assess", tmp_path / "out", "--criteria", TRAFFIC, "--out", tmp_path / "again")
    assert code == 1
    assert "finding: gt 1 at 3.96 s: GAP" in out
    again = assessment(tmp_path / "again")
    assert {name: again[name] for name in ("GT", "rGT", "findings")} == {
        name: found[name] for name in ("GT", "rGT", "findings")
    }


def test_findings_are_printed_and_written_by_assess(call, gap, tmp_path):
    _, out, _ = call("assess", gap, "--out", tmp_path / "out")
    assert "finding: gt 1 at 3.96 s: GAP: no sample from 3.96 to 8.04 s" in out
    assert assessment(tmp_path / "out")["findings"][0].startswith("gt 1 at 3.96 s: GAP")
    assert "GAP: no sample from 3.96" in (tmp_path / "out" / "assessment.html").read_text()


SWERVES = """
from resim.simulation.function.interface import Command

class F:
    def reset(self, setup):
        self.start = None
    def step(self, seen):
        self.start = seen.t if self.start is None else self.start
        t, v = seen.t - self.start, seen.ego.v
        return Command(-0.6, -3.0 / v**2 if t > SINCE else 0.0)
    def close(self):
        pass
"""


def test_a_run_that_leaves_the_road_early_passes_nothing(call, tmp_path):
    """What it breaks in its last scenes it may have broken for long."""
    (tmp_path / "f.py").write_text(SWERVES.replace("SINCE", "8.0"))
    (tmp_path / "b.toml").write_text('name = "b"\nversion = "1"\nfactory = "f:F"\n')
    code, out, error = call(
        "run", ROOT / "scenarios" / "neighbours" / "lead_slows", "--build", tmp_path / "b.toml",
        "--out", tmp_path / "out", "--basis", "gt", "--criteria", TRAFFIC,
    )  # fmt: skip
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["end"]["rGT"] == "off_road"
    found = assessment(tmp_path / "out")["rGT"]
    assert found["verdict"] != "PASS"
    assert "PASS" not in {v["verdict"] for v in found["criteria"].values()}
    assert "by leaving the road: what would have come is not known" in out
    assert code == 1
    assert "does not pass the criteria 'traffic': rGT" in error


def test_a_trace_that_is_off_is_told_alike_by_run_and_assess(call, tmp_path):
    """Object 1 is 0.3 m beside its way for 0.2 s, which no spline of a vehicle follows."""
    folder = tmp_path / "off"
    shutil.copytree(ROOT / "scenarios" / "rear_end", folder)
    text = (folder / "recording.toml").read_text()
    folder.joinpath("recording.toml").write_text(text.replace("../../networks", str(ROOT / "networks")))
    gt = pd.read_csv(folder / "gt.csv")
    gt.loc[(gt.id.astype(str) == "1") & ((gt.t - 4.0).abs() < 0.1), "y"] += 0.3
    gt.to_csv(folder / "gt.csv", index=False)
    code, out, error = call("run", folder, "--build", PILOT, "--basis", "gt", "--out", tmp_path / "out")
    assert code == 0, error
    (line,) = (note for note in assessment(tmp_path / "out")["notes"] if "fitted traces miss" in note)
    assert line.startswith("GT: fitted traces miss their positions by more than noise: 1 by 0.")
    assert out.count("fitted traces miss") == 1
    assert line in json.loads((tmp_path / "out" / "report.json").read_text())["warnings"]
    _, again, _ = call("assess", tmp_path / "out", "--out", tmp_path / "again")
    assert again.count("fitted traces miss") == 1
    assert (tmp_path / "again" / "assessment.json").read_bytes() == (
        tmp_path / "out" / "assessment.json"
    ).read_bytes()


BRAKES = """
from resim.simulation.function.interface import Command

class F:
    def reset(self, setup): pass
    def step(self, seen): return Command(-3.0 if seen.ego.v > 2.0 else 0.0, 0.0)
    def close(self): pass
"""


def out_of_sight(folder, *, behind):
    """Three vehicles that leave the EGO, which brakes, ahead of it, or come from behind it; seen up to 60 m from it."""
    t = np.round(np.arange(0.0, 10.01, 0.04), 9)
    v = np.full(len(t), 20.0) if behind else np.clip(20.0 - 4.0 * (t - 2.0), 8.0, 20.0)
    x = 200.0 + np.concatenate([[0.0], np.cumsum(0.5 * np.diff(t) * (v[1:] + v[:-1]))])
    tracks = [pd.DataFrame({"t": t, "id": "ego", "x": x, "y": -5.25, "v": v})]
    for k, (name, y) in enumerate((("c", -5.25), ("F", -1.75), ("G", -8.75))):
        own = (60.0 - 3.0 * k + 30.0 * t) if behind else (240.0 + k + 16.0 * t)
        track = pd.DataFrame({"t": t, "id": name, "x": own, "y": y, "v": 30.0 if behind else 16.0})
        tracks.append(track[np.abs(own - x) < 60.0])
    folder.mkdir()
    gt = pd.concat(tracks).assign(heading=0.0, length=4.7, width=1.9, kind="car").sort_values("t")
    gt.to_csv(folder / "gt.csv", index=False)
    road = ROOT / "networks" / "proving_ground.xodr"
    (folder / "recording.toml").write_text(f'name = "n"\nmap = "{road}"\nego = "ego"\n')
    return folder


@pytest.mark.parametrize("behind", [False, True])
def test_who_left_the_measured_ego_is_not_gone_for_one_that_drives_otherwise(call, tmp_path, behind):
    folder = out_of_sight(tmp_path / "n", behind=behind)
    (tmp_path / "f.py").write_text(BRAKES)
    (tmp_path / "brakes.toml").write_text('name = "b"\nversion = "1"\nfactory = "f:F"\n')
    builds = ROOT / "adfunc" / "builds"
    other = tmp_path / "brakes.toml" if behind else builds / "constant_velocity-1.0.toml"
    verdicts = {}
    for name, build in (("same", builds / "replay-1.0.toml"), ("other", other)):
        out = tmp_path / name
        call("run", folder, "--build", build, "--out", out, "--basis", "gt", "--criteria", TRAFFIC)
        found = assessment(out)
        assert found["GT"]["criteria"]["no collision"]["verdict"] == "PASS"
        verdicts[name] = found["rGT"]["criteria"]["no collision"]
        call("assess", out, "--criteria", TRAFFIC, "--out", tmp_path / f"{name} again")
        assert assessment(tmp_path / f"{name} again")["rGT"] == found["rGT"]
    assert verdicts["same"]["verdict"] == "PASS"
    assert verdicts["other"]["verdict"] == "INVALID"
    assert "not seen there by the measured EGO, while this EGO is nearer" in verdicts["other"]["reason"]
