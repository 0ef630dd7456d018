"""Tasks of the Supervisor: see them, and cancel, pause, repeat or reorder them; what `resim tasks` and pages do."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

from resim.core.errors import InputError
from resim.core.files import read_file
from resim.core.watched import LOG
from resim.results.catalog import Catalog
from resim.results.queue import PRIORITIES, QueuedTask, TaskQueue

MOST_WAITING = 10_000
"""Tasks that may wait or pause."""


def check_room(queue: TaskQueue, what: str) -> None:
    """Refuse a further task where very many wait.

    Args:
        queue: The queue.
        what: Is to be put in.

    Raises:
        InputError: There is no room.
    """
    counts = queue.counts()
    if counts.get("waiting", 0) + counts.get("paused", 0) >= MOST_WAITING:
        raise InputError(
            what, f"has to wait: {MOST_WAITING} tasks are waiting already", "Cancel some of them."
        )


def _retry(queue: TaskQueue, name: str) -> bool:
    check_room(queue, name)
    return queue.retry(name)


ACTS: Mapping[str, Callable[[TaskQueue, str], bool]] = {
    "cancel": TaskQueue.cancel,
    "pause": TaskQueue.pause,
    "resume": TaskQueue.resume,
    "retry": _retry,
    "first": TaskQueue.put_first,
    "earlier": lambda queue, name: queue.move(name, -1),
    "later": lambda queue, name: queue.move(name, 1),
    **{called: partial(TaskQueue.prioritise, priority=number) for called, number in PRIORITIES.items()},
}
"""What may be done with a task; each says whether there was anything to do."""


def list_tasks(catalog: Catalog, *, ended: int = 20) -> list[QueuedTask]:
    """Give tasks: those that pause, run and wait, in their order, then those that ended, the latest first.

    Args:
        catalog: In whose database the queue is.
        ended: How many of those that ended, at most.

    Returns:
        The tasks.

    Raises:
        InputError: The database cannot be used.
    """
    queue = TaskQueue(catalog)
    return [*queue.unfinished(), *queue.ended(0, ended)]


def add_task(
    catalog: Catalog,
    folder: Path,
    job: str,
    words: Sequence[str],
    *,
    again: Sequence[str] = (),
    priority: str = "normal",
) -> QueuedTask:
    """Put a call of the command line into the queue, which a Supervisor on this machine does.

    Args:
        catalog: In whose database the queue is.
        folder: Of its log, and of results that go nowhere else; called like its id, of `resim.results.queue.new_id`.
        job: What it is, by the name of its form.
        words: The command line after `resim`, with whole paths.
        again: Words that a further attempt has besides.
        priority: One of PRIORITIES.

    Returns:
        The task.

    Raises:
        InputError: There is no room, or the database cannot be used.
    """
    queue = TaskQueue(catalog)
    check_room(queue, job)
    task = queue.add(folder.name, job, words, str(folder), again)
    if not PRIORITIES[priority]:
        return task
    # of one that a server took meanwhile it says nothing any more
    queue.prioritise(task.id, PRIORITIES[priority])
    return queue.get(task.id)


def read_task_log(catalog: Catalog, wanted: str) -> str:
    """Give what stands in the log of a task.

    Args:
        catalog: In whose database the queue is.
        wanted: Its id, or the first four or more digits of it.

    Returns:
        The log, as far as it is written.

    Raises:
        InputError: There is no such task, it has no log on this machine, or the database cannot be used.
    """
    queue = TaskQueue(catalog)
    task = queue.get(queue.find(wanted))
    remedy = f"It is {task.state}, and done on {task.host}."
    return read_file(Path(task.folder) / LOG, remedy).decode(errors="replace")


def steer_task(catalog: Catalog, wanted: str, act: str) -> tuple[QueuedTask, bool]:
    """Do something with a task.

    Args:
        catalog: In whose database the queue is.
        wanted: Its id, or the first four or more digits of it.
        act: One of ACTS.

    Returns:
        The task as it is now, and whether there was anything to do.

    Raises:
        InputError: There is no such task, or no room, or the database cannot be used.
    """
    queue = TaskQueue(catalog)
    name = queue.find(wanted)
    done = ACTS[act](queue, name)
    return queue.get(name), done
