"""A function may end, stop or leave its process as it likes: the command tells, and nothing is left behind."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from execution.test_workers import is_gone

from resim.execution import workers

Call = Callable[..., tuple[int, str, str]]

ROOT = Path(__file__).parents[2]
DRIVE = ROOT / "scenarios" / "rear_end"
HEAD = """import ctypes, os, signal, subprocess, sys, time
from pathlib import Path
from resim.simulation.function.interface import Command
HERE = Path(r"{here}")  # __file__ is in a frozen copy

class Own:
    def reset(self, setup): pass
    def close(self): pass
    def step(self, perceived):
        if perceived.t < 1.0: return Command(0.0, 0.0)
"""
IN_C = "(HERE / 'begun').write_text(str(os.getpid()))\nsum(range(10**14))"


@pytest.fixture
def build(write_build: Callable[..., Path], tmp_path: Path) -> Callable[..., Path]:
    """Write a build whose function does something from t = 1 s on."""

    def make(deed: str, limit: float = 0.2) -> Path:
        lines = (deed + "\nreturn Command(0.0, 0.0)").replace("\n", "\n        ")
        return write_build(f"{HEAD.format(here=tmp_path)}        {lines}\n", top=f"time_limit = {limit}")

    return make


def ended(folder: Path) -> str:
    return str(json.loads((folder / "report.json").read_text())["failure"])


def wait_for(true: Callable[[], object]) -> None:
    end = time.monotonic() + 60.0
    while not true():
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.mark.parametrize(
    ("deed", "why"),
    [
        ("os._exit(0)", "ended its process, which ended with code 0"),
        (IN_C, "did not answer within 0.2 s, and could not be interrupted"),
    ],
)
def test_what_ends_or_blocks_the_process_is_a_failure_of_the_function(
    call: Call, build: Callable[..., Path], tmp_path: Path, deed: str, why: str
) -> None:
    order = ("run", DRIVE, "--basis", "gt", "--out", tmp_path / "out", "--build")
    code, _, error = call(*order, build(deed))
    assert code == 3
    assert f"test-0.1 at t = 1.00 s {why}" in error
    assert "Traceback" not in error
    assert why in ended(tmp_path / "out")


WRITES = r"""
import fcntl
for file in range(3, 64):
    try:
        name, mode = os.readlink(f'/proc/self/fd/{file}'), fcntl.fcntl(file, fcntl.F_GETFL) & os.O_ACCMODE
    except OSError:
        continue
    if name.startswith('pipe:') and mode == os.O_WRONLY:
        os.write(file, TEXT)
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "text", [b"\xff" * 100, b"\x05" + b"\0" * 7 + b"hello", b"\0\0\0\1", b"\0\0\0\1" + b"\0" * 4]
)
def test_what_a_function_writes_into_our_pipes_is_no_answer(
    call: Call, build: Callable[..., Path], set_constant: Callable[..., None], tmp_path: Path, text: bytes
) -> None:
    set_constant(workers, "_STALLED", 3.0)
    order = ("run", DRIVE, "--basis", "gt", "--out", tmp_path / "out", "--build")
    code, _, error = call(*order, build(WRITES.replace("TEXT", repr(text))))
    assert code == 3
    assert "wrote to a file that it did not open" in error
    assert "Traceback" not in error


def test_a_function_may_take_the_streams_away(call: Call, build: Callable[..., Path], tmp_path: Path) -> None:
    order = ("run", DRIVE, "--basis", "gt", "--out", tmp_path / "out", "--build")
    for deed in ("sys.stdout = sys.stderr = None", "vars(sys).pop('stdout', 0), vars(sys).pop('stderr', 0)"):
        code, _, error = call(*order, build(deed))
        assert (code, "resim: " in error) == (0, False)


def test_a_measure_that_ends_its_process_leaves_the_older_result(call: Call, tmp_path: Path) -> None:
    order = ("assess", DRIVE, "--out", tmp_path / "out")
    assert call(*order)[0] == 0
    before = {path: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    (tmp_path / "mine.py").write_text("import os\ndef leave(drive, network): os._exit(0)\n")
    (tmp_path / "mine.toml").write_text(
        'name = "mine"\n[[measure]]\nname = "own"\nfunction = "mine:leave"\nunit = "m"\nworst = "high"\n'
        'kind = "quantitative"\n[[criterion]]\nname = "c"\nmeasure = "own"\nabove = 1.0\n'
    )
    code, out, error = call(*order, "--criteria", tmp_path / "mine.toml")
    assert (code, out) == (2, "")
    assert "leave ended its process, which ended with code 0" in error
    assert {path: path.read_bytes() for path in (tmp_path / "out").iterdir()} == before
    assert not list(tmp_path.glob(".out*"))


@pytest.mark.parametrize(
    "number",
    [signal.SIGINT, *(pytest.param(one, marks=pytest.mark.slow) for one in (signal.SIGTERM, signal.SIGKILL))],
)
def test_a_signal_ends_the_command_and_all_that_it_started(
    build: Callable[..., Path], tmp_path: Path, number: int
) -> None:
    started = "(HERE / 'other').write_text(str(subprocess.Popen(['sleep', '600']).pid))\n"
    path = build(started + IN_C, limit=600.0)
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    command = subprocess.Popen(
        [sys.executable, "-m", "resim", "run", DRIVE, "--build", path, "--out", tmp_path / "out"],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, env={**os.environ, "TMPDIR": str(temporary)},
    )  # fmt: skip
    wait_for(lambda: (tmp_path / "begun").exists() and bool((tmp_path / "begun").read_text()))
    child, other = (int((tmp_path / name).read_text()) for name in ("begun", "other"))
    command.send_signal(number)
    code = command.wait(30.0)
    assert code == (-number if number == signal.SIGKILL else 128 + number)
    wait_for(lambda: is_gone(child) and is_gone(other))
    assert not (tmp_path / "out").exists()
    assert number == signal.SIGKILL or not list(temporary.iterdir())
    assert command.stderr is not None
    with command.stderr as told:
        assert told.read() in (b"", b"0 of 8 stages\n")
    command.stderr.close()


def test_a_forked_copy_does_not_drive_on(call: Call, build: Callable[..., Path], tmp_path: Path) -> None:
    forks = "os.fork()\nwith (HERE / 'steps').open('a') as file: file.write(f'{os.getpid()}\\n')"
    order = ("run", DRIVE, "--basis", "gt", "--out", tmp_path / "out", "--build")
    assert call(*order, build(forks))[0] == 0
    steps = (tmp_path / "steps").read_text().split()
    assert sum(steps.count(one) > 1 for one in set(steps)) == 1


def test_a_function_that_changes_the_folder_moves_no_result(
    call: Call, build: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    path = build("os.chdir(HERE / 'elsewhere')")
    drive = os.path.relpath(DRIVE, tmp_path)
    assert call("run", drive, "--basis", "gt", "--build", path.name, "--out", "out")[0] == 0
    assert (tmp_path / "out" / "report.json").exists()
    assert not list((tmp_path / "elsewhere").iterdir())


def test_what_lies_in_the_working_directory_is_not_imported(
    call: Call, build: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("random", "resource", "pickle"):
        (tmp_path / f"{name}.py").write_text("raise ImportError('not this one')\n")
    monkeypatch.setattr(sys, "path", [folder for folder in sys.path if folder])
    code, _, error = call("run", DRIVE, "--basis", "gt", "--build", build("pass"), "--out", tmp_path / "out")
    assert (code, "resim: " in error) == (0, False)


@pytest.mark.parametrize("command", ["verify", "sweep"])
def test_a_build_that_ends_the_process_that_reads_it_ends_no_command_well(
    call: Call, write_build: Callable[..., Path], tmp_path: Path, command: str
) -> None:
    path = write_build("import os\nos._exit(0)\n")
    suite, sweep = ROOT / "scenarios" / "suites", tmp_path / "sweep.toml"
    text = (ROOT / "scenarios" / "sweeps" / "perception_latency.toml").read_text()
    text = re.sub(r"\nbuild = .*", f'\nbuild = ["{path}"]', text)
    sweep.write_text(text.replace('"../', f'"{ROOT}/scenarios/').replace(f"{ROOT}/scenarios/../", f"{ROOT}/"))
    asked = (next(suite.glob("*.toml")), "--build", path) if command == "verify" else (sweep,)
    code, out, error = call(command, *asked, "--out", tmp_path / "out")
    assert (code, out) == (3, "")
    problem = error.removeprefix("0 recordings\n").removeprefix("0 runs\n")
    assert problem.startswith(f"resim: {path}: factory module 'own' cannot be imported: it ended its process")
