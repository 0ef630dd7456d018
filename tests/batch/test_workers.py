"""What crashes, hangs or is killed costs its own task only."""

from __future__ import annotations

import os

import pytest
from batch.deeds import act

from resim.batch.child import Failure
from resim.batch.workers import run_all


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


def test_a_task_that_raises_what_ends_a_process_costs_itself_only(capfd: pytest.CaptureFixture[str]) -> None:
    found = dict(run_all(act, [("interrupt", 0), ("print", 1)], workers=1, time_limit=30.0))
    assert found[0] == Failure("KeyboardInterrupt() in act (deeds.py)", crashed=True)
    assert found[1][0] == 1
    out, err = capfd.readouterr()
    assert (out, err) == ("", "what a function has to say\n")


def test_what_hangs_is_ended() -> None:
    found = dict(run_all(act, [("hang", 0), ("do", 1)], workers=1, time_limit=1.5))
    assert found[0] == Failure("took longer than 1.5 s", crashed=True)
    assert found[1][0] == 1


def test_stopping_early_ends_the_processes() -> None:
    results = run_all(act, [("do", 0), ("hang", 1), ("hang", 2)], workers=2, time_limit=60.0)
    _, (_, pid) = next(results)
    results.close()
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_what_the_system_refuses_is_worth_another_attempt() -> None:
    found = dict(run_all(act, [("full", 0)], workers=1, time_limit=30.0))
    assert found[0] == Failure("the cache cannot be written", crashed=True)


def test_no_tasks() -> None:
    assert list(run_all(act, [], workers=2, time_limit=1.0)) == []
