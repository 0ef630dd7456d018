"""That the EGO does not collide, or decides as measured, is told of runs that show it to the end, and of no others."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd
import pytest
from conftest import ROOT

FUNCTION = """
from resim.simulation.function.interface import Command

class Veers:
    def __init__(self, bend=0.0):
        self.bend = bend

    def reset(self, setup):
        pass

    def step(self, p):
        return Command(0.0, self.bend)

    def close(self):
        pass
"""
CRITERIA = """
name = "comfort"
[[criterion]]
name = "braking"
measure = "longitudinal acceleration"
below = -6.0
"""
SWEEP = """
name = "veers"
criteria = "comfort.toml"
build = ["veers.toml"]
plan = "grid"
seeds = 1
engine = "direct"

[[recording]]
folder = "{drive}"

[[parameter]]
name = "function.bend"
values = [-0.1, 0.0, 0.02]
"""


def swept(home: Path, drive: str, last: float) -> pd.DataFrame:
    """A sweep of a drive 40 m behind somebody who is seen until `last` [s]."""
    size = {"kind": "car", "y": -5.25, "heading": 0.0, "v": 20.0, "length": 4.7, "width": 1.9}
    rows = [
        {"t": t, "id": name, "x": at + 20.0 * t, **size}
        for t in np.arange(0.0, 6.01, 0.04).round(2).tolist()
        for name, at in (("ego", 230.0), ("lead", 270.0))
        if name == "ego" or t <= last
    ]
    folder = home / drive
    folder.mkdir()
    pd.DataFrame(rows).to_csv(folder / "gt.csv", index=False)
    road = ROOT / "networks" / "proving_ground.xodr"
    (folder / "recording.toml").write_text(f'name = "d"\nmap = "{road}"\nego = "ego"\n', encoding="utf-8")
    (home / "veers.py").write_text(FUNCTION, encoding="utf-8")
    (home / "comfort.toml").write_text(CRITERIA, encoding="utf-8")
    build = 'name = "b"\nversion = "1"\nfactory = "veers:Veers"\n'
    (home / "veers.toml").write_text(build, encoding="utf-8")
    file, out = home / f"{drive}.toml", home / f"out_{drive}"
    file.write_text(SWEEP.format(drive=drive), encoding="utf-8")
    order = [sys.executable, "-m", "resim", "sweep", str(file), "--out", str(out), "--workers", "1"]
    done = subprocess.run(order, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    told = subprocess.run(
        [*order[:4], "report", str(out)], capture_output=True, text=True, check=False
    ).stdout
    assert "does not collide: met in every run" not in " ".join(told.split())
    return duckdb.sql(f"select * from '{out}/runs/*.parquet' order by \"function.bend\"").df()


@pytest.mark.slow
def test_a_run_that_leaves_the_road_does_not_show_that_it_would_not_have_collided(tmp_path: Path) -> None:
    runs = swept(tmp_path, "whole", 6.0)
    assert runs["end"].tolist() == ["off_road", "duration", "off_road"]
    assert runs["collision"].isna().tolist() == [True, False, True]
    assert not runs["collision"][1]
    # the first does nothing, as measured, until it leaves the road; the last has changed lanes by then
    assert runs["decision"].eq("").tolist() == [True, True, False]
    assert runs["same_decision"].isna().tolist() == [True, False, False]
    assert runs["same_decision"][1:].tolist() == [True, False]


@pytest.mark.slow
def test_who_is_not_seen_may_have_been_hit_though_no_criterion_asks(tmp_path: Path) -> None:
    runs = swept(tmp_path, "gone", 3.0)
    assert runs["end"][1] == "duration"
    assert runs["collision"].isna().all()
