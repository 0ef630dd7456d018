"""Variations as parameters of a sweep: which drive a run is of, how far it is, and what is legitimised."""

import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from traced import kernel_file

from resim.core.errors import InputError
from resim.jobs.sweep import SweepOptions, report_sweep, sweep
from resim.jobs.vary import VaryOptions, vary
from resim.recordings import read_recording
from resim.resimulation.run import prepare
from resim.simulation.reactive.settings import ReactiveSettings
from resim.sweeps.file import read_sweep
from resim.sweeps.sweep_file import read_sweep_file
from resim.sweeps.varied import SweptDriver, _unlike, vary_recording
from resim.variations.kernels import write_kernels
from resim.variations.settings import VariationSettings, WhatVaries

ROOT = Path(__file__).parents[2]
FILE = """name = "varied"
criteria = "{root}/scenarios/criteria/highway.toml"
build = ["{root}/adfunc/builds/idm-1.0.toml"]
engine = "direct"
seeds = 1
{plan}

[variation]
kernels = "kernels.json"
object = ["1"]
maneuver = ["lane_change_right"]
box = 0.02

[[recording]]
folder = "{root}/scenarios/cut_in_brake"

{parameters}
"""
NUMBER = '[[parameter]]\nname = "variation.number"\nlow = 0.0\nhigh = {high}\nsteps = {steps}\n'


def written(folder: Path, parameters: str, plan: str = "") -> Path:
    write_kernels(kernel_file("lane_change_right"), folder / "kernels.json")
    path = folder / "varied.toml"
    path.write_text(FILE.format(root=ROOT, parameters=parameters, plan=plan), encoding="utf-8")
    return path


@pytest.mark.slow
def test_a_run_is_of_the_variation_of_its_number(tmp_path: Path) -> None:
    file = written(tmp_path, NUMBER.format(high=3.0, steps=4))
    rows = sweep(file, tmp_path / "out", SweepOptions(workers=1)).table
    assert rows["failure"].isna().all()
    options = VaryOptions(WhatVaries(("1",), ("lane_change_right",)), VariationSettings(box=0.02), write=False,
                          workers=1)  # fmt: skip
    same = vary(
        ROOT / "scenarios" / "cut_in_brake",
        tmp_path / "kernels.json",
        tmp_path / "v",
        count=3,
        options=options,
    )
    np.testing.assert_allclose(rows["variation_distance"], [0.0, *same.table["distance"]], rtol=1e-12)
    assert (rows["variation_trust"] == "unknown").all()
    assert rows["case"].nunique() == 4
    found = report_sweep(tmp_path / "out")
    assert found.variations == {"unknown": 4}
    page = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert "4 of 4 runs are not legitimised by a verified range of their origin" in page


@pytest.mark.parametrize(
    ("changed", "swept", "why"),
    [
        ({}, [], ""),
        (
            {"settings": ("latency.speed=0.1",)},
            [],
            "another perception model (with parameters set) was verified",
        ),
        ({"build": "other"}, [], "another build was verified"),
        ({"perception": None}, [], "another perception model was verified"),
        ({"vehicle": "single_track"}, [], "another vehicle model was verified"),
        ({"traffic": ReactiveSettings()}, [], "another traffic was verified"),
        ({}, ["perception.latency.speed"], "perception.latency.speed is swept"),
    ],
)
def test_trust_is_that_of_what_was_verified(changed: dict[str, object], swept: list[str], why: str) -> None:
    files = {"build": SimpleNamespace(hash="b"), "perception": SimpleNamespace(hash="p")}
    changed = dict(changed)
    settings = changed.pop("settings", ())
    verified = SimpleNamespace(**files, vehicle="kinematic", traffic=None, settings=settings)
    setup = replace(SweptDriver("b", "p", "kinematic", None), **changed)  # type: ignore[arg-type]
    assert _unlike(verified, setup, swept) == why  # type: ignore[arg-type]


@pytest.mark.slow
def test_components_move_by_standard_deviations(tmp_path: Path) -> None:
    parameter = '[[parameter]]\nname = "variation.c{}"\nvalues = [0.0, {}]\n'
    file = written(tmp_path, parameter.format(1, 0.1) + parameter.format(2, -0.2))
    rows = sweep(file, tmp_path / "out", SweepOptions(workers=1)).table
    wanted = np.hypot(rows["variation.c1"], rows["variation.c2"])
    np.testing.assert_allclose(rows["variation_distance"], wanted, rtol=1e-9)


def test_what_a_sweep_accepts_holds_for_its_variations(tmp_path: Path) -> None:
    """Each run of a drive whose map has an accepted error failed for it: far behind the drive, here."""
    drive = tmp_path / "drive"
    shutil.copytree(ROOT / "scenarios" / "cut_in_brake", drive)
    settings = (drive / "recording.toml").read_text("utf-8")
    (drive / "recording.toml").write_text(settings.replace("../../networks/", ""), encoding="utf-8")
    road = (ROOT / "networks" / "proving_ground.xodr").read_text("utf-8")
    (drive / "proving_ground.xodr").write_text(
        road.replace('x="1200.0" y="0.0"', 'x="1200.0" y="2.0"'), "utf-8"
    )
    file = written(tmp_path, NUMBER.format(high=1.0, steps=2), 'accept = ["LINE_GAP"]')
    file.write_text(file.read_text("utf-8").replace(f"{ROOT}/scenarios/cut_in_brake", str(drive)), "utf-8")
    made, recording = read_sweep(file), read_recording(drive)
    assert made.varied is not None
    setup = SweptDriver("b", None, "kinematic", None)
    digest, values = made.hashes[next(iter(made.hashes))], {"variation.number": 1.0}
    with pytest.raises(InputError, match="LINE_GAP"):
        prepare(recording, ())
    prepared = prepare(recording, (), ("LINE_GAP",))
    _, told = vary_recording(prepared, digest, made.varied, values, setup)
    assert told["variation_trust"] == "unknown"


@pytest.mark.parametrize(
    ("parameters", "plan", "problem"),
    [
        (NUMBER.format(high=3.0, steps=3), "", "expected whole numbers from 0 on"),
        (NUMBER.format(high=3.0, steps=4), 'plan = "halton"', "expected whole numbers from 0 on"),
        ('[[parameter]]\nname = "variation.speed"\nvalues = [1.0]\n', "", "there are variation.number"),
        ('[[parameter]]\nname = "function.threat_time"\nvalues = [1.0]\n', "", "without a parameter of it"),
    ],
)
def test_what_cannot_be_swept_is_refused(tmp_path: Path, parameters: str, plan: str, problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        read_sweep_file(written(tmp_path, parameters, plan))
