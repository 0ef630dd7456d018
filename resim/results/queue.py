"""The queue of tasks: what is to be done, in which order, by which server, and what came of it.

One row a task in `resim_task`, in the catalog's database, but a state of its own: results say nothing of tasks. A task
is a call of the command line, and is done on the machine on which it was put in, where its paths are good.
"""

from __future__ import annotations

import json
import platform
import secrets
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from typing import Any, Literal

from sqlalchemy import ColumnElement, Connection, Row, String, case, cast, func, insert, select, update

from resim.core.errors import InputError
from resim.results.catalog import Catalog
from resim.results.tables import TASK

TaskState = Literal["waiting", "running", "paused", "done", "bad", "failed", "cancelled", "lost"]
"""paused: it waits until somebody lets it go on; done: the command ended with 0; bad: with 1, a verdict is bad; failed:
with anything else; lost: its process was killed too often to begin it once more."""
ENDED: tuple[TaskState, ...] = ("done", "bad", "failed", "cancelled", "lost")
SILENT = 60.0
"""s without a word of a server after which another one takes its tasks over."""
PAUSING = "it is being stopped, to go on later"
"""What is told of a task that runs and is to pause."""
LEAST = 4
"""Digits of an id that name a task."""
PRIORITIES: Mapping[str, int] = {"high": 1, "normal": 0, "low": -1}
MOST_LOSSES = 2
"""How often a task begins anew by itself after its process was killed."""


@dataclass(frozen=True)
class QueuedTask:
    """A task of the queue. Times are seconds since 1970, None where it is not that far.

    job: name of the command. words: the command line after `resim`. again: words that a further attempt has besides.
    folder: of its log and its results, on the machine `host`. place: smaller ones first, among those of one priority,
    of which greater ones come first. attempt: how often it was begun; losses: how often its process was killed.
    server: which process looks after it, and beat: when it said so last. stop: whether somebody asked to cancel it.
    code: exit code. told: why it failed.
    """

    id: str
    job: str
    words: tuple[str, ...]
    again: tuple[str, ...]
    folder: str
    host: str
    state: TaskState
    priority: int
    place: float
    created: float
    begun: float | None
    ended: float | None
    attempt: int
    losses: int
    server: str
    beat: float
    stop: bool
    code: int | None
    told: str
    changed: float

    @property
    def is_pausing(self) -> bool:
        """Whether it is being stopped to go on later."""
        return self.stop and self.told == PAUSING

    @property
    def urgency(self) -> str:
        """The name of its priority."""
        return "high" if self.priority > 0 else "low" if self.priority < 0 else "normal"

    @property
    def call(self) -> tuple[str, ...]:
        """The command line of the attempt that is made now."""
        if self.attempt <= 1:
            return self.words
        # behind "--" nothing is an option
        end = self.words.index("--") if "--" in self.words else len(self.words)
        return (*self.words[:end], *self.again, *self.words[end:])


def new_id() -> str:
    """Give the id of a new task."""
    return secrets.token_hex(8)


class TaskQueue:
    """The queue in the database of a catalog. Every method raises InputError where that cannot be used.

    What several processes may do at once is one statement that says what it expects to find: who comes late changes
    nothing.
    """

    def __init__(self, catalog: Catalog, host: str = "") -> None:
        self._catalog, self.host = catalog, host or platform.node()

    def add(
        self, name: str, job: str, words: Sequence[str], folder: str, again: Sequence[str] = ()
    ) -> QueuedTask:
        """Put a task in with normal priority, behind all others of it. name: its id, of `new_id`; folder: its own."""
        now = time.time()
        row = {
            "id": name, "job": job, "words": [*words], "again": [*again], "folder": folder, "host": self.host,
            "state": "waiting", "priority": 0, "place": now, "created": now, "attempt": 0, "losses": 0,
            "server": "", "beat": 0.0, "stop": False, "told": "", "changed": now,
        }  # fmt: skip
        with self._begun() as connection:
            connection.execute(insert(TASK).values(row))
        return self.get(name)

    def get(self, name: str) -> QueuedTask:
        """Give a task by its id. Raises InputError where there is none."""
        with self._begun() as connection:
            row = connection.execute(select(TASK).where(TASK.c.id == name)).one_or_none()
        if row is None:
            raise InputError(name, "is no task of the queue")
        return _task(row)

    def find(self, wanted: str) -> str:
        """Give the id of the task that begins so. Raises InputError where there is none, or several."""
        begins = TASK.c.id.startswith(wanted, autoescape=True)
        with self._begun() as connection:
            found = connection.scalars(select(TASK.c.id).where(begins).limit(2)).all()
        if len(wanted) < LEAST or len(found) != 1:
            problem = "begins several ids" if len(found) > 1 else "is no task of the queue"
            raise InputError(wanted, problem, f"Give {LEAST} or more digits that `resim tasks list` shows.")
        return str(found[0])

    def unfinished(self) -> list[QueuedTask]:
        """Give all that pause, then all that run, then all that wait, each in the order in which they come."""
        order = (TASK.c.state, TASK.c.priority.desc(), TASK.c.place, TASK.c.id)
        states = ("paused", "running", "waiting")
        return self._tasks(select(TASK).where(TASK.c.state.in_(states)).order_by(*order))

    def ended(self, first: int, most: int, *, bad: bool = False) -> list[QueuedTask]:
        """Give those that ended, the latest first, from number `first` on; bad: those alone that did not end well."""
        states = [s for s in ENDED if not (bad and s in ("done", "cancelled"))]
        found = select(TASK).where(TASK.c.state.in_(states)).order_by(TASK.c.ended.desc(), TASK.c.id)
        return self._tasks(found.offset(first).limit(most))

    def done_with(self, path: str, most: int) -> list[QueuedTask]:
        """Give those that were given a path and ended with 0, the latest first."""
        whole = json.dumps(path)  # as it stands among the words
        is_given = cast(TASK.c.words, String).contains(whole, autoescape=True)
        found = select(TASK).where(TASK.c.state == "done", is_given).order_by(TASK.c.ended.desc(), TASK.c.id)
        return self._tasks(found.limit(most))

    def counts(self) -> dict[str, int]:
        """Give how many tasks are in which state."""
        with self._begun() as connection:
            rows = connection.execute(select(TASK.c.state, func.count()).group_by(TASK.c.state)).all()
        return {str(state): int(count) for state, count in rows}

    def version(self) -> tuple[int, float]:
        """Give what is another one after every change that a reader sees."""
        with self._begun() as connection:
            count, latest = connection.execute(select(func.count(), func.max(TASK.c.changed))).one()
        return int(count), float(latest or 0.0)

    # what users do

    def cancel(self, name: str) -> bool:
        """End a task that waits; ask the server of one that runs to stop it. Says whether there was anything to do."""
        now = time.time()
        waiting = self._change(name, ("waiting", "paused"), state="cancelled", ended=now)
        return waiting or self._change(name, ("running",), stop=True, told="")

    def pause(self, name: str) -> bool:
        """Let a task that waits wait until it is resumed; ask the server of one that runs to stop it until then.

        Says whether there was anything to do. What a stopped command had finished is kept if it can resume.
        """
        waiting = self._change(name, ("waiting",), state="paused")
        return waiting or self._change(name, ("running",), TASK.c.stop.is_(False), stop=True, told=PAUSING)

    def resume(self, name: str) -> bool:
        """Let a task that pauses wait again, at its place. Says whether it paused."""
        return self._change(name, ("paused",), state="waiting")

    def retry(self, name: str) -> bool:
        """Let a task that ended wait again, behind all others of its priority. Says whether it was one."""
        now = time.time()
        return self._change(
            name, ENDED, state="waiting", place=now, ended=None, begun=None, losses=0, stop=False, code=None, told=""
        )  # fmt: skip

    def prioritise(self, name: str, priority: int) -> bool:
        """Let a task that waits or pauses come before all of a smaller priority. Says whether it was one."""
        return self._change(name, ("waiting", "paused"), priority=priority)

    def put_first(self, name: str) -> bool:
        """Let a task that waits come before all others, with the priority of the first one. Says whether it waits."""
        waiting = TASK.c.state == "waiting"
        highest = select(func.max(TASK.c.priority)).where(waiting).scalar_subquery()
        front = select(func.min(TASK.c.place)).where(waiting, TASK.c.priority == highest).scalar_subquery()
        return self._change(name, ("waiting",), priority=highest, place=front - 1.0)

    def move(self, name: str, by: int) -> bool:
        """Let a task that waits change places with the one before (by < 0) or behind. Says whether there was one."""
        waiting = [t for t in self.unfinished() if t.state == "waiting"]
        at = next((k for k, t in enumerate(waiting) if t.id == name), None)
        if at is None or not 0 <= (to := at + (1 if by > 0 else -1)) < len(waiting):
            return False
        one, other = waiting[at], waiting[to]
        like = [(TASK.c.id == t.id, u) for t, u in ((one, other), (other, one))]
        swap = update(TASK).where(_is_as(one) | _is_as(other)).values(
            priority=case(*((is_it, u.priority) for is_it, u in like)),
            place=case(*((is_it, u.place) for is_it, u in like)), changed=time.time(),
        )  # fmt: skip
        with self._catalog.connected() as connection, connection.begin() as transaction:
            if connection.execute(swap).rowcount == 2:
                return True
            transaction.rollback()
        return self.move(name, by)  # somebody else changed one of them meanwhile

    # what servers do

    def claim(self, server: str) -> QueuedTask | None:
        """Take the next task that waits on this machine, which then runs; None where there is none.

        One statement, so that a task is never taken twice: who is late finds it running.
        """
        now = time.time()
        waiting = (TASK.c.state == "waiting") & (TASK.c.host == self.host)
        order = (TASK.c.priority.desc(), TASK.c.place, TASK.c.id)
        first = select(TASK.c.id).where(waiting).order_by(*order).limit(1).scalar_subquery()
        taken = (
            update(TASK)
            .where(TASK.c.id == first, TASK.c.state == "waiting")
            .values(
                state="running",
                server=server,
                beat=now,
                begun=now,
                attempt=TASK.c.attempt + 1,
                stop=False,
                changed=now,
            )
            .returning(TASK)
        )
        with self._begun() as connection:
            if connection.scalar(select(TASK.c.id).where(waiting).limit(1)) is None:
                return None  # the file is not locked for nothing
        with self._begun() as connection:
            row = connection.execute(taken).one_or_none()
        return None if row is None else _task(row)

    def of_server(self, server: str) -> list[QueuedTask]:
        """Give what runs and is looked after by a server."""
        return self._tasks(select(TASK).where(TASK.c.state == "running", TASK.c.server == server))

    def adopt(self, server: str, is_gone: Callable[[str], bool]) -> list[QueuedTask]:
        """Take over what runs on this machine and nobody looks after any more.

        is_gone: says of a server whether its process has ended. One that says nothing any more has its tasks taken,
        too.
        """
        found = select(TASK).where(
            TASK.c.state == "running", TASK.c.host == self.host, TASK.c.server != server
        )
        adopted = []
        for task in self._tasks(found):
            now = time.time()
            if now - task.beat > SILENT or is_gone(task.server):
                whose = (TASK.c.id == task.id) & (TASK.c.server == task.server) & (TASK.c.state == "running")
                taken = update(TASK).where(whose).values(server=server, beat=now, changed=now)
                with self._begun() as connection:
                    if connection.execute(taken).rowcount:
                        adopted.append(task)
        return adopted

    def beat(self, server: str) -> None:
        """Say that a server looks after its tasks."""
        with self._begun() as connection:
            mine = (TASK.c.server == server) & (TASK.c.state == "running")
            connection.execute(update(TASK).where(mine).values(beat=time.time()))

    def end(self, task: QueuedTask, state: TaskState, *, code: int | None = None, told: str = "") -> bool:
        """Note how an attempt ended. Says whether this server still looked after it."""
        return self._own(task, state=state, code=code, told=told, ended=time.time(), stop=False)

    def put_aside(self, task: QueuedTask) -> bool:
        """Note that a task which was to pause has stopped. Says whether it still was to, and this server's."""
        pausing = TASK.c.told == PAUSING  # nobody cancelled it meanwhile
        return self._own(task, pausing, state="paused", begun=None, stop=False, told="")

    def lose(self, task: QueuedTask) -> bool:
        """Let a task whose process was killed wait again at its place, or end it where that happened too often."""
        if task.losses >= MOST_LOSSES:
            told = f"its process was killed {task.losses + 1} times"
            return self.end(task, "lost", told=told)
        return self._own(task, state="waiting", losses=task.losses + 1, begun=None)

    def _own(self, task: QueuedTask, also: Any = True, **values: Any) -> bool:
        mine = (TASK.c.server == task.server) & (TASK.c.attempt == task.attempt) & also
        return self._change(task.id, ("running",), mine, **values)

    def _change(self, name: str, states: Sequence[str], also: Any = True, **values: Any) -> bool:
        """Change a task that is in one of these states. Says whether it was."""
        is_it = (TASK.c.id == name) & TASK.c.state.in_(states) & also
        with self._begun() as connection:
            done = connection.execute(update(TASK).where(is_it).values(changed=time.time(), **values))
            return bool(done.rowcount)

    def _tasks(self, found: Any) -> list[QueuedTask]:
        with self._begun() as connection:
            return [_task(row) for row in connection.execute(found).all()]

    @contextmanager
    def _begun(self) -> Iterator[Connection]:
        """A transaction."""
        with self._catalog.connected() as connection, connection.begin():
            yield connection


def _is_as(task: QueuedTask) -> ColumnElement[bool]:
    """Whether a task still waits at its place."""
    place = (TASK.c.priority == task.priority) & (TASK.c.place == task.place)
    return (TASK.c.id == task.id) & (TASK.c.state == "waiting") & place


def _task(row: Row[Any]) -> QueuedTask:
    told = {f.name: row._mapping[f.name] for f in fields(QueuedTask)}
    return QueuedTask(**{**told, "words": tuple(told["words"]), "again": tuple(told["again"])})
