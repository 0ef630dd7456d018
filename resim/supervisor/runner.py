"""The process that does one attempt of a task, and notes how it ended: `python -m resim.supervisor.runner FOLDER`.

It is a session of its own, so that a server that is killed leaves it alone, and the next server finds it again. Of all
that are started for one task, one at a time works, and each attempt is made once: a lock and a number, both in the
task's folder, see to that, whatever servers believe.
"""

from __future__ import annotations

import ctypes
import fcntl
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from resim.core.watched import LIVE_VARIABLE, LOG, PROGRESS
from resim.supervisor.processes import process_name, read_whole, write_whole

TASK_FILE, BEGUN, EXIT, LOCK = "task.json", "begun.json", "exit.json", "lock"
LIVE = "live.json"
"""What the latest simulation of the command does now, while it runs (`resim.simulation.live`)."""
OWN_FILES = frozenset({LOG, TASK_FILE, BEGUN, EXIT, LOCK, LIVE, PROGRESS})
"""What lies in the folder of a task besides what its command wrote."""
PATIENCE = 10.0
"""s that a command has to end after it was asked to."""
_WITH_PARENT = 1
"""PR_SET_PDEATHSIG of Linux."""


def run(folder: Path) -> int:
    """Do the attempt that task.json tells of. Gives 0 where it was made, 75 where another process makes it or did."""
    lock = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o600)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # gone with the process, however it ends
    except BlockingIOError:
        return 75
    told = read_whole(folder / TASK_FILE)
    attempt = int(told["attempt"])
    if int(read_whole(folder / BEGUN).get("attempt", 0)) >= attempt:
        return 75
    write_whole(folder / BEGUN, {"attempt": attempt, "process": process_name(), "began": time.time()})
    for name in (LIVE, PROGRESS):
        (folder / name).unlink(missing_ok=True)
    if attempt > 1 and "fresh" in told:
        _put_aside(Path(told["fresh"]))
    code = _call(folder, told["words"], attempt)
    if code in (0, 1) and "entered" in told:
        _call(folder, ["lake", "add", "--", told["entered"]])  # in the lake it can be given to the next job
    (folder / LIVE).unlink(missing_ok=True)
    write_whole(folder / EXIT, {"attempt": attempt, "code": code, "ended": time.time()})
    return 0


def _put_aside(made: Path) -> None:
    """Give what an attempt before made another name: nothing is deleted."""
    if os.path.lexists(made):
        names = (made.with_name(f"{made.stem}.before-{k}{made.suffix}") for k in range(1, 10_000))
        made.rename(next(name for name in names if not os.path.lexists(name)))


def _call(folder: Path, words: list[str], attempt: int = 1) -> int:
    """Call the command, with all that it prints in the log, and give its exit code."""
    stopped: list[int] = []
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, lambda signalled, frame: stopped.append(signalled))
    with (folder / LOG).open("ab", buffering=0) as log:
        again = f" (attempt {attempt})" if attempt > 1 else ""
        log.write(f"$ resim {' '.join(words)}{again}\n".encode(errors="replace"))
        command = [sys.executable, "-P", "-m", "resim", *words]
        child = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, cwd=folder, preexec_fn=_end_with_parent,
            env={**os.environ, LIVE_VARIABLE: str(folder / LIVE)},
        )  # fmt: skip
        asked = 0.0
        while True:
            try:
                return child.wait(0.2)
            except subprocess.TimeoutExpired:
                now = time.monotonic()
            if stopped and not asked:
                asked = now
                child.terminate()
            elif asked and now > asked + PATIENCE:
                child.kill()


def _end_with_parent() -> None:
    """In the command, before it begins: it is killed where this process is, and a new attempt finds nobody at work."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_WITH_PARENT, signal.SIGKILL, 0, 0, 0)


if __name__ == "__main__":
    sys.exit(run(Path(sys.argv[1])))
