"""Children are forked by a process that has loaded resim: none is another for it."""

from __future__ import annotations

import importlib
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from conftest import ROOT
from execution import actions

from resim.execution import forkserver
from resim.execution.workers import _end_own, in_child, run_all


def answers(function, tasks, workers=1):
    """The results in the order of the tasks."""
    return [found for _, found in sorted(run_all(function, tasks, workers=workers, time_limit=60.0))]


def test_a_child_has_the_environment_of_the_moment(monkeypatch):
    answers(actions.environment, ["X"])
    monkeypatch.setenv("RESIM_X", "1")
    monkeypatch.setenv("PYTHONHASHSEED", "7")
    assert answers(actions.environment, ["RESIM_X", "PYTHONHASHSEED"]) == ["1", "0"]
    monkeypatch.delenv("RESIM_X")
    assert answers(actions.environment, ["RESIM_X"]) == [None]


@pytest.mark.parametrize(("own", "found"), [(None, "1"), ("3", "3")])
def test_numerical_libraries_of_a_child_have_one_thread_unless_the_user_says_otherwise(
    monkeypatch, own, found
):
    """The library's own process keeps its environment: its user may want all cores."""
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    if own is not None:
        monkeypatch.setenv("OMP_NUM_THREADS", own)
    assert answers(actions.environment, ["OMP_NUM_THREADS"]) == [found]
    assert os.environ.get("OMP_NUM_THREADS") == own


@pytest.mark.parametrize(("own", "found"), [(None, "1"), ("3", "3")])
def test_numerical_libraries_of_a_command_have_one_thread_unless_the_user_says_otherwise(own, found):
    told = {name: value for name, value in os.environ.items() if name != "OMP_NUM_THREADS"}
    told |= {} if own is None else {"OMP_NUM_THREADS": own}
    code = (
        "import atexit, os, sys; sys.argv = ['resim', '--version']\n"
        "atexit.register(lambda: print(os.environ['OMP_NUM_THREADS']))\n"
        "from resim.cli import main; main()"
    )
    done = subprocess.run([sys.executable, "-c", code], env=told, capture_output=True, text=True, check=True)
    assert done.stdout.split()[-1] == found


def test_each_child_has_random_numbers_of_its_own():
    drawn = {answers(actions.random_numbers, [0])[0] for _ in range(3)}
    assert len({first for first, _ in drawn}) == 3
    assert len({second for _, second in drawn}) == 3


def test_code_that_is_not_resims_is_loaded_by_the_child_alone():
    assert answers(actions.is_loaded_here, [0]) == [True]


def test_a_server_that_was_killed_is_replaced():
    before = answers(actions.ancestors, [0])[0]
    os.kill(before[0], signal.SIGKILL)
    latest = time.monotonic() + 30.0
    while Path(f"/proc/{before[0]}/cmdline").read_bytes():  # until it is a zombie
        assert time.monotonic() < latest
    after = answers(actions.ancestors, [0])[0]
    assert before[0] != after[0]


def test_a_child_whose_server_was_killed_is_replaced():
    _end_own()
    server, _, child = in_child(actions.ancestors, 0)
    os.kill(server, signal.SIGKILL)
    latest = time.monotonic() + 30.0
    while in_child(actions.ancestors, 0)[0] == server or Path(f"/proc/{child}").exists():
        assert time.monotonic() < latest


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_a_server_ends_with_its_command(tmp_path: Path, how):
    path = os.pathsep.join(filter(None, sys.path))
    code = (
        "import pathlib, sys, time; from execution import actions; from resim.execution.workers import in_child; "
        "pathlib.Path(sys.argv[1]).write_text(' '.join(map(str, in_child(actions.ancestors, 0)))); time.sleep(60)"
    )
    told = tmp_path / "told"
    command = subprocess.Popen([sys.executable, "-c", code, told], env={**os.environ, "PYTHONPATH": path})
    while not told.is_file() or not told.read_text():
        time.sleep(0.05)
        assert command.poll() is None
    numbers = [int(number) for number in told.read_text().split()]
    command.send_signal(how)
    command.wait()
    latest = time.monotonic() + 30.0
    while any(Path(f"/proc/{number}/stat").is_file() for number in numbers):
        assert time.monotonic() < latest
        time.sleep(0.05)


def run_python(code: str, *words: object, **how) -> str:
    """What a program of its own prints, that imports the tests."""
    path = os.pathsep.join(filter(None, sys.path))
    told = subprocess.run(
        [sys.executable, "-c", code, *map(str, words)], env={**os.environ, "PYTHONPATH": path},
        capture_output=True, text=True, timeout=120.0, check=True, **how,
    )  # fmt: skip
    return told.stdout


def test_a_copy_of_the_command_has_children_of_its_own():
    """Both ask their child at once, again and again; each gets its own answers, and the copy ends only its own."""
    code = (
        "import os, sys; from execution import actions; from resim.execution.workers import in_child\n"
        "first = in_child(actions.ancestors, 0)\n"
        "copy = os.fork()\n"
        "mine = 0 if copy else 1000\n"
        "answers = [in_child(actions.double, mine + k) == 2 * (mine + k) for k in range(200)]\n"
        "others = in_child(actions.ancestors, 0)\n"
        "same = others == first\n"
        "if not copy: os._exit(0 if all(answers) and not set(others) & set(first) else 1)\n"
        "print(all(answers), same, os.waitpid(copy, 0)[1], in_child(actions.ancestors, 0) == first)\n"
    )
    assert run_python(code) == "True True 0 True\n"


def test_a_command_that_does_not_hear_of_its_children_ends():
    code = (
        "import signal; signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGCHLD])\n"
        "from execution import actions; from resim.execution.workers import in_child\n"
        "print(in_child(actions.double, 2))"
    )
    assert run_python(code) == "4\n"


def test_a_server_that_is_stopped_is_replaced(set_constant):
    set_constant(forkserver, "_LONGEST", 3.0)
    server = answers(actions.ancestors, [0])[0][0]
    os.kill(server, signal.SIGSTOP)
    assert answers(actions.ancestors, [0])[0][0] != server


def test_children_run_the_resim_of_the_command(tmp_path: Path):
    """Also where that is found since it lies in the working folder, and another one is installed."""
    shutil.copytree(ROOT / "resim", tmp_path / "resim", ignore=shutil.ignore_patterns("__pycache__"))
    code = (
        "from resim.execution.workers import in_child; import resim; print(resim.__file__)\n"
        "print(in_child(eval, '__import__(\"resim\").__file__'))"
    )
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    told = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    assert told == 2 * [str(tmp_path / "resim" / "__init__.py")]


def test_a_caller_with_many_open_files_can_start_children():
    resource = pytest.importorskip("resource")
    if resource.getrlimit(resource.RLIMIT_NOFILE)[1] < 3000:
        pytest.skip("more files than may be open here")
    code = (
        "import os, resource; resource.setrlimit(resource.RLIMIT_NOFILE, (3000, 3000))\n"
        "held = [os.open(os.devnull, os.O_RDONLY) for _ in range(1500)]\n"
        "from execution import actions; from resim.execution.workers import in_child\n"
        "print(in_child(actions.double, 2))"
    )
    assert run_python(code) == "4\n"


def test_what_children_have_before_they_start_is_there():
    """A module of another name would be missed by nobody: each child would load it itself."""
    files = [path for path in (ROOT / "resim").rglob("*.py") if "\nPRELOADED = (" in path.read_text()]
    names = [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in files]
    needed = {name: importlib.import_module(name).PRELOADED for name in names}
    assert len(needed) > 3
    for each in needed.values():
        for name in each:
            importlib.import_module(name)
