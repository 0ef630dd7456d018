"""What is no number, is a duplicate, or is beyond all measure is refused with file, field and value, never guessed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from resim.core.errors import InputError
from resim.metrics.criteria import read_criteria
from resim.perception.model import read_model
from resim.recordings.settings import read_settings
from resim.simulation.function.interface import load_build
from resim.sweeps.file import read_sweep
from resim.verification.suite import read_suite

ROOT = Path(__file__).parents[1]
MODEL = ROOT / "adfunc" / "perception" / "proving_ground.json"
Call = Callable[..., tuple[int, str, str]]

SUITE = (
    f'name = "s"\ncriteria = "{ROOT}/scenarios/criteria/highway.toml"\n{{}}\n[[recording]]\nfolder = "here"\n'
)
SWEEP = (
    f'name = "s"\nbuild = ["b.toml"]\ncriteria = "{ROOT}/scenarios/criteria/highway.toml"\n'
    f'recording = [{{{{folder = "{ROOT}/scenarios/rear_end"}}}}]\n{{}}\n[[parameter]]\nname = "function.gain"\n'
)
PARAMETER = SWEEP.replace("{}", "") + "{}\n"
BUILD = 'name = "b"\nversion = "1"\nfactory = "json:JSONDecoder"\n{}\n'
CRITERIA = 'name = "c"\n[[criterion]]\nname = "ttc"\nmeasure = "TTC"\n{}\n'
PICKY = """from resim.simulation.function.interface import Command
class Own:
    def __init__(self, gain): self.gain = gain
    def reset(self, setup): pass
    def step(self, perceived):
        if self.gain > 0.5: raise ValueError("lost")
        return Command(0.0, 0.0)
    def close(self): pass
"""
SETTINGS = 'name = "r"\nmap = "m.xodr"\nego = "1"\n{}\n'

REFUSED = [
    (read_suite, SUITE, 'agreement = "0.8"', "agreement: expected a valid number, found '0.8'"),
    (read_suite, SUITE, "seeds = true", "seeds: expected a valid integer, found True"),
    (read_suite, SUITE, "seeds = 5.0", "seeds: expected a valid integer, found 5.0"),
    (read_suite, SUITE, 'bases = ["GT", "GT"]', "bases: 'GT' is a duplicate"),
    (read_suite, SUITE, 'tolerances.reaction = "1"', "tolerances.reaction: expected a valid number, found '1'"),
    (read_suite, SUITE, 'tolerances.fit.ego.d = "1"', "tolerances.fit.ego.d: expected a valid number"),
    (read_suite, SUITE, "limits.lost = true", "limits.lost: expected a valid integer, found True"),
    (read_sweep, SWEEP + "low = 0\nhigh = 1", 'time_limit = "9"', "time_limit: expected a valid number"),
    (read_sweep, SWEEP + "low = 0\nhigh = 1", 'points = "8"', "points: expected a valid integer, found '8'"),
    (read_sweep, SWEEP + "low = 0\nhigh = 1", "points = 10_000_000", "expected 1000000 or less, found 10000000"),
    (read_sweep, PARAMETER, 'values = ["1"]', "parameter.0.values.0: expected a valid number, found '1'"),
    (read_sweep, PARAMETER, "low = true\nhigh = 3", "parameter.0.low: expected a valid number, found True"),
    (read_sweep, PARAMETER, "low = -1.7e308\nhigh = 1.7e308", "from low -1.7e+308 to high 1.7e+308"),
    (load_build, BUILD, 'cycle_time = "0.2"', "cycle_time: expected a valid number, found '0.2'"),
    (load_build, BUILD, "time_limit = true", "time_limit: expected a valid number, found True"),
    (load_build, BUILD, f'files = ["{300 * "a"}"]', "is not a plain relative name of up to 255 characters"),
    (read_criteria, CRITERIA, 'below = "3"', "criterion.0.below: expected a valid number, found '3'"),
    (read_settings, SETTINGS, 'gt_rate = "25"', "gt_rate: expected a valid number, found '25'"),
    (read_settings, SETTINGS, "gt_rate = 1e300", "gt_rate: expected 10000 or less"),
    (read_settings, SETTINGS, "gt_rate = 1e-300", "gt_rate: expected 0.001 or more"),
]  # fmt: skip


@pytest.mark.parametrize(("read", "text", "field", "says"), REFUSED, ids=[case[2][:40] for case in REFUSED])
def test_it_is_refused_with_file_field_and_value(
    tmp_path: Path, read: Callable[[Path], object], text: str, field: str, says: str
) -> None:
    path = tmp_path / "it.toml"
    path.write_text(text.format(field))
    with pytest.raises(InputError) as told:
        read(path)
    assert str(told.value).startswith(f"{path}: ")
    assert says in str(told.value)


def test_whole_numbers_stand_for_numbers(tmp_path: Path) -> None:
    (tmp_path / "it.toml").write_text(SETTINGS.format("gt_rate = 25"))
    assert read_settings(tmp_path / "it.toml").gt_rate == 25.0


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('"name"', '"name": "another", "name"', "'name' is a duplicate"),
        ('"correlation_time": ', '"correlation_time": true, "unused": ', "expected a valid number"),
    ],
)
def test_a_model_with_a_name_twice_or_a_truth_value_is_refused(
    tmp_path: Path, old: str, new: str, says: str
) -> None:
    path = tmp_path / "model.json"
    path.write_text(MODEL.read_text().replace(old, new, 1))
    with pytest.raises(InputError, match=says):
        read_model(path)


@pytest.mark.parametrize("setting", ["latency=1", "averaging=1", "maneuvers=1", "errors=1"])
def test_a_section_set_to_a_number_is_told(call: Call, setting: str) -> None:
    code, _, error = call("perception", "show", MODEL, "--set", setting)
    assert code == 2
    assert error.startswith(f"resim: --set {setting}: {setting.partition('=')[0]}")


def test_seeds_without_a_model_are_refused(call: Call, tmp_path: Path) -> None:
    drive, build = ROOT / "scenarios" / "rear_end", ROOT / "adfunc" / "builds" / "replay-1.0.toml"
    code, _, error = call("run", drive, "--build", build, "--seeds", 3, "--out", tmp_path / "out")
    assert (code, error) == (
        2,
        "resim: --seeds: 3 without a model has no effect. Name one with --perception.\n",
    )
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("part", ["²", "9" * 5000, "7"])
def test_a_place_in_a_list_that_there_is_not_is_told(call: Call, part: str) -> None:
    code, _, error = call("perception", "show", MODEL, "--set", f"errors.coupling.{part}.1=0.1")
    assert (code, "there is no parameter" in error) == (2, True)


@pytest.mark.parametrize("way", ["module", "script"])
def test_an_interrupt_while_the_command_is_loaded_leaves_no_traceback(tmp_path: Path, way: str) -> None:
    (tmp_path / "typer.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGINT)\n")
    (tmp_path / "bin").mkdir()
    script = tmp_path / "bin" / "resim"
    script.write_text("from resim.cli import main\nmain()\n")
    command = ["-m", "resim"] if way == "module" else [str(script)]
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}
    done = subprocess.run([sys.executable, *command], env=env, capture_output=True, text=True, check=False)
    assert done.returncode == -signal.SIGINT
    assert done.stderr == ""


def test_a_sweep_of_which_every_run_failed_ends_with_3_and_has_a_report(call: Call, tmp_path: Path) -> None:
    methods = "".join(f"    def {name}(self, _=None): pass\n" for name in ("reset", "step", "close"))
    (tmp_path / "own.py").write_text(f"class Own:\n    def __init__(self, gain): pass\n{methods}")
    (tmp_path / "b.toml").write_text(
        'name = "b"\nversion = "1"\nfactory = "own:Own"\n[parameters]\ngain = 0.0\n'
    )
    (tmp_path / "sweep.toml").write_text(
        SWEEP.format("time_limit = 0.001\nseeds = 1") + "low = 0\nhigh = 1\nsteps = 2\n"
    )
    code, out, error = call("sweep", tmp_path / "sweep.toml", "--out", tmp_path / "out", "--workers", "1")
    assert (code, "2 runs, 2 failed" in out) == (3, True)
    assert "every run failed, the first is run 0: took longer than 0.001 s" in error
    code, out, _ = call("sweep", "report", tmp_path / "out")
    assert (code, "2 runs, 2 failed" in out) == (0, True)
    assert json.loads((tmp_path / "out" / "report.json").read_text())["failed"] == 2


def test_a_sweep_of_which_some_runs_failed_tells_the_first_and_ends_with_3(
    call: Call, tmp_path: Path
) -> None:
    (tmp_path / "own.py").write_text(PICKY)
    (tmp_path / "b.toml").write_text(
        'name = "b"\nversion = "1"\nfactory = "own:Own"\n[parameters]\ngain = 0.0\n'
    )
    (tmp_path / "sweep.toml").write_text(SWEEP.format("seeds = 2") + "low = 0\nhigh = 1\nsteps = 2\n")
    code, out, error = call("sweep", tmp_path / "sweep.toml", "--out", tmp_path / "out", "--workers", "1")
    assert (code, "4 runs, 2 failed" in out) == (3, True)
    assert error.splitlines()[-1].startswith(
        f"resim: {tmp_path / 'out'}: 2 runs failed, the first is run 2: b-1 at t = -3.00 s raised ValueError: lost"
    )
