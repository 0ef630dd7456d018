"""A space of test drives, covered by simulated ones, and judged: all commands of `resim space` one after the other."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from typer.testing import CliRunner

from resim.cli import app
from resim.jobs.mine import MineOptions, mine
from resim.jobs.schemas import schema_of
from resim.jobs.sweep import SweepOptions, sweep
from resim.jobs.verify import VerifyOptions, verify
from resim.recordings.tables import read_parquet

ROOT = Path(__file__).parents[2]
BUILD = ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml"
LIMITS = ROOT / "scenarios" / "criteria" / "release.toml"
SUITE = """name = "suite"
criteria = "{root}/scenarios/criteria/highway.toml"
bases = ["GT"]
reports = 0
[[recording]]
folder = "{drive}"
"""
VARIATIONS = """name = "variations"
criteria = "{root}/scenarios/criteria/highway.toml"
build = ["{build}"]
engine = "direct"
seeds = 1
[variation]
kernels = "{root}/scenarios/kernels/motorway.json"
verified = "verified/verification.json"
[[recording]]
folder = "{drive}"
[[parameter]]
name = "variation.number"
low = 0.0
high = 3.0
steps = 4
"""


def run(*told: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, [*map(str, told)])
    return done.exit_code, done.output


def verified(folder: Path, name: str, drive: Path, *vary: str) -> Path:
    (folder / f"{name}.toml").write_text(SUITE.format(root=ROOT, drive=drive), encoding="utf-8")
    found = verify(folder / f"{name}.toml", BUILD, folder / name, VerifyOptions(vary=vary), workers=1)
    assert [one.verdict for one in found.report.recordings] == ["verified"]
    return folder / name


@pytest.mark.slow
def test_a_space_is_built_covered_and_judged(tmp_path: Path) -> None:
    asked = MineOptions(around="surroundings", fit=False, accept=("OVERLAP",))
    mined = mine([ROOT / "scenarios" / "cut_in_brake"], tmp_path / "mined", asked)
    drive = tmp_path / "mined" / mined.scenarios["folder"].iloc[0]
    space = tmp_path / "space"
    assert run("space", "build", tmp_path / "mined", "--out", space)[0] == 0

    tested = verified(tmp_path, "verified", drive, "speed")
    file = tmp_path / "variations.toml"
    file.write_text(VARIATIONS.format(root=ROOT, build=BUILD, drive=drive), encoding="utf-8")
    rows = sweep(file, tmp_path / "swept", SweepOptions(workers=1)).table
    assert rows["variation_trust"].tolist() == ["inside"] * 4
    spared = verified(tmp_path, "spared", ROOT / "scenarios" / "overtake")

    folders = ("--sweep", tested, "--sweep", tmp_path / "swept", "--held-out", spared)
    code, words = run("space", "cover", space, *folders)
    assert code == 0, words
    assert "1 verified test drive" in words
    assert "4 simulated members that count" in words
    assert "predicted risk: not shown" in words
    members = read_parquet(space / "members.parquet").set_index("member")
    assert members["cluster"].tolist() == ["1.1"] * 5
    # the measured drive is variation 0 as well: no further evidence
    assert members.index[~members["counts"]].tolist() == ["swept:0"]
    told = json.loads((space / "cover.json").read_text())
    jsonschema.validate(told, schema_of("cover"))
    (cluster,) = told["clusters"]
    assert (cluster["measured"], cluster["counted"], cluster["not_counted"]) == (1, 4, 1)
    swept = rows.set_index(rows["run"].map("swept:{}".format))["risk"]
    np.testing.assert_array_equal(members.loc[swept.index, "risk"], swept)
    assert "not shown: not calibrated" in (space / "cover.html").read_text()

    code, words = run("space", "release", space, "--limits", LIMITS, "--out", tmp_path / "release")
    assert code == 1
    assert words.startswith("not shown: The function may not be released")
    told = json.loads((tmp_path / "release" / "release.json").read_text())
    jsonschema.validate(told, schema_of("release"))
    assert [one["cluster"] for one in told["forbidding"]] == ["1.1"]
    assert told["budgets"][0]["high"] > told["budgets"][0]["unseen"] > 0.0

    # commands repeat members, given in the space's folder
    for member in ("swept:2", f"verified:{drive.name.replace('+', '_')}"):
        words = shlex.split(members.loc[member, "repeat"])
        assert words[0] == "resim"
        subprocess.run([sys.executable, "-m", "resim", *words[1:]], cwd=space, check=True)
    assert (
        tmp_path / "repeated" / "report.json"
    ).is_file()  # of the drive; of variations no traces are written
