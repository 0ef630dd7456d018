"""What runs is what was hashed when the command began, in every child process, whatever is edited meanwhile."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import duckdb
import pytest
from conftest import ROOT

from resim.sweeps.execution import begin, compact, execute, inputs
from resim.sweeps.file import read_sweep
from resim.verification.execution import verify
from resim.verification.request import VerifyOptions as Wanted
from resim.verification.request import make_request
from resim.verification.suite import read_suite

CRITERIA = ROOT / "scenarios" / "criteria" / "highway.toml"
MODEL = ROOT / "adfunc" / "perception" / "proving_ground.json"
DRIVES = [ROOT / "scenarios" / "overtake", ROOT / "scenarios" / "neighbours" / "cut_in_only"]

PILOT = """from resim.simulation.function.interface import Command


class Pilot:
    def __init__(self, gains=(0.0,), **more):
        self.gains = gains

    def reset(self, setup):
        import helper
        self.a = helper.ACCELERATION + sum(self.gains)
        if isinstance(self.gains, list):
            self.gains.append(-0.5)

    def step(self, perceived):
        return Command(self.a if perceived.t > 0.0 else 0.0, 0.0)

    def close(self):
        pass
"""
VerifyOptions = Callable[..., tuple[int, str, str]]


def build(folder: Path, acceleration: float, parameters: str = "", pilot: str = PILOT) -> Path:
    """Write a build whose helper says how it accelerates."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "pilot.py").write_text(pilot)
    (folder / "helper.py").write_text(f"ACCELERATION = {acceleration}\n")
    path = folder / "pilot.toml"
    path.write_text(f'name = "pilot"\nversion = "1"\nfactory = "pilot:Pilot"\n[parameters]\n{parameters}\n')
    return path


def suite(folder: Path, criteria: Path = CRITERIA, *drives: Path) -> Path:
    path = folder / "suite.toml"
    entries = "".join(f'[[recording]]\nfolder = "{drive}"\n' for drive in drives or DRIVES)
    path.write_text(f'name = "s"\ncriteria = "{criteria}"\nbases = ["GT"]\nreports = 0\n{entries}')
    return path


def sweep(
    folder: Path, *builds: Path, seeds: int = 1, model: Path = MODEL, criteria: Path = CRITERIA
) -> Path:
    path = folder / "sweep.toml"
    named = ", ".join(f'"{b}"' for b in builds)
    path.write_text(
        f'name = "s"\ncriteria = "{criteria}"\nbuild = [{named}]\nperception = "{model}"\nseeds = {seeds}\n'
        f'[[recording]]\nfolder = "{DRIVES[0]}"\n'
        '[[parameter]]\nname = "perception.latency.speed"\nvalues = [0.0]\n'
    )
    return path


def swept(
    path: Path, out: Path, workers: int = 1, tell: Callable[[bool], None] = lambda failed: None
) -> list[Any]:
    """Do a sweep; gives build, seed and what became of each run, in order."""
    wanted = read_sweep(path)
    begin(out, inputs(wanted, out), resume=False)
    execute(wanted, out, workers=workers, tell=tell)
    assert compact(wanted, out) == (0, 0)
    columns = "build, seed, reaction, end_position_error, risk, verdict"
    return duckdb.sql(f"select {columns} from '{out}/runs/*.parquet' order by run").fetchall()


@pytest.mark.slow
def test_a_helper_of_the_same_name_in_another_build_is_another_one(
    call: VerifyOptions, tmp_path: Path
) -> None:
    one, two = build(tmp_path / "one", 0.0), build(tmp_path / "two", -3.0)
    out = tmp_path / "out"
    code, said, _ = call(
        "verify", suite(tmp_path), "--build", two, "--against", one, "--out", out, "--workers", 1
    )
    found = json.loads((out / "verification.json").read_text())
    assert {r["verdict"] for r in found["recordings"]} <= {"changed", "worse", "better"}
    assert found["inputs"]["build"]["hash"] != found["inputs"]["against"]["hash"]
    assert code in (0, 1)
    namesakes = "both builds are called pilot-1, and are not the same"
    assert namesakes in " ".join(said.split())
    assert namesakes in (out / "verification.html").read_text()
    rows = swept(sweep(tmp_path, one, two), tmp_path / "swept")
    assert rows[0][2:] != rows[1][2:]


def test_a_build_that_is_edited_during_a_verification_runs_as_it_was_hashed(tmp_path: Path) -> None:
    """What is written meanwhile would end the process of the second drive."""
    pilot, out = build(tmp_path / "one", -1.0), tmp_path / "out"
    wanted = make_request(
        read_suite(suite(tmp_path)), pilot, None, Wanted(driven_by=("highway_pilot-1.0",)), out
    )
    edited: list[str] = []

    def edit(name: str, verdict: str, kept: bool) -> None:
        (pilot.parent / "helper.py").write_text("import os\nos._exit(9)\n")
        (pilot.parent / "pilot.py").write_text("import os\nos._exit(9)\n")
        pilot.write_text("name = 'other'\n")
        edited.append(name)

    found, _ = verify(wanted, tmp_path, None, workers=1, tell=edit)
    assert len(edited) == 2
    assert [r.error for r in found.recordings] == [None, None]


@pytest.mark.slow
def test_a_verification_runs_and_keeps_what_was_hashed(tmp_path: Path) -> None:
    criteria = tmp_path / "criteria.toml"
    criteria.write_bytes(CRITERIA.read_bytes())
    model = tmp_path / "model.json"
    model.write_bytes(MODEL.read_bytes())
    old, new = build(tmp_path / "old", 0.0), build(tmp_path / "new", -1.0)
    path, first, out = suite(tmp_path, criteria), tmp_path / "first", tmp_path / "out"
    call = Wanted(perception=model, seeds=1)
    undisturbed, _ = verify(make_request(read_suite(path), new, old, call, first), first, first, workers=1)

    edited: list[str] = []

    def edit(name: str, verdict: str, kept: bool) -> None:
        for file in (old, new):
            (file.parent / "helper.py").write_text("import os, sys\nos._exit(9)\n")
            (file.parent / "pilot.py").write_text(PILOT.replace("0.0)", "9.0)"))
        criteria.write_text(criteria.read_text().replace("above", "below"))
        model.write_text("{}")
        edited.append(name)

    wanted = make_request(read_suite(path), new, old, call, out)
    found, _ = verify(wanted, out, out, workers=1, tell=edit)
    assert edited
    assert (found.recordings, found.summary) == (undisturbed.recordings, undisturbed.summary)
    build(tmp_path / "old", 0.0)
    build(tmp_path / "new", -1.0)
    criteria.write_bytes(CRITERIA.read_bytes())
    model.write_bytes(MODEL.read_bytes())
    told: list[bool] = []
    again, _ = verify(wanted, out, out, workers=1, tell=lambda name, verdict, kept: told.append(kept))
    assert told == [True, True]  # what was kept is of this code
    assert again.recordings == undisturbed.recordings


@pytest.mark.slow
def test_a_sweep_with_children_that_restart_runs_what_was_hashed(tmp_path: Path) -> None:
    mark, edited = tmp_path / "mark", tmp_path / "edited"
    dies = f"import helper, os, pathlib\n        mark = pathlib.Path({str(mark)!r})\n"
    dies += "        if mark.exists(): mark.unlink(); os.kill(os.getpid(), 9)"
    pilot = build(tmp_path / "one", -1.0, pilot=PILOT.replace("import helper", dies))
    path = sweep(tmp_path, pilot, seeds=4)
    before = swept(path, tmp_path / "first")

    def edit(failed: bool) -> None:
        if not edited.exists():
            edited.touch()
            mark.touch()
            build(tmp_path / "one", -4.0)

    assert swept(path, tmp_path / "second", tell=edit) == before
    assert edited.exists()
    assert not mark.exists()  # a child was killed, and another one did the rest


@pytest.mark.parametrize("workers", [1, 2])
def test_a_parameter_that_is_a_list_is_each_runs_own(tmp_path: Path, workers: int) -> None:
    path = sweep(tmp_path, build(tmp_path / "one", -1.0, "gains = [0.0]"), seeds=4)
    rows = swept(path, tmp_path / "out", workers=workers)
    assert len({row[2:] for row in rows}) == 1  # nothing is drawn that this function minds


@pytest.mark.slow
def test_children_import_nothing_from_the_working_directory(tmp_path: Path) -> None:
    (tmp_path / "random.py").write_text("import os\nos._exit(66)\n")
    there = build(tmp_path / "one", 0.0)
    code = "import sys; from resim.cli import main; main()"
    for how in (["-P", "-c", code], ["-m", "resim"]):
        words = [*how, "run", DRIVES[0], "--build", there, "--out", tmp_path / how[0]]
        done = subprocess.run(
            [sys.executable, *map(str, words)], cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)},
            capture_output=True, text=True, check=False, timeout=120,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        assert (tmp_path / how[0] / "report.json").is_file()


def test_a_recording_without_a_hash_is_verified_for_the_label_only(
    call: VerifyOptions, tmp_path: Path
) -> None:
    drive, out = tmp_path / "drive", tmp_path / "out"
    shutil.copytree(DRIVES[0], drive)
    settings = (drive / "recording.toml").read_text().splitlines()
    kept = [line for line in settings if not line.startswith(("build_hash", "map"))]
    (drive / "recording.toml").write_text(
        "\n".join([f'map = "{ROOT}/networks/proving_ground.xodr"', *kept]) + "\n"
    )
    pilot = ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml"
    code, said, _ = call(
        "verify", suite(tmp_path, CRITERIA, drive), "--build", pilot, "--out", out, "--workers", 1
    )
    (found,) = json.loads((out / "verification.json").read_text())["recordings"]
    assert code in (0, 1)
    assert any(note.endswith("the verdict is for the label only") for note in found["notes"])
    assert "for the label only" in " ".join(said.split())


def test_a_function_that_opens_what_its_build_does_not_list_is_told_of(
    call: VerifyOptions, tmp_path: Path
) -> None:
    opens = PILOT.replace(
        "import helper", f"import helper; open({str(tmp_path / 'one' / 'w.json')!r}).close()"
    )
    there, out = build(tmp_path / "one", 0.0, pilot=opens), tmp_path / "out"
    (tmp_path / "one" / "w.json").write_text("1")
    code, said, _ = call("run", DRIVES[0], "--build", there, "--out", out, "--basis", "gt")
    assert code == 0
    note = "opened w.json beside pilot.toml, which its hash does not know"
    assert note in " ".join(said.split())
    assert any(note in warning for warning in json.loads((out / "report.json").read_text())["warnings"])
