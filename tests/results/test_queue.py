"""The queue, over SQLite and PostgreSQL: nothing is lost, nothing is taken twice."""

from __future__ import annotations

import random
import subprocess
import sys
import threading
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from resim.core.errors import InputError
from resim.results.catalog import Catalog
from resim.results.queue import MOST_LOSSES, SILENT, QueuedTask, TaskQueue, new_id


def put(queue: TaskQueue, *words: str) -> QueuedTask:
    name = new_id()
    return queue.add(name, "check", words or ("check", "x"), f"/tasks/{name}", ("--resume",))


def test_a_task_goes_from_waiting_to_its_end(database: str) -> None:
    queue = TaskQueue(Catalog(database), "here")
    assert queue.claim("me") is None
    one = put(queue, "check", "ä b")
    assert (one.state, one.words, one.call, one.attempt) == ("waiting", ("check", "ä b"), ("check", "ä b"), 0)
    running = queue.claim("me")
    assert running is not None
    assert (running.id, running.state, running.attempt, running.server) == (one.id, "running", 1, "me")
    assert queue.of_server("me") == [running]
    assert queue.end(running, "bad", code=1, told="why")
    assert not queue.end(running, "done", code=0)
    assert queue.counts() == {"bad": 1}
    (ended,) = queue.ended(0, 9, bad=True)
    assert (ended.state, ended.code, ended.told) == ("bad", 1, "why")
    before = queue.version()
    assert queue.retry(one.id)
    assert queue.version() != before
    again = queue.claim("me")
    assert again is not None
    assert again.call == ("check", "ä b", "--resume")
    other = put(queue, "check", "--seed=1", "--", "ä b", "--")
    assert replace(other, attempt=2).call == ("check", "--seed=1", "--resume", "--", "ä b", "--")
    with pytest.raises(InputError, match="is no task"):
        queue.get("nothing")


def test_tasks_come_by_priority_and_place(database: str) -> None:
    queue = TaskQueue(Catalog(database), "here")
    a, b, c, d = (put(queue).id for _ in range(4))
    assert queue.prioritise(c, 5)
    assert queue.move(d, -1)
    assert [t.id for t in queue.unfinished()] == [c, a, d, b]
    assert queue.move(a, -1)  # over the border of priorities
    assert [t.id for t in queue.unfinished()] == [a, c, d, b]
    assert not queue.move(a, -1)
    assert not queue.move(b, 1)
    assert queue.cancel(c)
    claimed = [queue.claim("me") for _ in range(4)]
    assert [t.id for t in claimed if t] == [a, d, b]
    assert queue.cancel(a)
    assert queue.get(a).stop
    assert not queue.prioritise(a, 9)
    assert not queue.retry(a)


def test_tasks_that_many_move_at_once_keep_places_of_their_own(database: str) -> None:
    queue = TaskQueue(Catalog(database), "here")
    ids = [put(queue).id for _ in range(6)]

    def move(seed: int) -> None:
        draw = random.Random(seed)
        for _ in range(40):
            queue.move(draw.choice(ids), draw.choice((-1, 1)))

    threads = [threading.Thread(target=move, args=(seed,)) for seed in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len({(t.priority, t.place) for t in queue.unfinished()}) == len(ids)


def test_a_paused_task_waits_until_it_is_resumed(database: str) -> None:
    queue = TaskQueue(Catalog(database), "here")
    one, other = put(queue), put(queue)
    assert queue.pause(one.id)
    assert not queue.pause(one.id)
    running = queue.claim("me")
    assert running is not None
    assert running.id == other.id  # nobody takes the paused one
    assert queue.claim("me") is None
    assert queue.pause(other.id)
    asked = queue.get(other.id)
    assert (asked.state, asked.is_pausing) == ("running", True)
    assert queue.put_aside(running)
    aside = queue.get(other.id)
    assert (aside.state, aside.stop, aside.told, aside.begun) == ("paused", False, "", None)
    assert not queue.resume("nothing")
    assert queue.resume(other.id)
    again = queue.claim("me")
    assert again is not None
    assert again.call == (*other.words, "--resume")  # what was finished is kept
    assert queue.pause(other.id)
    assert queue.cancel(other.id)  # it is to end, not to pause
    assert not queue.get(other.id).is_pausing
    assert queue.cancel(one.id)
    assert queue.get(one.id).state == "cancelled"
    assert not queue.resume(one.id)


def test_tasks_of_another_machine_are_left_alone(database: str) -> None:
    here, there = TaskQueue(Catalog(database), "here"), TaskQueue(Catalog(database), "there")
    put(there)
    assert here.claim("me") is None
    assert there.claim("you") is not None
    assert here.adopt("me", lambda server: True) == []


def test_what_a_server_leaves_behind_is_taken_over_by_one_other(
    database: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    queue = TaskQueue(Catalog(database), "here")
    put(queue)
    task = queue.claim("old")
    assert task is not None
    assert queue.adopt("new", lambda server: False) == []
    assert [t.id for t in queue.adopt("new", lambda server: server == "old")] == [task.id]
    assert queue.adopt("newer", lambda server: server == "old") == []
    assert not queue.end(task, "done", code=0)  # it is not the old one's any more
    moment = queue.get(task.id).beat + SILENT + 1.0
    monkeypatch.setattr("resim.results.queue.time.time", lambda: moment)
    assert len(queue.adopt("newest", lambda server: False)) == 1  # one that says nothing any more


def test_a_task_whose_process_is_killed_begins_again_but_not_for_ever(database: str) -> None:
    queue = TaskQueue(Catalog(database), "here")
    name = put(queue).id
    for losses in range(MOST_LOSSES + 1):
        task = queue.claim("me")
        assert task is not None
        assert (task.losses, task.attempt) == (losses, losses + 1)
        assert queue.lose(task)
    assert queue.claim("me") is None
    assert (queue.get(name).state, queue.get(name).told) == ("lost", "its process was killed 3 times")


MANY = """
import sys
from resim.results.catalog import Catalog
from resim.results.queue import TaskQueue
queue = TaskQueue(Catalog(sys.argv[1]), "here")
while (task := queue.claim(sys.argv[2])) is not None:
    print(task.id, flush=True)
    assert queue.end(task, "done", code=0)
"""


def test_servers_that_claim_at_once_take_no_task_twice(database: str) -> None:
    queue = TaskQueue(Catalog(database), "here")
    names = {put(queue).id for _ in range(40)}
    command = [sys.executable, "-c", MANY, database]
    servers = [subprocess.Popen([*command, f"s{k}"], stdout=subprocess.PIPE, text=True) for k in range(4)]
    taken = Counter(line for s in servers for line in s.communicate(timeout=120)[0].split())
    assert set(taken) == names
    assert set(taken.values()) == {1}
    assert queue.counts() == {"done": 40}


def test_the_catalog_is_as_before_beside_the_queue(database: str, tmp_path: Path) -> None:
    catalog = Catalog(database)
    put(TaskQueue(catalog, "here"))
    assert Catalog(database).find() == []
