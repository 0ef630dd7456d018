"""Recipes are strict: every fault is told with its field, and the job gives what `resim check` finds nothing in."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest

from resim.core.errors import InputError
from resim.jobs.check import check
from resim.jobs.generate import generate_recording
from resim.recordings import read_recording
from resim.scenario.generation.recipe import read_recipe
from resim.scenario.generation.truth import TRUTH_COLUMNS

ROOT = Path(__file__).parents[3]
Call = Callable[..., tuple[int, str, str]]
TEXT = f"""
map = "{ROOT}/networks/motorway.xodr"
duration = 6.0
[[object]]
id = "ego"
color = "#1f77b4"
route = {{ road = "1", lane = -2, s = 100.0 }}
speed = 30.0
[[object]]
id = "1"
route = {{ road = "1", lane = -1, s = 100.0 }}
speed = {{ times = [0.0, 5.0], values = [37.0, 36.0] }}
change = [{{ to = "right", t = 2.0, seconds = 4.0 }}]
maneuver = [{{ label = "cut_in_right", start = 2.0, end = 6.0, t = 4.0, partner = "ego" }}]
"""


def recipe(folder: Path, old: str = "", new: str = "") -> Path:
    assert old in TEXT
    path = folder / "cut_in.toml"
    path.write_text(TEXT.replace(old, new, 1))
    return path


def test_a_recipe_becomes_a_recording_with_its_truth(tmp_path: Path, call: Call) -> None:
    code, said, error = call("generate", recipe(tmp_path), "--out", tmp_path / "drive")
    assert (code, error) == (0, "")
    assert "cut_in.toml: 2 objects, 151 samples; 1 speeding, 1 cut_in_right, 1 lane_change_right" in said
    assert not check(tmp_path / "drive").findings
    found = read_recording(tmp_path / "drive")
    assert found.provenance["colors"] == "ego #1f77b4, 1 #000000"
    assert found.gt.a is not None
    truth = pd.read_csv(tmp_path / "drive" / "truth.csv")
    assert tuple(truth.columns) == TRUTH_COLUMNS
    assert sorted(truth["label"]) == ["cut_in_right", "lane_change_right", "speeding"]
    assert "ego" in truth["partner"].tolist()


def test_the_same_recipe_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        generate_recording(recipe(tmp_path), tmp_path / name / "drive")
    for file in ("gt.csv", "truth.csv", "recording.toml"):
        assert (tmp_path / "a" / "drive" / file).read_bytes() == (
            tmp_path / "b" / "drive" / file
        ).read_bytes()


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("duration = 6.0", "duraton = 6.0", "duraton: there is no such field, did you mean 'duration'?"),
        ("duration = 6.0", "duration = -6.0", "duration: expected more than 0, found -6.0"),
        ('color = "#1f77b4"', 'color = "blue"', "object.0.color: expected a colour such as #1f77b4, found 'blue'"),
        ('to = "right"', 'to = "rigth"', "object.1.change.0.to: expected 'left' or 'right', found 'rigth', did you"),
        ("t = 2.0, seconds", "seconds", "object.1.change.0: say either where the change begins"),
        (", seconds = 4.0", "", "object.1.change.0: say how long the change is"),
        ('partner = "ego"', 'partner = "2"', "maneuver.partner: '2' was not found among the objects ego, 1"),
        ('id = "1"', 'id = "ego"', "object: the id 'ego' is a duplicate"),
        ("duration = 6.0", 'duration = 6.0\nego = "me"', "ego: 'me' was not found among the objects ego, 1"),
        ("duration = 6.0", 'duration = 6.0\naccept = ["WRONGWAY"]', "accept: 'WRONGWAY' is no code of `resim check`"),
        ("lane = -2, s = 100.0 }", "lane = -3, s = 300.0, against = true }", "drives against its lane for"),
    ],
)  # fmt: skip
def test_faults_are_told_with_their_field(tmp_path: Path, old: str, new: str, told: str) -> None:
    with pytest.raises(InputError) as e:
        generate_recording(recipe(tmp_path, old, new), tmp_path / "out")
    assert told in str(e.value)
    assert str(tmp_path / "cut_in.toml") in str(e.value)
    assert not (tmp_path / "out").exists()


def test_a_route_by_points_needs_four(tmp_path: Path) -> None:
    path = recipe(
        tmp_path,
        'route = { road = "1", lane = -2, s = 100.0 }',
        "route = { points = [[0.0, 0.0], [9.0, 0.0]] }",
    )
    with pytest.raises(InputError, match="expected 4 or more points"):
        read_recipe(path)


def test_a_wrong_way_driver_is_made_where_it_is_asked_for(tmp_path: Path) -> None:
    path = recipe(tmp_path, "lane = -2, s = 100.0 }", "lane = -3, s = 300.0, against = true }")
    path.write_text('accept = ["WRONG_WAY"]\n' + path.read_text())
    made = generate_recording(path, tmp_path / "out")
    assert "wrong_way" in made.truth["label"].tolist()
    assert {finding.code for finding in check(tmp_path / "out").findings} == {"WRONG_WAY"}
