"""What crashes, hangs or is killed costs its own task only."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from execution import slow_start
from execution.actions import (
    act,
    call,
    doubled,
    is_killed_once,
    leave_the_folder,
    let_go,
    linger,
    load,
    order,
    start_others,
    who_and_where,
)
from processes import below

from resim.core.errors import FunctionError
from resim.execution import workers
from resim.execution.child import Failure
from resim.execution.workers import _end_own, in_child, in_fresh_child, run_all

POOL = """import multiprocessing
import helper

def act(x):
    return helper.double(x)

class Own:
    def reset(self, setup): pass
    def step(self, perceived): pass
    def close(self): pass
    def doubled(self, x):
        with multiprocessing.get_context("{method}").Pool(1) as pool:
            return pool.apply_async(act, [x]).get(20.0)
"""


@pytest.mark.parametrize("workers", [1, 2])
def test_every_task_has_a_result_whatever_breaks(workers: int) -> None:
    names = ["do", "kill", "do", "refuse", "leave", "do", "raise", "do"]
    tasks = [(name, k) for k, name in enumerate(names)]
    found = dict(run_all(act, tasks, workers=workers, time_limit=30.0))
    assert sorted(found) == list(range(len(tasks)))
    done = {k: r for k, r in found.items() if not isinstance(r, Failure)}
    assert {k: r[0] for k, r in done.items()} == {0: 0, 2: 2, 5: 5, 7: 7}
    assert os.getpid() not in {r[1] for r in done.values()}
    assert found[1] == Failure("the process was ended by SIGKILL", crashed=True)
    assert found[3] == Failure("the input is wrong", crashed=False)
    assert found[4] == Failure("the process ended with code 7", crashed=True)
    raised = found[6]
    assert isinstance(raised, Failure)
    assert raised.crashed
    assert "ZeroDivisionError" in raised.reason


def test_a_process_is_used_again() -> None:
    found = dict(run_all(act, [("do", k) for k in range(6)], workers=2, time_limit=30.0))
    assert len({pid for _, pid in found.values()}) <= 2


def test_sets_have_the_same_order_in_every_process() -> None:
    found = [next(run_all(order, [0], workers=1, time_limit=30.0))[1] for _ in range(2)]
    assert found[0][1] != found[1][1]
    assert found[0][0] == found[1][0]


def test_a_task_that_raises_what_ends_a_process_costs_itself_only(capfd: pytest.CaptureFixture[str]) -> None:
    found = dict(run_all(act, [("interrupt", 0), ("print", 1)], workers=1, time_limit=30.0))
    assert found[0] == Failure("unexpected KeyboardInterrupt() in act (actions.py)", crashed=True)
    assert found[1][0] == 1
    out, err = capfd.readouterr()
    assert (out, err) == ("", "what a function has to say\n")


def test_what_hangs_is_ended() -> None:
    found = dict(run_all(act, [("hang", 0), ("do", 1)], workers=1, time_limit=1.5))
    assert found[0] == Failure("took longer than 1.5 s", crashed=True)
    assert found[1][0] == 1


def test_the_start_of_a_process_is_not_time_of_its_task() -> None:
    assert dict(run_all(slow_start.answer, [3], workers=1, time_limit=0.75)) == {0: 3}


def test_stopping_early_ends_the_processes() -> None:
    results = run_all(act, [("do", 0), ("hang", 1), ("hang", 2)], workers=2, time_limit=60.0)
    _, (_, pid) = next(results)
    results.close()
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_what_the_system_refuses_is_worth_another_attempt() -> None:
    found = dict(run_all(act, [("full", 0)], workers=1, time_limit=30.0))
    assert found[0] == Failure("the cache cannot be written", crashed=True)


@pytest.mark.parametrize(
    ("name", "times", "why"),
    [
        ("leave", 3, "ended its process, which ended with code 0"),
        ("abort", 1, "ended its process, which was ended by SIGABRT"),
        (
            "speak",
            1,
            "ended its process, which was ended by SIGABRT; its last words: lost the lane | assertion x > 0 failed",
        ),
        ("never return", 1, "did not answer within 0.2 s, and could not be interrupted"),
        ("hear nothing", 1, "did not answer within 0.2 s, and could not be interrupted"),
        ("disarm", 1, "did not answer within 0.2 s, and could not be interrupted"),
        ("copy", 2, ""),
        ("kill", 1, "ended its process, which was ended by SIGKILL twice in the same call"),
    ],
)
def test_what_a_function_does_to_its_process_is_told_as_its_failure(name: str, times: int, why: str) -> None:
    found = dict(run_all(call, [(name, times), ("copy", 1)], workers=1, time_limit=60.0))
    assert found == {0: [why] * times, 1: [""]}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "how"),
    [
        ("thread", "ended with code 0"),
        ("files", "ended with code 1"),
        ("files, and works on", "closed its connection"),
    ],
)
def test_who_ends_the_process_outside_of_a_call_is_the_function(name: str, how: str) -> None:
    (found,) = dict(run_all(linger, [name], workers=1, time_limit=60.0)).values()
    assert found.of_function
    assert "ended its process outside its calls, for example from a thread" in found.reason
    assert found.reason.endswith(f"it {how}")


def test_a_fresh_child_knows_of_no_task_and_the_other_goes_on() -> None:
    _end_own()
    (first, known), (fresh, seen), (again, remembered) = (
        do(who_and_where, 0) for do in (in_child, in_fresh_child, in_child)
    )
    assert (known, seen, remembered) == (False, False, True)
    assert first == again != fresh
    assert fresh not in below(os.getpid())


@pytest.mark.parametrize(
    ("top", "why"),
    [
        ("while True: pass", "it did not answer within 0.5 s."),
        ("sum(range(10**14))", "it did not answer within 0.5 s, and could not be interrupted."),
        ("import os; os._exit(0)", "it ended its process, which ended with code 0."),
    ],
)
def test_a_module_that_cannot_be_imported_in_time_is_the_functions_failure(
    write_build: Callable[..., Path], top: str, why: str
) -> None:
    file = write_build(top)
    _end_own()  # one that ran no user's code yet, which would be blamed for the other limit
    with pytest.raises(FunctionError) as told:
        in_child(load, file)
    _end_own()
    assert str(told.value).startswith(f"{file}: factory module ")
    assert why in str(told.value)
    assert "Move what takes long" in str(told.value)


def test_a_function_that_ends_its_process_over_and_over_is_given_up() -> None:
    why = "the function ended its process, which ended with code 0"
    found = dict(run_all(call, [("leave", 9)], workers=1, time_limit=60.0))
    assert found == {0: Failure(why, crashed=True, of_function=True)}


def test_many_quick_calls_are_never_taken_for_a_slow_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "_TICK", 0.0)  # look all the time
    found = dict(run_all(call, [("answer", 200_000)], workers=1, time_limit=60.0))
    assert found == {0: [""] * 200_000}


def test_what_a_process_started_holds_nothing_up_and_ends_with_it(tmp_path: Path) -> None:
    begin = time.monotonic()
    found = dict(run_all(start_others, [str(tmp_path / "others")], workers=1, time_limit=600.0))
    assert found == {0: Failure("the process ended with code 3", crashed=True)}
    others = [int(number) for number in (tmp_path / "others").read_text().split()]
    while not all(map(is_gone, others)):
        assert time.monotonic() < begin + 60.0
        time.sleep(0.05)


@pytest.mark.parametrize("how", ["session", "orphan"])
def test_a_process_that_was_let_go_is_ended_and_is_the_functions_failure(tmp_path: Path, how: str) -> None:
    tasks = [(how, str(tmp_path / number)) for number in "12"]
    for k, found in run_all(let_go, tasks, workers=1, time_limit=60.0):
        why = "code that this task ran left processes behind that outlive it (sleep)"
        assert found == Failure(why, crashed=False, of_function=True)
        assert is_gone(int(Path(tasks[k][1]).read_text()))


@pytest.mark.parametrize("how", ["session, and waits", "orphan, and waits"])
def test_what_left_the_session_ends_with_its_process(tmp_path: Path, how: str) -> None:
    note = tmp_path / "number"
    found = dict(run_all(let_go, [(how, str(note))], workers=1, time_limit=1.5))
    assert found == {0: Failure("took longer than 1.5 s", crashed=True)}
    assert is_gone(int(note.read_text()))


@pytest.mark.parametrize("how", ["session, and waits", "orphan, and waits"])
def test_nothing_outlives_a_command_that_is_killed(tmp_path: Path, how: str) -> None:
    note = tmp_path / "number"
    program = (
        "from execution.actions import let_go\nfrom resim.execution.workers import run_all\n"
        f"[*run_all(let_go, [({how!r}, {str(note)!r})], workers=1, time_limit=600.0)]"
    )
    path = os.pathsep.join(filter(None, sys.path))
    command = subprocess.Popen([sys.executable, "-c", program], env={**os.environ, "PYTHONPATH": path})
    until = time.monotonic() + 60.0
    while not (note.exists() and note.read_text()) and time.monotonic() < until:
        time.sleep(0.02)
    command.kill()
    command.wait()
    while not is_gone(int(note.read_text())):
        assert time.monotonic() < until
        time.sleep(0.02)


def test_who_was_killed_once_from_outside_is_not_to_blame(tmp_path: Path) -> None:
    found = dict(run_all(is_killed_once, [str(tmp_path / "once")], workers=1, time_limit=60.0))
    assert found == {0: "done"}


@pytest.mark.parametrize("method", ["fork", "spawn", "forkserver"])
def test_a_pool_of_a_function_finds_its_modules_whatever_the_start_method(
    tmp_path: Path, write_build: Callable[..., Path], method: str
) -> None:
    path = write_build(POOL.format(method=method))
    path.with_name("helper.py").write_text("def double(x): return 2 * x\n")
    assert dict(run_all(doubled, [str(path)] * 2, workers=1, time_limit=60.0)) == {0: 42, 1: 42}


def is_gone(process: int) -> bool:
    """Whether a process is no more, or only waits for somebody to take note of its end."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] in "ZX"
    except OSError:
        return True


def test_every_task_begins_in_the_folder_of_the_command(tmp_path: Path) -> None:
    found = dict(run_all(leave_the_folder, [str(tmp_path)] * 2, workers=1, time_limit=60.0))
    assert found == dict.fromkeys((0, 1), str(Path.cwd()))


def test_no_tasks() -> None:
    assert list(run_all(act, [], workers=2, time_limit=1.0)) == []
