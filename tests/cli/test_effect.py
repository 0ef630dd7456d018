"""An option that would have no effect is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from resim.cli import check
from resim.cli.terminal import OutputSettings, output_as
from resim.core.finding import Finding

ROOT = Path(__file__).parents[2]
DRIVE, MAP = ROOT / "scenarios" / "rear_end", ROOT / "networks" / "proving_ground.xodr"
PILOT = ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml"
SWEEP = ROOT / "scenarios" / "sweeps" / "perception_latency.toml"
Call = Callable[..., tuple[int, str, str]]

TABLE = "t,id,x,y,heading,v\n0.0,a,50.0,-1.75,0.0,20.0\n0.1,a,52.0,-1.75,0.0,20.0\n"
MAPPING = """ego = "a"
[gt]
t = { column = "t", unit = "s" }
id = "id"
x = "x"
y = "y"
heading = { column = "heading", unit = "rad" }
v = { column = "v", unit = "m/s" }
kind = { value = "car" }
length = { value = 4.7 }
width = { value = 1.9 }
"""


@pytest.mark.parametrize(
    ("words", "option"),
    [
        ("run {drive} --build {pilot} --out o --seeds 3", "--seeds"),
        ("run {drive} --build {pilot} --out o --set latency.speed=1", "--set"),
        ("run {drive} --build {pilot} --out o --verdict-of GT", "--verdict-of"),
        ("verify --replay f.json --vehicle kinematic", "--replay"),
        ("verify --replay f.json --seeds 3", "--replay"),
        ("assess run --accept TIME_GAP", "--accept"),
        ("assess {drive} --verdict-of GT", "--verdict-of"),
        ("assess {drive} --road-aware --mode published", "--road-aware"),
        ("play run --assess", "--assess"),
        ("sweep {sweep} --out o --dry-run --resume", "--resume"),
        ("sweep {sweep} --out o --dry-run --scheduler tcp://here:1", "--scheduler"),
        ("check {drive} --max-gap 2", "--max-gap"),
        ("check {drive} --outliers robust", "--outliers"),
        ("import table t.csv --map {map} --columns m.toml --out o --rate 10", "--rate"),
    ],
)
def test_an_option_without_effect_is_refused(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str, option: str
) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run.json").write_text("{}")
    (tmp_path / "t.csv").write_text(TABLE)
    (tmp_path / "m.toml").write_text(MAPPING)
    (tmp_path / "f.json").write_text("{}")
    monkeypatch.chdir(tmp_path)
    given = words.format(drive=DRIVE, pilot=PILOT, sweep=SWEEP, map=MAP).split()
    code, out, error = call(*given)
    assert (code, out) == (2, "")
    assert error.startswith(f"resim: {option}: ")
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize(("verbose", "lines"), [(False, 11), (True, 16)])
def test_verbose_prints_every_finding(capsys: pytest.CaptureFixture[str], verbose: bool, lines: int) -> None:
    """Two lines a finding; without it the first five of a kind, and how many more there are."""
    of = ("TIME_GAP", "warning", "GT")
    found = [Finding(*of, f"a{k}", 1.0, 2.0, 1.0, "s", "is not there", "nothing", "") for k in range(8)]
    with output_as(OutputSettings(verbose=verbose)):
        check.print_findings(found)
    out = capsys.readouterr().out
    assert (len(out.splitlines()), "... and 3 more of this code" in out) == (lines, not verbose)
