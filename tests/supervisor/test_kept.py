"""Lists and forms are made once for many, anew after every change, and never with what is somebody else's."""

from __future__ import annotations

import re
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from resim.results.entry import CatalogEntry
from resim.results.queue import new_id
from resim.supervisor import kept
from resim.supervisor.kept import KeptPages
from resim.supervisor.views import KEPT, results


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What pages of results were made of."""
    asked: list[str] = []
    find = results.find_page
    monkeypatch.setattr(
        results, "find_page", lambda *a, **k: (asked.append(str(a[1].text)), find(*a, **k))[1]
    )
    return asked


def test_a_list_is_made_once_for_many_and_anew_after_every_change(
    supervisor: Any, user: Any, made: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kept, "FRESH", 1e9)
    first = user.get("/results").text
    assert user.get("/results").text == first
    assert made == [""]
    user.get("/results?text=a")
    assert made == ["", "a"]
    told = ("2026-11-01T05:00:00.000+00:00", "0" * 64, "0.1.0", "FAIL")
    supervisor.catalog.add(CatalogEntry("run", "cut_in_brake", Path("/r"), "cluster", *told))
    assert "cut_in_brake" in user.get("/results").text
    supervisor.queue.add(name := new_id(), "check", ("check", "--", "/x/drive"), f"/tasks/{name}")
    assert name[:6] in user.get("/tasks").text
    supervisor.queue.cancel(name)
    assert "cancelled" in user.get("/tasks").text
    supervisor.worker.fault = "the disk is full"
    assert "the disk is full" in user.get("/tasks").text


def test_what_somebody_does_is_seen_at_once_and_what_others_do_a_moment_later(
    supervisor: Any, user: Any, seal: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("resim.supervisor.parts.NOTICED", 1e9)
    supervisor.queue.add(name := new_id(), "check", ("check",), f"/tasks/{name}")
    supervisor.look_again()
    assert name[:6] in user.get("/tasks").text
    supervisor.queue.pause(name)
    assert "<h2>Paused" not in user.get("/tasks").text
    headers = {"origin": "http://127.0.0.1:8765"}
    assert user.post(f"/tasks/{name}/cancel", data={"seal": seal}, headers=headers).status_code == 303
    assert "cancelled" in user.get("/tasks").text
    supervisor.queue.retry(name)
    monkeypatch.setattr("resim.supervisor.parts.NOTICED", 0.0)
    assert "Nothing waits" not in user.get("/tasks").text


def test_a_list_is_made_anew_after_a_moment(
    user: Any, made: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kept, "FRESH", 0.0)
    assert user.get("/results").text == user.get("/results").text
    assert made == ["", ""]


def test_nobody_gets_what_is_of_another_session(
    supervisor: Any, client: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kept, "FRESH", 1e9)
    name = new_id()
    supervisor.queue.add(name, "check", ("check",), f"/tasks/{name}")
    seals = []
    for role in ("administer", "administer", "look"):
        client.cookies.clear()
        client.get("/", params={"token": supervisor.access.tokens[role]})
        page = client.get("/tasks").text + client.get("/jobs/check").text
        assert supervisor.kept.mark not in page
        seals.append({*re.findall(r'name="seal" value="([^"]*)"', page)} - {""})
        assert ("Who did what" in page) is (role == "administer")
        own = supervisor.access.form_seal(client.cookies["resim_8765"])
        assert seals[-1] == ({own} if role == "administer" else set())
    assert seals[0] != seals[1]


def test_pages_of_one_thing_and_what_only_some_see_are_not_kept() -> None:
    assert not {path for path in KEPT if "{" in path} - {"/jobs/{name}"}
    assert "/trail" not in KEPT


def test_few_pages_and_no_large_ones_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept, "FRESH", 1e9)
    pages, made = KeptPages(), []

    def make(key: int, text: str) -> str:
        return pages.page(key, lambda: (made.append(key), text)[1])

    for key in range(kept.MOST_KEPT + 1):
        make(key, "x")
    make(kept.MOST_KEPT, "x")
    assert len(made) == kept.MOST_KEPT + 1
    make(0, "x")
    assert made[-1] == 0
    for _ in range(2):
        make(-1, "x" * (kept.LARGEST + 1))
    assert made[-2:] == [-1, -1]


@pytest.mark.parametrize("fresh", [1e9, 0.0])
def test_who_asks_while_a_page_is_made_waits_for_it(monkeypatch: pytest.MonkeyPatch, fresh: float) -> None:
    monkeypatch.setattr(kept, "FRESH", fresh)  # 0: a page that takes longer to make than it is fresh
    pages, made, asked = KeptPages(), list[int](), threading.Barrier(8)

    def make() -> str:
        time.sleep(0.5)  # in which all others ask
        made.append(1)
        return "x"

    def ask(_: int) -> str:
        asked.wait()
        return pages.page("a", make)

    with ThreadPoolExecutor(8) as pool:
        assert [*pool.map(ask, range(8))] == ["x"] * 8
    assert len(made) == 1
    assert pages.page("b", lambda: "y") == "y"
    with pytest.raises(ValueError, match="no"):
        pages.page("c", lambda: str(int("no")))
    assert pages.page("c", lambda: "z") == "z"  # nobody is held up by it


def test_the_look_of_pages_is_kept_by_browsers_until_it_changes(user: Any) -> None:
    addresses = re.findall(r'"(/static/[^"]+)"', user.get("/").text)
    assert len(addresses) == 3
    for address in addresses:
        assert "immutable" in user.get(address).headers["cache-control"]
    assert user.get("/static/page.css").headers["cache-control"] == "no-store"
    assert user.get("/static/page.css?v=0").headers["cache-control"] == "no-store"
