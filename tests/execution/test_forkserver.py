"""Children are forked by a process that has loaded resim: none is another for it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from execution import actions

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
