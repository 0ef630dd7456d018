"""`resim assess`, on what ships and on what a run wrote."""

from __future__ import annotations

import json

import numpy as np
import pytest
from conftest import ROOT


def block(path, name="GT"):
    return json.loads((path / "assessment.json").read_text())[name]


def test_a_recording_is_assessed_on_gt_and_sd(call, tmp_path):
    code, out, error = call("assess", ROOT / "scenarios" / "cut_in_brake", "--out", tmp_path / "a")
    assert code == 0, error
    assert "risk" in out
    assert [p.name for p in (tmp_path / "a").iterdir()] == ["assessment.json"]
    for name in ("GT", "SD"):
        found = block(tmp_path / "a", name)
        times = len(found["t"])
        assert np.diff(found["t"]) == pytest.approx(0.1)
        assert found["path"] == ["state"] * times
        for values in (found["risk"]["r_ind"], found["risk"]["r_dep"], *found["measures"]["TTC"].values()):
            assert len(values) == times
        for number, reason in zip(found["measures"]["TTC"]["1"], found["reasons"]["TTC"]["1"], strict=True):
            assert (number is None) == (reason != "")
    gt = block(tmp_path / "a")["risk"]["r_ind"]
    assert 0.005 < max(gt) < 0.2


def test_the_rear_end_collision_is_full_risk_and_nothing_is_lost_in_json(call, tmp_path):
    code, out, error = call(
        "assess", ROOT / "scenarios" / "rear_end", "--out", tmp_path / "a", "--mode", "published"
    )
    assert code == 0, error
    found = block(tmp_path / "a")
    assert max(found["risk"]["r_ind"]) > 0.95
    assert min(x for x in found["measures"]["TTC"]["1"] if x is not None) < 0.5
    assert "no number is enough" in found["reasons"]["DRAC"]["1"]
    assert "beyond any" in out


def test_the_same_drive_gives_the_same_bytes(call, tmp_path):
    for name in "ab":
        assert call("assess", ROOT / "scenarios" / "rear_end", "--out", tmp_path / name)[0] == 0
    assert (tmp_path / "a" / "assessment.json").read_bytes() == (
        tmp_path / "b" / "assessment.json"
    ).read_bytes()


def test_a_run_has_a_block_for_each_of_its_sources(call, tmp_path):
    build = ROOT / "adfunc" / "builds" / "replay-1.0.toml"
    assert call("run", ROOT / "scenarios" / "rear_end", "--build", build, "--out", tmp_path / "run")[0] == 0
    code, _, error = call("assess", tmp_path / "run", "--out", tmp_path / "a")
    assert code == 0, error
    blocks = {name: block(tmp_path / "a", name) for name in ("GT", "SD", "rGT", "rSD")}
    same = min(len(blocks["GT"]["t"]), len(blocks["rGT"]["t"]))
    gt, again = (np.array(blocks[name]["risk"]["r_ind"][: same - 5]) for name in ("GT", "rGT"))
    np.testing.assert_allclose(again, gt, atol=0.12)  # replayed, and described once more


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


def test_criteria_give_verdicts_and_the_exit_code(call, tmp_path):
    highway = ROOT / "scenarios" / "criteria" / "highway.toml"
    code, out, error = call(
        "assess", ROOT / "scenarios" / "rear_end", "--criteria", highway, "--out", tmp_path / "a"
    )
    assert code == 1
    assert "does not pass 'highway'" in error
    assert "no collision" in out
    found = block(tmp_path / "a")
    assert found["verdict"] == "FAIL"
    collision = found["criteria"]["no collision"]
    assert (collision["verdict"], collision["object"], collision["limit"]) == ("FAIL", "1", 0.0)
    assert found["criteria"]["speed limit"]["verdict"] == "PASS"
    code, _, error = call("assess", ROOT / "scenarios" / "overtake", "--criteria", highway)
    assert code == 0, error
