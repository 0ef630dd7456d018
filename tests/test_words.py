"""A misspelt name is told with the one that may be meant, and no fault in the words of a library."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DRIVE, MAP = ROOT / "scenarios" / "rear_end", ROOT / "networks" / "proving_ground.xodr"
PILOT, MODEL = (
    ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml",
    ROOT / "adfunc" / "perception" / "none.json",
)
SUITE = ROOT / "scenarios" / "suites" / "highway.toml"
SWEEP = ROOT / "scenarios" / "sweeps" / "perception_latency.toml"
CRITERIA = ROOT / "scenarios" / "criteria" / "highway.toml"
JARGON = re.compile(r"\^\[|\\w|String should|Input should|validation|keyword argument|__init__|_resim_")
Call = Callable[..., tuple[int, str, str]]


def edited(file: Path, folder: Path, old: str, new: str) -> Path:
    """A copy of a file with something else in it, paths as from where it was."""
    text = re.sub(r'"(\.\.?/[^"]*)"', lambda path: f'"{(file.parent / path[1]).resolve()}"', file.read_text())
    assert old in text
    (folder / file.name).write_text(text.replace(old, new, 1))
    return folder / file.name


def refused(call: Call, *words: object) -> str:
    code, _, error = call(*words)
    assert code == 2, error
    assert JARGON.search(error) is None, error
    return error


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("run", DRIVE, "--build", PILOT, "--out", "o", "--vehicle", "kinmatic"), "'kinematic'"),
        (("verify", SUITE, "--build", PILOT, "--out", "o", "--vary", "sped"), "'speed'"),
        (("assess", DRIVE, "--prediction", "publishd"), "'published'"),
        (("map", "convert", MAP, "--out", "o", "--accept", "LANEGAP"), "'LANE_GAP'"),
        (("assess", "fit-prediction", DRIVE, "--out", "o.json", "--kind", "cra"), "'car'"),
        (("run", DRIVE, "--build", PILOT, "--out", "o", "--perception", MODEL, "--set", "latency.sped=1"), "'speed'"),
    ],
)  # fmt: skip
def test_a_misspelt_option_is_told_with_what_may_be_meant(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[object, ...], told: str
) -> None:
    monkeypatch.chdir(tmp_path)
    error = refused(call, *words)
    assert f", did you mean {told}?" in error
    assert len(error) < 300


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('plan = "grid"', 'plan = "gird"', "found 'gird', did you mean 'grid'?"),
        ('engine = "direct"', 'engine = "sumoo"', "found 'sumoo', did you mean 'sumo'?"),
        ('plan = "grid"', 'paln = "grid"', "paln: there is no such field, did you mean 'plan'?"),
        (
            "perception.latency.speed",
            "perceptoin.latency.speed",
            "parameter.0.name: expected a name that begins with",
        ),
    ],
)
def test_a_misspelt_word_in_a_sweep(call: Call, tmp_path: Path, old: str, new: str, told: str) -> None:
    error = refused(call, "sweep", edited(SWEEP, tmp_path, old, new), "--out", tmp_path / "out")
    assert told in error
    assert "parameter: expected" not in error


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (
            "highway_pilot:HighwayPilot",
            "highway_pilot.HighwayPilot",
            "factory: expected a module and a name in it",
        ),
        (
            "[parameters]",
            "[parameters]\nthreat_tme = 2.0",
            "no parameter 'threat_tme', did you mean 'threat_time'?",
        ),
    ],
)
def test_a_misspelt_word_in_a_build(call: Call, tmp_path: Path, old: str, new: str, told: str) -> None:
    build = edited(PILOT, tmp_path, old, new)
    assert told in refused(call, "run", DRIVE, "--build", build, "--out", tmp_path / "out")


def test_a_misspelt_measure(call: Call, tmp_path: Path) -> None:
    criteria = edited(CRITERIA, tmp_path, 'measure = "TTC"', 'measure = "TCT"')
    assert "no measure 'TCT', did you mean 'TTC'?" in refused(call, "assess", DRIVE, "--criteria", criteria)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (",heading,", ",headng,", "column heading missing (did you write 'headng' for 'heading'?)"),
        (",car", ",cra", "kind is 'cra', expected one of "),
        (",car", ",cra", ", did you mean 'car'?"),
    ],
)
def test_a_misspelt_column_and_kind(call: Call, tmp_path: Path, old: str, new: str, told: str) -> None:
    for file in DRIVE.glob("*"):
        edited(file, tmp_path, *((old, new) if file.name == "gt.csv" else ("", "")))
    assert told in refused(call, "check", tmp_path)


def test_a_module_that_is_missing_has_the_name_that_the_user_knows(call: Call, tmp_path: Path) -> None:
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "__init__.py").write_text("")
    (tmp_path / "own" / "pilot.py").write_text("import own.imd\n")
    (tmp_path / "b.toml").write_text('name = "b"\nversion = "1"\nfactory = "own.pilot:Own"\n')
    error = refused(call, "run", DRIVE, "--build", tmp_path / "b.toml", "--out", tmp_path / "out")
    assert "No module named 'own.imd'" in error
