"""What tasks do in tests of the workers; a module of its own, as child processes import it anew."""

from __future__ import annotations

import errno
import os
import random
import signal
import sys
import threading
import time
from pathlib import Path

import numpy as np

from resim.core.errors import FunctionError, ResimError
from resim.core.plugins import loading as plugin
from resim.core.plugins.watchdog import Watchdog
from resim.simulation.function.interface import load_build


def act(task: tuple[str, int]) -> tuple[int, int]:
    """Give the number and the process, or end as the name says."""
    name, number = task
    if name == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    if name == "leave":
        os._exit(7)
    if name == "hang":
        time.sleep(60.0)
    if name == "refuse":
        raise ResimError("the input is wrong")
    if name == "full":
        try:
            raise OSError(errno.ENOSPC, "No space left on device")
        except OSError as e:
            raise ResimError("the cache cannot be written") from e
    if name == "print":
        print("what a function has to say", flush=True)
    if name == "interrupt":
        raise KeyboardInterrupt
    if name == "raise":
        raise ZeroDivisionError("a fault of our own")
    return number, os.getpid()


def doubled(path: str) -> int:
    """Give what the function of a build doubles in a process of its own."""
    build = load_build(Path(path))
    with build.factory.afresh():
        return build.make().doubled(21)  # type: ignore[attr-defined, no-any-return]


def _leave() -> None:
    os._exit(0)


def _never_return() -> None:
    sum(range(10**14))  # compiled code, which no signal interrupts


def _hear_nothing() -> None:
    signal.pthread_sigmask(signal.SIG_BLOCK, range(1, 32))
    time.sleep(600.0)


def _disarm() -> None:
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    time.sleep(600.0)


def _copy() -> None:
    os.fork()


def _kill() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def _speak() -> None:
    print("lost the lane", file=sys.stderr)
    os.write(2, b"assertion x > 0 failed\n\n")
    os.abort()


def _answer() -> None:
    """Be quick."""


IN_FUNCTION = {
    "leave": _leave, "abort": os.abort, "speak": _speak, "never return": _never_return, "hear nothing": _hear_nothing,
    "disarm": _disarm, "copy": _copy, "answer": _answer, "kill": _kill,
}  # fmt: skip


def call(task: tuple[str, int]) -> list[str]:
    """Let a function under test do something so many times, within 0.2 s each; give what it was blamed for."""
    name, times = task
    said = []
    with Watchdog() as watchdog:
        for _ in range(times):
            try:
                watchdog.call(0.2, IN_FUNCTION[name])
                said.append("")
            except FunctionError as e:
                said.append(str(e))
    return said


def linger(name: str) -> None:
    """Let a function under test do something that ends the process when its call is over."""
    late = threading.Timer(0.2, os._exit, [0])
    with Watchdog() as watchdog:
        watchdog.call(5.0, late.start if name == "thread" else lambda: os.closerange(3, 256))
        if name != "files":
            time.sleep(60.0)


def load(file: Path) -> None:
    """Load a build within half a second."""
    plugin.LOAD_LIMIT = 0.5
    load_build(file)


def start_others(note: str) -> None:
    """Fork, start a program, note their numbers, and end this process alone."""
    import subprocess

    program = subprocess.Popen(["sleep", "600"])
    forked = os.fork()
    if not forked:
        time.sleep(600.0)
    Path(note).write_text(f"{program.pid} {forked}")
    os._exit(3)


def let_go(task: tuple[str, str]) -> None:
    """Start a program that leaves the session, or loses its parent; note its number, and go on or wait."""
    import subprocess

    how, note = task
    if how.startswith("session"):
        number = subprocess.Popen(["sleep", "600"], start_new_session=True).pid
    else:
        number = int(subprocess.check_output(["sh", "-c", "sleep 600 >&2 & echo $!"]))
    Path(note).write_text(str(number))
    if how.endswith("waits"):
        time.sleep(600.0)


def is_killed_once(note: str) -> str:
    """Be killed in a call of the function, as by a system that is short of memory; but not the second time."""
    before = Path(note).exists()
    Path(note).touch()
    with Watchdog() as watchdog:
        watchdog.call(20.0, _answer if before else _kill)
    return "done"


def leave_the_folder(folder: str) -> str:
    """Change the working directory after telling it."""
    here = str(Path.cwd())
    os.chdir(folder)
    return here


def order(_: int) -> tuple[list[str], int]:
    """Give names in the order of a set, and the process."""
    return list({f"object {k}" for k in range(50)}), os.getpid()


LOADED_IN = os.getpid()


def is_loaded_here(number: int) -> bool:
    """Say whether this module was loaded by the process that has the task, not by one that forked it."""
    return os.getpid() == LOADED_IN


def environment(name: str) -> str | None:
    """Give a variable of the environment."""
    return os.environ.get(name)


def random_numbers(number: int) -> tuple[float, float]:
    """Give random numbers that nobody gave a seed."""
    return random.random(), float(np.random.rand())  # noqa: NPY002  (which code under test may use)


def ancestors(number: int) -> list[int]:
    """Give the numbers of the process that forked this one's keeper, of the keeper, and its own."""
    found = [os.getpid()]
    while len(found) < 3:
        found.insert(0, int(Path(f"/proc/{found[0]}/stat").read_text().rsplit(")", 1)[1].split()[1]))
    return found


def double(number: int) -> int:
    """Give twice the number."""
    return 2 * number


def who_and_where(_: int) -> tuple[int, bool]:
    """Give this process, and whether a task was done in it before."""
    before = hasattr(who_and_where, "done")
    who_and_where.done = True  # type: ignore[attr-defined]
    return os.getpid(), before
