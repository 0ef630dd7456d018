"""Labels of the user's own: whatever their code does, the study goes on, and what they were shown stays as it is."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest

from resim.core.errors import InputError
from resim.jobs.mine import MineOptions, mine

DRIVE = Path(__file__).parents[2] / "scenarios" / "cut_in_brake"
HEAD = "import os, time, hashlib\nfrom resim.mining.maneuver import LabelledManeuver as M\n"
SETTINGS = '[[label]]\nname = "mine"\nfunction = "own:find"\n'


def labels(folder: Path, body: str) -> Path:
    (folder / "own.py").write_text(f"{HEAD}def find(features, found):\n    {body}\n")
    (folder / "labels.toml").write_text(SETTINGS)
    return folder / "labels.toml"


def told(tmp_path: Path, body: str) -> str:
    with pytest.raises(InputError) as e:
        mine([DRIVE], tmp_path / "out", MineOptions(labels=labels(tmp_path, body), write=False))
    return str(e.value)


@pytest.mark.parametrize(
    ("body", "why"),
    [
        ("os._exit(0)", "ended its process"),
        ("features.a[:] = -9.0; return []", "read-only"),
        ("features.samples.v[:] = 0.0; return []", "read-only"),
        ("return [M('mine', 0, 0, 1, 0, partner=99)]", "partner 99"),
        ("return [M('mine', 77, 0, 1, 0)]", "object 77"),
        ("return [M('mine', 0, 0, 1, 10**9)]", "at 1000000000"),
        ("return [M('mine', 0, 0, 1, 5)]", "at 5"),
        ("return [M('mine', 0, 0.0, 1, 0)]", "as integers"),
        ("return [M('mine', 0, 0, 1, 0, figures={'a': 'x'})]", "expected a number"),
        ("return [M('mine', 0, 0, 1, 0, figures={'t': 5.0})]", "figure 't'"),
    ],
)
def test_what_a_label_must_not_do_is_told(tmp_path: Path, body: str, why: str) -> None:
    assert why in told(tmp_path, body)


def test_a_label_and_its_figures_are_in_the_table(tmp_path: Path) -> None:
    body = "return [M('mine', 0, 0, 2, 1, partner=1, figures={'much_m': 2.5})]"
    found = mine([DRIVE], tmp_path / "out", MineOptions(labels=labels(tmp_path, body), write=False))
    row = found.maneuvers[found.maneuvers["label"] == "mine"].iloc[0]
    assert (row["much_m"], row["partner"]) == (2.5, "1")


@pytest.mark.slow
def test_code_that_never_returns_ends_with_the_command(tmp_path: Path) -> None:
    flag = tmp_path / "begun"
    body = f"open({str(flag)!r}, 'w').close(); hashlib.pbkdf2_hmac('sha256', b'a', b'b', 2 * 10**9)"
    command = [
        sys.executable,
        "-m",
        "resim",
        "mine",
        DRIVE,
        "--labels",
        labels(tmp_path, body),
        "--out",
        tmp_path / "o",
    ]
    process = subprocess.Popen([*map(str, command)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not flag.exists() and process.poll() is None:
        time.sleep(0.05)
    assert process.poll() is None
    process.terminate()
    assert process.wait(timeout=30) != 0
