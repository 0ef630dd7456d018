"""Users with tokens of their own: roles, who may see what was done by whom, and how they are let out again."""

from __future__ import annotations

import json
import stat
import threading
from pathlib import Path
from typing import Any

import pytest
from conftest import Call

pytest.importorskip("starlette", reason="the extra serve is not installed")

from resim.core.errors import InputError
from resim.results.queue import new_id
from resim.supervisor.server import ServeOptions, serve
from resim.supervisor.users import NAME, Users

ORIGIN = "http://127.0.0.1:8765"


@pytest.fixture
def users(tmp_path: Path) -> Users:
    return Users(tmp_path / "users.json")  # those of the Supervisor of `conftest`


def entered(client: Any, token: str) -> Any:
    client.cookies.clear()
    assert client.get("/", params={"token": token}).status_code == 200
    return client


def test_a_role_says_what_is_seen_and_done(supervisor: Any, client: Any, users: Users) -> None:
    name = new_id()
    supervisor.queue.add(name, "check", ("check",), f"/tasks/{name}")
    done = {}
    for role in ("look", "run", "administer"):
        entered(client, users.add(f"who-{role}", role))  # type: ignore[arg-type]
        assert f"who-{role}," in client.get("/").text
        data = {"seal": supervisor.access.form_seal(client.cookies["resim_8765"])}
        asked = client.post(f"/tasks/{name}/first", data=data, headers={"origin": ORIGIN}).status_code
        done[role] = asked, client.get("/trail").status_code, "/trail" in client.get("/").text
    assert done == {"look": (403, 404, False), "run": (303, 404, False), "administer": (303, 200, True)}
    told = client.get("/trail").text
    assert told.index("who-administer") < told.index("who-run")
    assert "who-look</th>" not in told
    assert f"/tasks/{name}/first" in told


def test_who_is_removed_or_has_a_new_role_or_token_is_seen_at_once(client: Any, users: Users) -> None:
    token = users.add("anna", "run")
    entered(client, token)
    told = json.loads(users.path.read_text("utf-8"))
    told["anna"]["role"] = "look"
    users.path.write_text(json.dumps(told), "utf-8")
    assert "looks only" in client.get("/").text
    users.remove("anna")
    assert client.get("/").status_code == 401
    assert client.get("/", params={"token": token}).status_code == 401
    users.add("anna", "administer")
    assert client.get("/").status_code == 401  # of her old token


def test_tokens_are_kept_nowhere_and_the_file_is_of_one_alone(users: Users) -> None:
    token = users.add("anna", "run")
    assert token not in users.path.read_text("utf-8")
    assert stat.S_IMODE(users.path.stat().st_mode) == 0o600
    users.path.chmod(0o640)
    with pytest.raises(InputError, match="may be read by other users"):
        users.of_token(token)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{",
        '{"a": 1}',
        '{"a": {"role": "king", "mark": "x"}}',
        '{"a.b": {"role": "run", "mark": ""}}',
    ],
)
def test_a_file_that_is_none_lets_nobody_in(users: Users, text: str) -> None:
    users.path.write_text(text, "utf-8")
    users.path.chmod(0o600)
    with pytest.raises(InputError, match="is no file of users"):
        users.of_token("x")


@pytest.mark.parametrize("name", ["", "a.b", "a b", "é", "a" * 41, "../x", "a\n", "<b>"])
def test_names_have_nothing_that_means_anything_elsewhere(users: Users, name: str) -> None:
    assert not NAME.fullmatch(name)
    with pytest.raises(InputError, match="is no name of a user"):
        users.add(name, "run")
    assert users.all() == {}


def test_users_added_at_once_are_all_there(users: Users) -> None:
    every = [threading.Thread(target=Users(users.path).add, args=(f"u{k}", "look")) for k in range(20)]
    for one in every:
        one.start()
    for one in every:
        one.join()
    assert sorted(users.all()) == sorted(f"u{k}" for k in range(20))


def test_users_from_the_command_line(call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    code, out, _ = call("users", "list")
    assert (code, "nobody" in out) == (0, True)
    code, token, _ = call("users", "add", "anna", "--role", "run")
    assert code == 0
    assert Users(tmp_path / "resim" / "users.json").of_token(token.strip()) is not None
    code, _, err = call("users", "add", "anna")
    assert (code, "known already" in err) == (2, True)
    assert call("users", "list")[1] == "anna: run\n"
    assert call("users", "rm", "anna")[0] == 0
    code, _, err = call("users", "rm", "anna")
    assert (code, "nobody" in err) == (2, True)


def test_others_come_in_as_users_only(supervisor: Any, tmp_path: Path) -> None:
    options = ServeOptions((), "127.0.0.1", 0, tmp_path / "t", remote="https://resim.example.org")
    with pytest.raises(InputError, match="there are no users"):
        serve(options, supervisor.catalog, (), tmp_path, lambda addresses, page: None)
