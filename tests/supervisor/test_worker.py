"""Tasks are done, once each: when servers are killed, when two serve one catalog, when processes are killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest
from supervised import entered, waited

from resim.results.catalog import Catalog
from resim.results.queue import QueuedTask, TaskQueue, new_id
from resim.supervisor import runner
from resim.supervisor.processes import is_alive, number_of, process_name, read_whole, write_whole
from resim.supervisor.worker import Worker

ROOT = Path(__file__).parents[2]
DRIVE = str(ROOT / "scenarios" / "cut_in_brake")
LISTENS = "listens on"
"""What it says once it has begun."""

pytest.importorskip("grpc", reason="the extra grpc is not installed")


@pytest.fixture
def put(catalog: str, tmp_path: Path) -> Callable[..., QueuedTask]:
    queue = TaskQueue(Catalog(catalog))

    def add(*words: str) -> QueuedTask:
        name = new_id()
        return queue.add(name, words[0], words, str(tmp_path / "tasks" / name))

    return add


@pytest.fixture
def queue(catalog: str) -> TaskQueue:
    return TaskQueue(Catalog(catalog))


@pytest.fixture
def long(tmp_path: Path) -> list[str]:
    """A call that goes on until somebody ends it."""
    build = tmp_path / "outside.toml"
    build.write_text('name = "outside"\nversion = "1"\n[process]\ncommand = ["cat"]\n')
    return ["function", "serve", str(build), "--address", "127.0.0.1:0"]


def begun(task: QueuedTask) -> dict[str, Any]:
    return read_whole(Path(task.folder) / runner.BEGUN)


def said(task: QueuedTask, words: str) -> bool:
    log = Path(task.folder) / runner.LOG
    return log.is_file() and words in log.read_text(errors="replace")


def test_tasks_are_done_with_their_log_and_exit_code(
    queue: TaskQueue, put: Callable[..., QueuedTask]
) -> None:
    good, wrong = put("check", "--", DRIVE), put("check", "--", "/nothing here")
    worker = Worker(queue, 2)
    waited(lambda: (worker.look(), not queue.unfinished())[1])
    done, failed = queue.get(good.id), queue.get(wrong.id)
    assert (done.state, done.code) == ("done", 0)
    assert said(done, "SPEED_DISAGREES")
    assert (failed.state, failed.code) == ("failed", 2)
    assert failed.told.startswith("resim: /nothing here")


def test_a_running_task_is_cancelled(
    queue: TaskQueue, put: Callable[..., QueuedTask], long: list[str]
) -> None:
    task, worker = put(*long), Worker(queue, 1)
    waited(lambda: (worker.look(), said(task, LISTENS))[1])
    process = begun(task)["process"]
    assert is_alive(process)
    assert queue.cancel(task.id)
    waited(lambda: (worker.look(), not queue.unfinished())[1])
    assert queue.get(task.id).state == "cancelled"
    assert not is_alive(process)


def test_a_running_task_is_paused_and_goes_on(
    queue: TaskQueue, put: Callable[..., QueuedTask], long: list[str]
) -> None:
    task, worker = put(*long), Worker(queue, 1)
    waited(lambda: (worker.look(), said(task, LISTENS))[1])
    process = begun(task)["process"]
    assert queue.pause(task.id)
    waited(lambda: (worker.look(), queue.get(task.id).state == "paused")[1])
    assert not is_alive(process)
    worker.look()
    assert queue.get(task.id).attempt == 1  # nobody begins it by himself
    assert queue.resume(task.id)
    waited(lambda: (worker.look(), begun(task).get("attempt") == 2)[1])
    assert queue.get(task.id).losses == 0
    queue.cancel(task.id)
    waited(lambda: (worker.look(), not queue.unfinished())[1])
    assert queue.get(task.id).state == "cancelled"


def test_a_task_whose_process_is_killed_begins_again(
    queue: TaskQueue, put: Callable[..., QueuedTask], long: list[str]
) -> None:
    task, worker = put(*long), Worker(queue, 1)
    waited(lambda: (worker.look(), said(task, LISTENS))[1])
    first = begun(task)
    command = psutil.Process(number_of(first["process"])).children(recursive=True)
    os.kill(number_of(first["process"]), signal.SIGKILL)
    waited(lambda: (worker.look(), begun(task).get("attempt") == 2)[1])
    assert not is_alive(first["process"])
    assert command  # nothing of the first attempt works on beside the second one
    assert not any(p.is_running() and p.status() != psutil.STATUS_ZOMBIE for p in command)
    assert (queue.get(task.id).losses, queue.get(task.id).attempt) == (1, 2)
    queue.cancel(task.id)
    waited(lambda: (worker.look(), not queue.unfinished())[1])


def test_an_attempt_is_made_once_by_all_that_are_started_for_it(tmp_path: Path) -> None:
    folder = tmp_path / "task"
    folder.mkdir()
    command = [sys.executable, "-m", "resim.supervisor.runner", str(folder)]
    write_whole(folder / runner.TASK_FILE, {"attempt": 2, "words": ["--version"], "job": "x"})
    several = [subprocess.Popen(command) for _ in range(3)]
    assert sorted(one.wait(60) for one in several) == [0, 75, 75]
    assert read_whole(folder / runner.EXIT)["code"] == 0
    write_whole(folder / runner.TASK_FILE, {"attempt": 1, "words": ["--version"], "job": "x"})
    assert subprocess.run(command, check=False).returncode == 75  # an earlier one comes too late
    assert (folder / runner.LOG).read_text().count("$ resim --version") == 1


def test_a_process_is_told_from_a_later_one_of_its_number() -> None:
    mine = process_name()
    assert is_alive(mine)
    number, _, began = mine.partition("@")
    assert not is_alive(f"{number}@{float(began) - 5.0}")
    assert not any(map(is_alive, ("", "x", "1@", "999999999@1.0", "-1@0")))


def test_a_server_that_is_killed_leaves_its_task_and_the_next_one_finds_it(
    served: Callable[..., Any], queue: TaskQueue, put: Callable[..., QueuedTask], long: list[str]
) -> None:
    task, later = put(*long), put("check", "--", DRIVE)
    server, address, token = served()
    waited(lambda: said(task, LISTENS))
    process = begun(task)["process"]
    with entered(address, token) as client:
        assert "running" in client.get(f"/tasks/{task.id}").text
        cookies = dict(client.cookies)
    server.kill()
    server.wait()
    assert is_alive(process)
    assert queue.get(task.id).state == "running"
    _, address, token = served()
    waited(lambda: is_alive(queue.get(task.id).server) and queue.get(task.id).server)
    assert (queue.get(task.id).attempt, begun(task)["process"]) == (1, process)
    with entered(address, token) as client:
        client.cookies.update(cookies)
        page = client.get(f"/tasks/{task.id}").text
        assert "running" in page
        seal = page.partition('name="seal" value="')[2].partition('"')[0]
        client.post(f"/tasks/{task.id}/cancel", data={"seal": seal}, headers={"origin": address})
    waited(lambda: not queue.unfinished(), 60.0)
    assert queue.get(task.id).state == "cancelled"
    assert not is_alive(process)
    assert queue.get(later.id).state == "done"


@pytest.mark.slow
def test_two_servers_at_once_do_each_task_once(
    served: Callable[..., Any], queue: TaskQueue, put: Callable[..., QueuedTask]
) -> None:
    servers = [served("--jobs", 2)[0] for _ in range(2)]
    tasks = [put("--version") for _ in range(8)]
    waited(lambda: not queue.unfinished(), 60.0)
    for task in tasks:
        ended = queue.get(task.id)
        assert (ended.state, ended.attempt, ended.losses) == ("done", 1, 0)
        assert (Path(task.folder) / runner.LOG).read_text().count("$ resim") == 1
    assert all(server.poll() is None for server in servers)


def test_the_log_comes_as_it_is_written(served: Callable[..., Any], put: Callable[..., QueuedTask]) -> None:
    task = put("check", "--", DRIVE)
    _, address, token = served()
    with entered(address, token) as client:
        assert client.get("/events?task=nothing").status_code == 404
        found = ""
        with client.stream("GET", f"/events?task={task.id}") as answer:
            assert answer.headers["content-type"].startswith("text/event-stream")
            for line in answer.iter_lines():
                found += line + "\n"
                if "SPEED_DISAGREES" in found and "event: changed" in found:
                    break
        assert "id: " in found
        last = max(int(line.removeprefix("id: ")) for line in found.splitlines() if line.startswith("id: "))
        waited(lambda: "done" in client.get(f"/tasks/{task.id}").text)
        with client.stream(
            "GET", "/events", params={"task": task.id}, headers={"last-event-id": str(last)}
        ) as again:
            first = next(line for line in again.iter_lines() if line.startswith(("event:", "retry:")))
            assert first == "retry: 2000"  # what was sent is not sent again


def test_too_many_streams_are_refused(served: Callable[..., Any]) -> None:
    from contextlib import ExitStack

    _, address, token = served()
    with entered(address, token) as client, ExitStack() as opened:
        for _ in range(24):
            answer = opened.enter_context(client.stream("GET", "/events"))
            assert answer.status_code == 200
        assert client.get("/events").status_code == 429
        with entered(address, token) as again:  # another session makes nobody another client
            assert again.get("/events").status_code == 429
        opened.close()

        def is_open() -> bool:
            with client.stream("GET", "/events") as answer:
                return answer.status_code == 200

        waited(is_open)  # those that were closed count no more
