"""Attacks: users who were removed, hostile files in folders of tasks, connections that only hold a place."""

from __future__ import annotations

import asyncio
import json
import os
import socket
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from supervised import waited

pytest.importorskip("starlette", reason="the extra serve is not installed")

from resim.core.errors import InputError
from resim.jobs import tasks
from resim.results.queue import TaskQueue, new_id
from resim.supervisor import events, server
from resim.supervisor.live import read_state, roads_around
from resim.supervisor.users import Users
from resim.supervisor.worker import Worker

ORIGIN = "http://127.0.0.1:8765"
MAP = Path(__file__).parents[2] / "networks" / "motorway.xodr"


def put(queue: TaskQueue, folder: Path) -> str:
    name = new_id()
    (folder / name).mkdir(parents=True)
    queue.add(name, "run", ("--version",), str(folder / name))
    return name


def state(x: str, file: str = str(MAP)) -> str:
    return f'{{"map": {json.dumps(file)}, "boxes": [["e", "car", {x}, 0, 0, 0, 4, 2]]}}'


def streamed(supervisor: Any, folder: Path, seconds: float = 0.3, **more: Any) -> tuple[list[bytes], bool]:
    """What a stream gives in a while, and whether it ended by itself."""
    found: list[bytes] = []

    async def read() -> None:
        given = events.stream(supervisor, folder / "log.txt", 0, folder, **more)
        async for event in given:
            found.append(event)  # noqa: PERF401 - what came until it is cut off

    async def bounded() -> bool:
        try:
            await asyncio.wait_for(read(), seconds)
        except TimeoutError:
            return False
        return True

    return found, asyncio.run(bounded())


def test_streams_and_pages_of_a_removed_user_end(
    supervisor: Any, client: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    users = Users(tmp_path / "users.json")
    assert client.get("/", params={"token": users.add("anna", "run")}).status_code == 200
    name = put(supervisor.queue, tmp_path / "tasks")
    (tmp_path / "tasks" / name / "log.txt").write_text("secret")
    page = client.get(f"/open/tasks/{name}/log.txt").headers["location"]
    asked: list[Any] = []

    async def noted(*given: Any) -> Any:
        asked.extend(given)
        yield b""

    monkeypatch.setattr("resim.supervisor.app.stream", noted)
    assert client.get(f"/events?task={name}").status_code == 200
    is_in = asked[-1]
    assert is_in()
    assert "secret" in client.get(page).text
    users.remove("anna")
    assert not is_in()
    assert client.get(page).status_code == 403
    users.add("anna", "run")
    assert client.get(page).status_code == 403  # of her old token
    monkeypatch.setattr(events, "EVERY", 0.0)
    assert streamed(supervisor, tmp_path, 5.0, is_in=is_in)[1]


def test_a_file_of_users_that_is_none_is_told_of_and_the_printed_address_lets_in(
    supervisor: Any, client: Any, tmp_path: Path
) -> None:
    users = Users(tmp_path / "users.json")
    client.get("/", params={"token": users.add("anna", "run")})
    for text in ("{", "[" * 100_000):
        users.path.write_text(text)
        answer = client.get("/")
        assert answer.status_code == 500
        assert "is no file of users" in answer.text
    users.path.unlink()
    os.mkfifo(users.path, 0o600)
    assert client.get("/").status_code == 500
    client.cookies.clear()
    assert client.get("/", params={"token": supervisor.access.tokens["administer"]}).status_code == 200


def test_users_behind_a_link_are_changed_there(tmp_path: Path) -> None:
    users, real = Users(tmp_path / "users.json"), tmp_path / "there" / "users.json"
    users.add("anna", "run")
    real.parent.mkdir()
    users.path.rename(real)
    users.path.symlink_to(real)
    users.remove("anna")
    assert (Users(real).all(), users.path.is_symlink()) == ({}, True)


@pytest.mark.parametrize("x", ["NaN", "Infinity", "1e999", "1" + "0" * 400])
def test_a_state_that_is_nowhere_has_no_roads(supervisor: Any, tmp_path: Path, x: str) -> None:
    (tmp_path / "live.json").write_text(state(x))
    assert roads_around(tmp_path)["lanes"] == []
    told = b"".join(streamed(supervisor, tmp_path)[0])
    assert b"NaN" not in told
    assert b"Infinity" not in told


@pytest.mark.parametrize("name", ["live.json", "log.txt"])
def test_a_pipe_in_the_place_of_a_file_holds_up_nothing(supervisor: Any, tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / name)
    assert streamed(supervisor, tmp_path)[0][0].startswith(b"retry")
    assert read_state(tmp_path) == (None, 0)


@pytest.mark.parametrize(
    "text",
    ['{"attempt": 1, "code": "x"}', '{"attempt": 1}', f'{{"attempt": 1, "code": {10**30}}}', "[" * 100_000, None],
)  # fmt: skip
@pytest.mark.parametrize("file", ["exit.json", "begun.json"])
def test_files_of_a_task_that_were_altered_stop_no_worker(
    supervisor: Any, tmp_path: Path, file: str, text: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    queue, name = supervisor.queue, put(supervisor.queue, tmp_path / "tasks")
    worker = Worker(queue, 0)
    monkeypatch.setattr(worker, "_begin", lambda task: None)
    task = queue.claim(worker.server)
    for each in (file, "log.txt"):
        if text is None:
            os.mkfifo(tmp_path / "tasks" / name / each)
    if text is not None:
        (tmp_path / "tasks" / name / file).write_text(text)
    worker._look_after(task)
    told = file == "exit.json" and text is not None and "attempt" in text
    assert (queue.get(name).state == "failed") == told
    if told:
        assert queue.get(name).told == "exit.json in its folder was altered"


def test_a_worker_goes_on_after_an_error_of_any_kind(
    supervisor: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    worker, looks = supervisor.worker, []

    def broken() -> None:
        looks.append(1)
        raise ZeroDivisionError("x")

    monkeypatch.setattr(worker, "look", broken)
    worker.start()
    waited(lambda: worker.fault == "ZeroDivisionError: x")
    assert worker._thread.is_alive()
    worker.stop()


def test_paused_tasks_count_among_those_that_wait(
    supervisor: Any, user: Any, seal: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tasks, "MOST_WAITING", 2)
    names = [put(supervisor.queue, tmp_path / "tasks") for _ in range(3)]
    supervisor.queue.cancel(names[2])
    for name in names[:2]:
        assert supervisor.queue.pause(name)
    drive = next(file.id for file in supervisor.files("recording", most=9) if file.name == "cut_in_brake")
    for path, given in (("/jobs/check", {"recording": drive}), (f"/tasks/{names[2]}/retry", {})):
        answer = user.post(path, data={"seal": seal, **given}, headers={"origin": ORIGIN})
        assert answer.status_code == 422
        assert "2 tasks are waiting already" in answer.text


def test_who_cancels_while_a_task_stops_to_pause_is_heard(supervisor: Any, tmp_path: Path) -> None:
    queue, name = supervisor.queue, put(supervisor.queue, tmp_path / "tasks")
    queue.claim("me")
    queue.pause(name)
    seen = queue.get(name)  # by the worker, before it is cancelled
    assert queue.cancel(name)
    assert not queue.put_aside(seen)
    assert (queue.get(name).state, queue.get(name).stop) == ("running", True)


def test_a_connection_that_only_holds_a_place_loses_it(monkeypatch: pytest.MonkeyPatch) -> None:
    import uvicorn

    monkeypatch.setattr(server, "SLOWEST", 0.2)

    async def app(scope: Any, receive: Any, send: Any) -> None:
        await asyncio.sleep(0.6)
        await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", b"0")]})
        await send({"type": "http.response.body"})

    async def tried() -> list[bytes]:
        config = uvicorn.Config(app, http=server.Impatient, lifespan="off", log_level="critical")
        one = uvicorn.Server(config)
        with socket.create_server(("127.0.0.1", 0)) as listening:
            port = listening.getsockname()[1]
            serving = asyncio.ensure_future(one.serve(sockets=[listening]))
            await asyncio.sleep(0.1)
            found = []
            for sent in (b"", b"GET / HTTP/1.1\r\nHost: x\r\n", b"GET / HTTP/1.1\r\nHost: x\r\n\r\n"):
                reader, writer = await asyncio.open_connection("127.0.0.1", port)
                writer.write(sent)
                try:
                    found.append(await asyncio.wait_for(reader.read(12), 3.0))
                except ConnectionError:
                    found.append(b"")
                writer.close()
            one.should_exit = True
            await serving
            return found

    assert asyncio.run(tried()) == [b"", b"", b"HTTP/1.1 200"]  # what is answered slowly is let be


def test_a_space_that_says_nonsense_is_told_of_on_the_dashboard(
    supervisor: Any, user: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from resim.results.lake import LakeItem, LakePage

    one = LakeItem("i", "space", "n", "/f", "h", "2026-11-27T00:00:00Z", "d", "", {}, None, "")
    unseen = {"value": "x", "low": 0.0, "high": 1.0}
    told = {"scenarios": 1, "hours": 10**400, "coverage": {
        "kinds": {"seen": 1, "at_least": "y"}, "convergence": {"unseen": unseen, "converged": 1}}}  # fmt: skip
    monkeypatch.setattr("resim.supervisor.coverage.find_page", lambda *a, **k: LakePage((one,), 1, False))
    monkeypatch.setattr("resim.supervisor.coverage.read_sealed", lambda *a: told)
    assert "or holds something else" in user.get("/").text
    with pytest.raises(InputError):
        supervisor.file("i", ("space",))


@pytest.mark.parametrize(
    ("given", "proxy", "client"),
    [
        ({}, "", "10.0.0.1"),
        ({"x-forwarded-for": "192.0.2.7"}, "", "10.0.0.1"),  # nobody said that there is a proxy
        ({"x-forwarded-for": "192.0.2.7"}, "10.0.0.2", "10.0.0.1"),  # it is another one
        ({"x-forwarded-for": "192.0.2.7"}, "10.0.0.1", "192.0.2.7"),
        (
            {"x-forwarded-for": "1.2.3.4, 192.0.2.7"},
            "10.0.0.1",
            "192.0.2.7",
        ),  # the first is what the client said
        ({"x-forwarded-for": "192.0.2.7, nonsense"}, "10.0.0.1", "10.0.0.1"),
        ({"x-forwarded-for": ""}, "10.0.0.1", "10.0.0.1"),
        ({"x-forwarded-for": "2001:DB8::1"}, "10.0.0.1", "2001:db8::1"),
    ],
)
def test_clients_are_told_apart_behind_the_stated_proxy_alone(
    given: dict[str, str], proxy: str, client: str
) -> None:
    from starlette.datastructures import Headers

    from resim.supervisor.guard import client_of

    assert client_of({"client": ("10.0.0.1", 1)}, Headers(given), proxy) == client


def test_tries_of_one_behind_the_proxy_keep_no_other_out(supervisor: Any) -> None:
    from starlette.testclient import TestClient

    from resim.supervisor.app import make_app

    door = replace(supervisor.settings.door, proxy="10.0.0.1")
    supervisor.settings = replace(supervisor.settings, door=door)
    app = make_app(supervisor)
    client = TestClient(app, base_url=ORIGIN, client=("10.0.0.1", 1))

    def tried(token: str, of: str) -> int:
        return int(client.get("/", params={"token": token}, headers={"x-forwarded-for": of}).status_code)

    assert {tried("wrong", "192.0.2.7") for _ in range(30)} == {401, 429}
    assert tried(supervisor.access.tokens["administer"], "192.0.2.8") == 200
    assert tried("wrong", "192.0.2.8") == 401
    assert tried("wrong", f"192.0.2.8, {'192.0.2.7'}") == 429


def test_large_forms_push_nothing_out_of_the_trail(supervisor: Any, user: Any, seal: str) -> None:
    user.post("/jobs/check", data={"seal": seal, "first": "x"}, headers={"origin": ORIGIN})
    large = {"seal": seal, **{f"field{k}": "y" * 400 for k in range(150)}}
    for _ in range(60):
        user.post("/jobs/check", data=large, headers={"origin": ORIGIN})
    lines = supervisor.audit.path.read_bytes().splitlines()
    assert max(map(len, lines)) < 3_000
    seen = [dict(map(tuple, line["form"])) for line in supervisor.audit.last(1000)]
    assert len(seen) == 122
    assert seen[-1] == {"first": "x"}
    assert "…" in seen[0]
    assert supervisor.audit.last(2, first=120) == supervisor.audit.last(1000)[-2:]
    pages = [user.get(f"/trail?first={first}").text.count("<tr>") for first in (0, 50, 100, 150)]
    assert pages == [51, 51, 23, 0]


NUL = (
    "/lake?text=a%00b",
    "/experiments?text=%00",
    "/jobs/run?recording=%00",
    "/results/a%00",
    "/events?task=%00",
)


@pytest.mark.parametrize("path", NUL)
def test_a_nul_byte_in_an_address_is_refused(user: Any, path: str) -> None:
    assert user.get(path).status_code == 400


def test_a_nul_byte_in_a_form_is_refused(user: Any, seal: str) -> None:
    for name, value in (("recordings", "a\0b"), ("a\0b", "1")):
        answer = user.post("/jobs/check", data={"seal": seal, name: value}, headers={"origin": ORIGIN})
        assert answer.status_code == 400
        assert "NUL" in answer.text
