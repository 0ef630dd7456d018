"""Nobody is let in who should not be: tokens, hosts, origins, forms, paths, sizes, rates."""

from __future__ import annotations

import re
import stat
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from supervised import PAGES, at_home

from resim.core.errors import InputError
from resim.results.queue import new_id
from resim.supervisor.access import Access, Visitor, kept_key
from resim.supervisor.guard import Door
from resim.supervisor.limits import RateLimit, StreamLimit
from resim.supervisor.users import Users

ORIGIN = "http://127.0.0.1:8765"
SECRET = "Dashboard"
OWNER = Visitor("", "administer")


def raw(supervisor: Any) -> Any:
    """A browser that sees addresses as they are."""
    from starlette.testclient import TestClient

    from resim.supervisor.app import make_app

    return TestClient(make_app(supervisor), base_url=ORIGIN, follow_redirects=False)


def test_the_cookie_goes_to_an_address_that_nobody_else_knows_and_lets_in_there_alone(
    supervisor: Any, tmp_path: Path
) -> None:
    browser = raw(supervisor)
    cookie = browser.get("/", params={"token": supervisor.access.tokens["administer"]}).headers["set-cookie"]
    session, home = re.fullmatch(r"resim_8765=([^;]+);.* Path=(/[0-9a-f]{32})/;.*", cookie).groups()  # type: ignore[union-attr]
    assert supervisor.access.home(session) == home
    page = browser.get(f"{home}/tasks")
    assert page.status_code == 200
    for link in re.findall(r'(?:href|action|data-home)="(/[^"]*)"', page.text):
        assert link.startswith((f"{home}/", "/static/")), link
    name = new_id()
    supervisor.queue.add(name, "check", ("check",), f"/tasks/{name}")
    data, headers = {"seal": supervisor.access.form_seal(session)}, {"origin": ORIGIN}
    there = browser.post(f"{home}/tasks/{name}/first", data=data, headers=headers).headers["location"]
    assert there == f"{home}/tasks/{name}"
    assert f'href="{home}/"' in browser.get(f"{home}/nothing").text
    document = browser.get(f"{home}/open/results/{'0' * 16}/x.html")
    assert document.status_code == 404
    assert browser.get(f"{home}/pages/x/results/{'0' * 16}/x.html").status_code == 404
    thief = raw(supervisor)  # with the cookie, and without its address
    other = supervisor.access.home(supervisor.access.new_session(OWNER))
    for path in (
        "/",
        "/tasks",
        "/events",
        f"{other}/tasks",
        f"/{'0' * 32}/",
        f"{home}0/tasks",
        f"/x{home}/tasks",
    ):
        stolen = {"cookie": f"resim_8765={session}"}
        assert thief.get(path, headers=stolen).status_code == 401, path
        assert thief.post(path, data=data, headers=headers | stolen).status_code in (401, 403)
    elsewhere = Access(b"k" * 32, 8766, Users(tmp_path / "users.json"))  # of the same key, on another port
    assert elsewhere.session(session) is None
    by_tls = Access(b"k" * 32, 443, Users(tmp_path / "users.json"), secure=True)
    assert by_tls.cookie == "__Secure-resim_443"


def test_by_tls_the_cookie_goes_by_tls_alone_and_documents_stay_there(
    supervisor: Any, tmp_path: Path
) -> None:
    from starlette.testclient import TestClient

    from resim.supervisor.app import make_app

    users, there = Users(tmp_path / "users.json"), "https://resim.example.org"
    supervisor.access = Access(b"k" * 32, 443, users, users_only=True, secure=True)
    supervisor.settings = replace(supervisor.settings, door=Door((there,), secure=True))
    name = new_id()
    supervisor.queue.add(name, "check", ("check",), str(tmp_path / name))
    (tmp_path / name).mkdir()
    (tmp_path / name / "a+b c.html").write_text("read")
    # a proxy that does TLS asks by http, under the name of the browser's address
    browser = TestClient(make_app(supervisor), base_url="http://resim.example.org", follow_redirects=False)
    answer = browser.get("/", params={"token": users.add("anna", "run")})
    cookie = answer.headers["set-cookie"]
    session, home = re.fullmatch(
        r"__Secure-resim_443=([^;]+);.* Path=(/\w{32})/; SameSite=strict; Secure", cookie
    ).groups()  # type: ignore[union-attr]
    headers = {"cookie": f"__Secure-resim_443={session}"}
    opened = browser.get(f"{home}/open/tasks/{name}/a+b c.html", headers=headers)
    assert opened.status_code == 303
    assert opened.headers["location"].startswith("/pages/")  # under https as the page before
    assert opened.headers["referrer-policy"] == "no-referrer"
    assert browser.get(opened.headers["location"]).text == "read"


def test_what_other_sites_send_uses_up_nothing_of_a_visitor(
    supervisor: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("resim.supervisor.guard.RateLimit", lambda each, burst: RateLimit(0.001, 10.0))
    visitor = at_home(raw(supervisor), ORIGIN)
    assert visitor.get("/", params={"token": supervisor.access.tokens["administer"]}).status_code == 200
    foreign = {"sec-fetch-site": "same-site", "sec-fetch-mode": "no-cors", "sec-fetch-dest": "empty"}
    answers = [visitor.get("/events", headers=foreign).status_code for _ in range(20)]
    assert {*answers} == {403, 429}
    assert visitor.get("/tasks").status_code == 200
    cookies = {"cookie": "none"}  # another user's program on this machine
    assert {visitor.get("/tasks", headers=cookies).status_code for _ in range(20)} == {401, 429}
    assert visitor.get("/tasks").status_code == 200


@pytest.mark.parametrize(
    "more",
    [
        {"sec-fetch-dest": "iframe"}, {"sec-fetch-dest": "object"}, {"sec-fetch-dest": "embed"},
        {"sec-fetch-dest": "document", "sec-purpose": "prefetch;prerender"},
    ],
)  # fmt: skip
def test_frames_of_other_sites_try_no_tokens(client: Any, more: dict[str, str]) -> None:
    framed = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate", **more}
    assert [client.get("/?token=x", headers=framed).status_code for _ in range(14)] == [403] * 14
    assert client.get("/?token=x").status_code == 401  # not too many tries


def test_wrong_tokens_of_others_keep_the_right_one_out_of_nothing(supervisor: Any, client: Any) -> None:
    assert 429 in [client.get("/", params={"token": f"guess{k}"}).status_code for k in range(14)]
    assert client.get("/", params={"token": supervisor.access.tokens["administer"]}).status_code == 200


def test_the_token_lets_in_once_and_a_cookie_from_then_on(supervisor: Any, client: Any) -> None:
    assert client.get("/").status_code == 401
    answer = client.get("/", params={"token": supervisor.access.tokens["administer"]})
    assert answer.status_code == 200
    assert SECRET not in answer.text  # another page, whose address has no token
    cookie = answer.headers["set-cookie"]
    assert all(word in cookie for word in ("HttpOnly", "SameSite=strict", "Path=/"))
    assert supervisor.access.tokens["administer"] not in cookie
    page = client.get("/")
    assert page.status_code == 200
    assert SECRET in page.text
    assert supervisor.access.tokens["administer"] not in page.text


def test_every_answer_forbids_what_a_page_needs_not(user: Any, client: Any) -> None:
    for answer in (
        user.get("/"),
        user.get("/nothing"),
        client.get("/static/page.css"),
        user.get("/jobs/run"),
    ):
        policy = answer.headers["content-security-policy"]
        assert "default-src 'none'" in policy
        assert "frame-ancestors 'none'" in policy
        assert "unsafe" not in policy
        assert answer.headers["x-frame-options"] == "DENY"
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["referrer-policy"] == "same-origin"
        assert "access-control-allow-origin" not in answer.headers


def test_pages_have_no_script_and_no_style_in_them(user: Any) -> None:
    for path in PAGES:
        text = user.get(path).text
        assert "<script>" not in text
        assert "<style" not in text
        assert " style=" not in text
        assert " onclick" not in text


def test_who_may_look_only_sees_all_and_changes_nothing(supervisor: Any, client: Any) -> None:
    assert client.get("/", params={"token": supervisor.access.tokens["look"]}).status_code == 200
    name = new_id()
    supervisor.queue.add(name, "check", ("check",), f"/tasks/{name}")
    for path in ("/", "/experiments", "/tasks", f"/tasks/{name}", "/jobs/run"):
        answer = client.get(path)
        assert answer.status_code == 200
        assert '<form method="post" action="/tasks' not in answer.text
        assert ">Start</button>" not in answer.text
    session = client.cookies["resim_8765"]
    data = {"seal": supervisor.access.form_seal(session)}
    for path in (f"/tasks/{name}/cancel", "/jobs/check"):
        answer = client.post(path, data=data, headers={"origin": ORIGIN})
        assert answer.status_code == 403
        assert "look only" in answer.text
    assert supervisor.queue.get(name).state == "waiting"
    for changed in (session.replace(".look.", ".run."), session.replace(".look.", ".administer.look.")):
        assert supervisor.access.session(changed) is None


@pytest.mark.parametrize(
    "token", ["", "x", "0" * 32, "é" * 20, "%00", "\ud800".encode("utf-8", "replace").decode(), "a" * 3000]
)
def test_a_wrong_token_lets_nobody_in(client: Any, token: str) -> None:
    answer = client.get("/", params={"token": token})
    assert answer.status_code == 401
    assert "set-cookie" not in answer.headers
    assert client.get("/").status_code == 401


def test_tokens_are_not_guessed_fast(client: Any) -> None:
    found = [client.get("/", params={"token": f"guess{k}"}).status_code for k in range(14)]
    assert found[:5] == [401] * 5
    assert 429 in found


@pytest.mark.parametrize(
    "cookie",
    [
        "", "x", "9999999999.abc.def", "9999999999..", ".", "1.0123456789abcdef.{seal}", "{good}0", "{good} ",
        "x{good}", "{late}", "é.é.é",
    ],
)  # fmt: skip
def test_a_wrong_cookie_lets_nobody_in(supervisor: Any, client: Any, cookie: str) -> None:
    access = supervisor.access
    good = access.new_session(OWNER)
    late = good.rpartition(".")[0].replace(good.partition(".")[0], "1000000000")
    told = cookie.format(
        good=good, seal=access._seal("resim_8765", "x"), late=f"{late}.{access._seal('resim_8765', late)}"
    )
    headers = {"cookie": f"resim_8765={told}".encode()}
    home = access.home(good if told.strip() == good else told)
    assert client.get(f"{home}/", headers=headers).status_code == (200 if told.strip() == good else 401)


def test_a_cookie_of_another_key_or_twice_lets_nobody_in(
    supervisor: Any, client: Any, tmp_path: Path
) -> None:
    other = Access(b"o" * 32, 8765, Users(tmp_path / "users.json")).new_session(OWNER)
    home = supervisor.access.home
    assert client.get(f"{home(other)}/", headers={"cookie": f"resim_8765={other}"}).status_code == 401
    good = supervisor.access.new_session(OWNER)
    assert client.get(f"{home(good)}/", headers={"cookie": f"resim_8765={good}"}).status_code == 200
    both = [("cookie", f"resim_8765={good}"), ("cookie", f"resim_8765={other}")]
    assert client.get(f"{home(good)}/", headers=both).status_code == 401


@pytest.mark.parametrize(
    "host",
    ["evil.example", "evil.example:8765", "127.0.0.1", "127.0.0.1:1", "127.0.0.1:8765.evil.example", ""],
)
def test_another_name_of_the_host_is_refused(user: Any, host: str) -> None:
    assert user.get("/", headers={"host": host}).status_code == 421


@pytest.mark.parametrize(
    "origin",
    [
        None,
        "null",
        "http://evil.example",
        "http://127.0.0.1:9999",
        "https://127.0.0.1:8765",
        f"{ORIGIN}/",
        "",
    ],
)
def test_forms_of_other_pages_are_refused(supervisor: Any, user: Any, seal: str, origin: str | None) -> None:
    headers = {} if origin is None else {"origin": origin}
    answer = user.post("/jobs/check", data={"seal": seal}, headers=headers)
    assert answer.status_code == 403
    assert supervisor.queue.counts() == {}


@pytest.mark.parametrize("given", ["", "x", "{other}"])
def test_forms_without_the_seal_of_the_session_are_refused(supervisor: Any, user: Any, given: str) -> None:
    other = supervisor.access.form_seal(supervisor.access.new_session(OWNER))
    data = {"seal": given.format(other=other)}
    assert user.post("/jobs/check", data=data, headers={"origin": ORIGIN}).status_code == 403
    assert user.post("/jobs/check", headers={"origin": ORIGIN}).status_code in (403, 415)


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_scripts_of_other_sites_and_ports_read_nothing(user: Any, site: str) -> None:
    headers = {"sec-fetch-site": site, "sec-fetch-mode": "cors"}
    assert user.get("/tasks", headers=headers).status_code == 403
    assert user.get("/events", headers=headers).status_code == 403
    assert user.get("/tasks", headers={**headers, "sec-fetch-mode": "navigate"}).status_code == 200


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("PUT", "/tasks", 405), ("DELETE", "/results/abc", 405), ("OPTIONS", "/", 405), ("TRACE", "/", 405),
        ("POST", "/static/page.css", 405), ("GET", "/x" * 3000, 414), ("GET", "/static/../app.py", 404),
        ("GET", "/static/..%2fapp.py", 404), ("GET", "/static/supervisor.css%00", 400), ("GET", "/static/a\\b", 404),
        ("GET", "/tasks/%2e%2e", 404), ("GET", "/tasks/' OR 1=1 --", 404), ("GET", "/results/%25", 404),
        ("GET", "/experiments/x", 404), ("GET", "/builds/x", 404), ("GET", "/jobs/serve", 404),
        ("GET", "/open/results/0123456789abcdef/report.html", 404), ("GET", "/open/folders/x/report.html", 404),
        ("GET", "/builds/compare?one=x&other=y", 404), ("GET", "/events?task=nothing", 404),
    ],
)  # fmt: skip
def test_odd_requests_are_refused(user: Any, method: str, path: str, status: int) -> None:
    assert user.request(method, path, headers={"origin": ORIGIN}).status_code == status


@pytest.mark.parametrize(
    ("kind", "body", "status"),
    [
        ("application/x-www-form-urlencoded", b"a" * 70_000, 413),
        ("application/x-www-form-urlencoded", b"&".join([b"a=b"] * 2000), 400),
        ("application/x-www-form-urlencoded", b"\xff\xfe=1", 400),
        ("application/json", b"{}", 415),
        ("multipart/form-data; boundary=x", b"--x--", 415),
        ("text/plain", b"seal=1", 415),
    ],
)
def test_odd_bodies_are_refused(user: Any, kind: str, body: bytes, status: int) -> None:
    headers = {"origin": ORIGIN, "content-type": kind}
    assert user.post("/jobs/check", content=body, headers=headers).status_code == status


def test_a_body_that_does_not_say_its_size_is_cut_off(user: Any) -> None:
    headers = {"origin": ORIGIN, "content-type": "application/x-www-form-urlencoded"}
    parts = (b"a" * 10_000 for _ in range(10))
    assert user.post("/jobs/check", content=parts, headers=headers).status_code == 413


@pytest.mark.parametrize("name", ["'><script>alert(1)</script>", "</title><b>x", '" onfocus="x'])
def test_what_is_searched_for_is_never_markup(user: Any, name: str) -> None:
    for path in ("/lake", "/results", "/experiments", "/builds"):
        text = user.get(path, params={"text": name, "state": name, "kind": name, "verdict": name}).text
        assert name not in text
    assert 'value="{{7*7}}"' in user.get("/lake", params={"text": "{{7*7}}"}).text


def test_too_many_requests_and_streams_are_refused() -> None:
    rate = RateLimit(each=0.001, burst=3.0)
    assert [rate.allows("a") for _ in range(5)] == [True] * 3 + [False] * 2
    assert rate.allows("b")
    streams = StreamLimit(each=2, most=3)
    assert [streams.takes(c) for c in "aaabb"] == [True, True, False, True, False]
    streams.leave("a")
    assert streams.takes("b")
    assert not streams.takes("c")


def test_the_key_is_the_users_alone(tmp_path: Path) -> None:
    path = tmp_path / "data" / "serve.key"
    key = kept_key(path)
    assert kept_key(path) == key
    assert len(key) == 32
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    path.chmod(0o644)
    with pytest.raises(InputError, match="may be read by other users"):
        kept_key(path)
    path.unlink()
    path.write_bytes(b"short")
    path.chmod(0o600)
    with pytest.raises(InputError, match="has 5 bytes"):
        kept_key(path)


def test_a_cookie_outlives_its_server_where_the_key_is_kept(tmp_path: Path) -> None:
    users = Users(tmp_path / "users.json")
    before, after = Access(b"k" * 32, 8765, users), Access(b"k" * 32, 8765, users)
    assert after.session(before.new_session(OWNER)) == OWNER
    assert after.visitor(before.tokens["administer"]) is None
    alone = Access(b"k" * 32, 8765, users, users_only=True)  # lets in users, and nobody by an old cookie
    assert alone.tokens == {}
    assert alone.session(before.new_session(OWNER)) is None
