"""`resim serve`, before anything is served: what is missing, what would let others in unseen."""

from __future__ import annotations

import importlib.util
import re
import socket
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from supervised import entered, waited

from resim.cli.demo import write_example
from resim.core.errors import InputError
from resim.results.catalog import Catalog
from resim.results.lake import LakeQuery, find_page
from resim.results.scanning import register
from resim.supervisor.server import ServeOptions, check_options

Call = Callable[..., tuple[int, str, str]]


def options(**told: Any) -> ServeOptions:
    return ServeOptions(**({"folders": (), "host": "127.0.0.1", "port": 0, "tasks": Path("t")} | told))


def test_the_missing_extra_is_named(call: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    real = importlib.util.find_spec
    monkeypatch.setattr(
        "importlib.util.find_spec", lambda name, *a: None if name == "uvicorn" else real(name, *a)
    )
    code, _, error = call("serve")
    assert code == 2
    assert error == "resim: resim serve: needs uvicorn. In resim's own folder: pip install '.[serve]'\n"


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.5", "example.org", ""])
def test_other_machines_are_let_in_only_where_that_is_said(call: Call, host: str) -> None:
    code, _, error = call("serve", "--no-open", "--host", host)
    assert code == 2
    assert "can be reached from other machines" in error
    check_options(options(host=host, remote="https://resim.example.org"))


@pytest.mark.parametrize(
    "remote",
    ["http://resim.example.org", "resim.example.org", "https://", "https://a@b.c", "https://a.b/path"],
)
def test_the_address_of_others_must_be_encrypted(remote: str) -> None:
    with pytest.raises(InputError, match="is not the https:// address"):
        check_options(options(remote=remote))


def test_what_cannot_be_used_is_told_in_a_line(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert "is no folder" in call("serve", "--no-open", tmp_path / "nothing")[2]
    (tmp_path / "no.pem").write_text("no certificate")
    assert "cannot be used" in call("serve", "--no-open", "--certificate", tmp_path / "no.pem")[2]
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert (
            "cannot be listened on (Address already in use)" in call("serve", "--no-open", "--port", port)[2]
        )
    monkeypatch.setenv("RESIM_CATALOG", "none")
    assert "switches the catalog off" in call("serve", "--no-open")[2]


def test_a_server_that_is_asked_to_end_does_so_at_once_and_quietly(served: Callable[..., Any]) -> None:
    server, address, token = served()
    with entered(address, token) as client, client.stream("GET", "/events") as answer:
        lines = answer.iter_lines()
        assert next(lines) == "retry: 2000"
        server.terminate()
        assert not any(lines)  # it ends as it should, not torn off
    assert server.wait(20) == 143


def test_the_token_is_the_users_alone(served: Callable[..., Any], tmp_path: Path) -> None:
    _, address, token = served()
    page = tmp_path / "data" / "resim" / "open.html"
    assert stat.S_IMODE(page.stat().st_mode) == 0o600
    assert f"{address}/?token={token}" in page.read_text()
    with entered(address, token) as client:
        headers = {name.lower() for name in client.get("/").headers}
        assert "server" not in headers
        assert client.get("/", headers={"host": "localhost"}).status_code == 421


def test_all_drives_that_ship_are_in_the_lake_of_the_demo(catalog: str, tmp_path: Path) -> None:
    write_example(tmp_path / "example")
    found = register(Catalog(catalog), [tmp_path / "example"])
    drives = find_page(Catalog(catalog), LakeQuery(kinds=("recording",)), sort="name").items
    assert [(d.name, d.fault) for d in drives] == [("cut_in_brake", ""), ("overtake", ""), ("rear_end", "")]
    assert found.new == 19


@pytest.mark.slow
def test_the_demo_fills_a_lake_within_a_minute(served: Callable[..., Any]) -> None:
    _, address, token = served("--demo")
    with entered(address, token) as client:
        waited(
            lambda: client.get("/lake?kind=recording").text.count("/experiments/") >= 3, 20.0
        )  # there at once
        assert re.search(r"This lake fills while you look.* \d of 4 tasks are done", client.get("/").text)
        waited(lambda: client.get("/lake?kind=verification").text.count('href="/results/') == 1, 60.0)
        waited(
            lambda: client.get("/lake?kind=recording&maneuver=lane_change").text.count("/experiments/") > 0,
            60.0,
        )
        assert "re-simulated" in client.get("/experiments?state=bad").text


def test_no_answer_waits_for_an_acknowledgement() -> None:
    from resim.supervisor.server import _bound

    with _bound("127.0.0.1", 0) as listening, socket.create_connection(listening.getsockname()):
        accepted, _ = listening.accept()
        with accepted:
            assert accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
