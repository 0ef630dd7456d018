"""A call's time is that which it takes itself, not what others take from it."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import time

import pytest

from resim.core.errors import FunctionError
from resim.core.plugins.watchdog import Watchdog


def compute() -> str:
    """0.2 s of this thread's own."""
    until = time.thread_time() + 0.2
    while time.thread_time() < until:
        pass
    return "done"


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells how long a thread waited")
def test_who_waits_for_a_processor_is_not_late() -> None:
    cores = sorted(os.sched_getaffinity(0))
    try:
        os.sched_setaffinity(0, cores[:1])  # children have it, too
        others = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(4)]
        time.sleep(0.3)
        begin = time.monotonic()
        with Watchdog() as watchdog:
            assert watchdog.call(0.4, compute) == "done"
        taken = time.monotonic() - begin
    finally:
        os.sched_setaffinity(0, cores)
        for other in others:
            other.kill()
            other.wait()
    assert taken > 0.4  # else nothing was shown


@pytest.mark.parametrize("what", [lambda: time.sleep(5.0), lambda: [None for _ in iter(int, 1)]])
def test_who_sleeps_or_computes_too_long_is_late(what) -> None:
    begin = time.monotonic()
    with Watchdog() as watchdog, pytest.raises(FunctionError, match=r"did not answer within 0\.1 s"):
        watchdog.call(0.1, what)
    assert time.monotonic() - begin < 3.0


def test_nobody_waits_for_ever() -> None:
    with Watchdog() as watchdog:
        watchdog._waiting.time = time.monotonic  # type: ignore[method-assign]  # as if it never got a processor
        begin = time.monotonic()
        with pytest.raises(FunctionError, match=r"did not answer within 0\.1 s"):
            watchdog.call(0.1, lambda: time.sleep(30.0))
        assert 0.9 < time.monotonic() - begin < 10.0


def test_a_collection_of_the_whole_process_is_not_the_functions_time(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("resim.core.plugins.watchdog._MOST", 100.0)  # a busy machine takes long
    heard = []

    def looked(phase: str, info: dict[str, int]) -> None:
        if phase == "start" and info["generation"] == 2:
            heard.extend(compute() for _ in range(4))  # as a heap of millions takes

    gc.freeze()  # what tests before left: to look through that may take longer than a call has in all
    try:
        with Watchdog() as watchdog:
            gc.callbacks.append(looked)
            try:
                assert watchdog.call(0.5, gc.collect) >= 0
            finally:
                gc.callbacks.remove(looked)
    finally:
        gc.unfreeze()
    assert heard == ["done"] * 4


def test_code_within_a_collection_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    class Endless:
        def __del__(self) -> None:
            time.sleep(30.0)

    def leaves_one() -> None:
        it = Endless()
        it.it = it  # type: ignore[attr-defined]
        del it
        gc.collect()

    monkeypatch.setattr(sys, "unraisablehook", lambda _: None)  # pytest's own may be interrupted as well
    begin = time.monotonic()
    with Watchdog() as watchdog, pytest.raises(FunctionError, match=r"within 0\.1 s|longer than 0\.1 s"):
        watchdog.call(0.1, leaves_one)
    assert time.monotonic() - begin < 10.0
