"""Errors of input are told before what computes is imported."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DRIVE, MAP = ROOT / "scenarios" / "rear_end", ROOT / "networks" / "proving_ground.xodr"
PILOT, MODEL = ROOT / "adfunc/builds/highway_pilot-1.0.toml", ROOT / "adfunc/perception/none.json"
FILES = {
    "suite.toml": ROOT / "scenarios/suites/highway.toml",
    "sweep.toml": ROOT / "scenarios/sweeps/perception_latency.toml",
    "criteria.toml": ROOT / "scenarios/criteria/highway.toml",
}
SLOW = (
    "numba",
    "libsumo",
    "scipy",
    "pandas",
    "duckdb",
    "lxml",
    "resim.resimulation",
    "resim.road.opendrive.network",
)
CALLED = f"import sys; from resim.cli import main\ntry: main()\nfinally: print([x for x in {SLOW} if x in sys.modules])"


def write(folder: Path) -> None:
    """A recording, a criteria file, a suite and a sweep with a misspelt field each, and good ones."""
    for name, file in FILES.items():
        text = re.sub(r'"(\.\.?/)', f'"{file.parent}/\\1', file.read_text())
        (folder / name).write_text(text)
        (folder / f"bad_{name}").write_text(f'nam = "x"\n{text}')
    sweep = (folder / "sweep.toml").read_text()
    (folder / "wrong_sweep.toml").write_text(sweep.replace("latency.speed", "latency.sped"))
    for name in ("drive", "keys", "no_gt", "no_map"):
        (folder / name).mkdir()
        road = MAP if name != "no_map" else "none.xodr"
        text = f'name = "x"\nmap = "{road}"\nego = "a"\n'
        (folder / name / "recording.toml").write_text(f"gt_rat = 2\n{text}" if name == "keys" else text)
        if name != "no_gt":
            (folder / name / "gt.csv").write_text("t,id\n")
    (folder / "empty").mkdir()


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        ("check keys", "gt_rat: there is no such field, did you mean 'gt_rate'?"),
        ("run keys --build {pilot} --out o", "gt_rat: there is no such field"),
        ("check no_gt", "holds neither gt.csv nor gt.parquet"),
        ("run no_gt --build {pilot} --out o", "holds neither gt.csv nor gt.parquet"),
        ("assess no_map", "map: there is no file"),
        ("assess drive --criteria bad_criteria.toml", "nam: there is no such field, did you mean 'name'?"),
        ("run drive --build {pilot} --out o --vehicle kinmatic", "'kinmatic', did you mean 'kinematic'?"),
        ("sweep sweep.toml --out o --vehicle kinmatic", "'kinmatic', did you mean 'kinematic'?"),
        ("sweep bad_sweep.toml --out o", "nam: there is no such field, did you mean 'name'?"),
        (
            "sweep wrong_sweep.toml --out o",
            "parameter 'perception.latency.sped': there is no such field, did you mean 'speed'?",
        ),
        ("verify bad_suite.toml", "nam: there is no such field, did you mean 'name'?"),
        (
            "verify suite.toml --build {pilot} --out o --vary sped",
            "--vary: there is no 'sped', did you mean 'speed'?",
        ),
        ("verify suite.toml --build {pilot} --out o --set latency.speed=1", "without a model"),
        ("verify suite.toml --build {pilot} --out o --seeds 3", "are runs with a perception model"),
        ("play drive nowhere", "nowhere: there is no such file or folder"),
        ("suite new empty --out s.toml --criteria criteria.toml", "empty: holds no recording"),
        ("sweep report nowhere", "nowhere: holds no sweep"),
        ("sweep repeat nowhere 3 --out o", "nowhere: holds no sweep"),
    ],
)
def test_it_is_told_before_what_computes_is_imported(tmp_path: Path, words: str, problem: str) -> None:
    write(tmp_path)
    command = [sys.executable, "-c", CALLED, *words.format(pilot=PILOT).split()]
    done = subprocess.run(command, cwd=tmp_path, env=os.environ, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "[]\n"), done.stderr
    assert problem in done.stderr
    assert not (tmp_path / "o").exists()
