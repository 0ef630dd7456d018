"""Does the tasks of a queue: takes them, has each done by a process of its own, and notes how it ended."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

from resim.core.errors import ResimError
from resim.core.watched import LOG
from resim.results.queue import QueuedTask, TaskQueue, TaskState
from resim.supervisor.processes import is_alive, number_of, opened, process_name, read_whole, write_whole
from resim.supervisor.runner import BEGUN, EXIT, PATIENCE, TASK_FILE

LOOK = 0.3
"""s between two looks."""
BEAT = 10.0
"""s between two words that this server is there."""
MOST_STARTS = 5
"""How often a process is started that does not begin."""
MOST_CODE = 1_000
LAST_WORDS = 4_000
"""Bytes of the end of a log in which the reason is looked for."""
_STATES: dict[int, TaskState] = {0: "done", 1: "bad"}
MadeBy = Callable[[QueuedTask], Mapping[str, str]]


class Worker:
    """A thread that does tasks, at most `jobs` at once. What it starts goes on when it, or its process, ends.

    Attributes:
        server: The process that it is a part of, as the queue names it.
        fault: What keeps it from working, "" where nothing does.
    """

    def __init__(self, queue: TaskQueue, jobs: int, made_by: MadeBy = lambda task: {}) -> None:
        """made_by: gives the path of what a task makes as `entered` where the lake is to know it afterwards, and as
        `fresh` where it must not be there before."""
        self._queue, self._jobs, self._made_by = queue, jobs, made_by
        self.server = process_name()
        self._children: dict[str, subprocess.Popen[bytes]] = {}
        self._starts: dict[tuple[str, int], int] = {}
        self._asked: dict[str, float] = {}
        self._beaten = 0.0
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._work, name="worker", daemon=True)
        self.fault = ""

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """Take no further task; those that run go on, for the next server."""
        self._ending.set()
        self._thread.join(5.0)

    def _work(self) -> None:
        while not self._ending.wait(LOOK):
            try:
                self.look()
                self.fault = ""
            except (
                Exception
            ) as e:  # of the database or the disk, which may pass: without it nothing would be done
                self.fault = str(e) if isinstance(e, (ResimError, OSError)) else f"{type(e).__name__}: {e}"
                self._ending.wait(2.0)

    def look(self) -> None:
        """Look after all tasks once."""
        self._queue.adopt(self.server, lambda server: not is_alive(server))
        mine = self._queue.of_server(self.server)
        if time.monotonic() > self._beaten + BEAT:
            self._queue.beat(self.server)
            self._beaten = time.monotonic()
        running = sum(not self._look_after(task) for task in mine)
        while running < self._jobs and not self._ending.is_set():
            if (task := self._queue.claim(self.server)) is None:
                break
            self._begin(task)
            running += 1

    def _look_after(self, task: QueuedTask) -> bool:
        """Note how a task ended, if it did; end it where somebody asked for that. Says whether it ended."""
        folder = Path(task.folder)
        ended, begun = read_whole(folder / EXIT), read_whole(folder / BEGUN)
        if ended.get("attempt") == task.attempt:
            code = ended.get("code")
            self._forget(task)
            if not isinstance(code, int) or abs(code) > MOST_CODE:
                return self._queue.end(task, "failed", told=f"{EXIT} in its folder was altered")
            if task.stop and code not in (0, 1):
                return self._stopped(task, code)
            told = "" if code == 0 else _reason(folder)
            return self._queue.end(task, _STATES.get(code, "failed"), code=code, told=told)
        child = self._children.get(task.id)
        is_begun = begun.get("attempt") == task.attempt
        process = str(begun.get("process", ""))
        if is_begun and is_alive(process):
            if task.stop:
                self._end(task, process)
            return False
        if child is not None and child.poll() is None:
            return False
        if read_whole(folder / EXIT).get("attempt") == task.attempt:  # it ended meanwhile
            return self._look_after(task)
        if task.stop:
            self._forget(task)
            return self._stopped(task)
        if is_begun or self._starts.get((task.id, task.attempt), 0) >= MOST_STARTS:
            self._forget(task)
            return self._queue.lose(task)
        self._begin(task)
        return False

    def _stopped(self, task: QueuedTask, code: int | None = None) -> bool:
        """Note that a task was stopped, for good or to go on later."""
        if task.is_pausing:
            return self._queue.put_aside(task)
        return self._queue.end(task, "cancelled", code=code)

    def _begin(self, task: QueuedTask) -> None:
        """Start the process of a task; where there is one already, it ends by itself."""
        folder = Path(task.folder)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            told: dict[str, object] = {"attempt": task.attempt, "words": [*task.call], "job": task.job}
            write_whole(folder / TASK_FILE, {**told, **self._made_by(task)})
            command = [sys.executable, "-P", "-m", "resim.supervisor.runner", str(folder)]
            quiet = subprocess.DEVNULL
            with (folder / LOG).open("ab") as log:
                self._children[task.id] = subprocess.Popen(
                    command, stdin=quiet, stdout=quiet, stderr=log, cwd=folder, start_new_session=True
                )
        except OSError as e:
            self._queue.end(task, "failed", told=f"it could not be started: {e}")
            return
        key = (task.id, task.attempt)
        self._starts[key] = self._starts.get(key, 0) + 1

    def _end(self, task: QueuedTask, process: str) -> None:
        """Ask the process of a task to end, and kill it where it does not."""
        first = self._asked.setdefault(task.id, time.monotonic())
        with suppress(OSError):
            if time.monotonic() > first + 2.0 * PATIENCE:
                os.killpg(number_of(process), signal.SIGKILL)
            else:
                os.kill(number_of(process), signal.SIGTERM)

    def _forget(self, task: QueuedTask) -> None:
        self._asked.pop(task.id, None)
        self._starts.pop((task.id, task.attempt), None)
        if (child := self._children.pop(task.id, None)) is not None:
            with suppress(subprocess.TimeoutExpired):
                child.wait(1.0)


def _reason(folder: Path) -> str:
    """The last line of the log that says something."""
    try:
        with opened(folder / LOG) as log:
            log.seek(0, os.SEEK_END)
            log.seek(max(0, log.tell() - LAST_WORDS))
            lines = log.read().decode(errors="replace").splitlines()
    except OSError:
        return ""
    return next((line.strip()[:500] for line in reversed(lines) if line.strip()), "")
