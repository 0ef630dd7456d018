"""The Supervisor in Chromium, by use: start a job, watch its log, open its page, lose the server, find it again."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
import sys
import threading
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browsed import chromium, too_faint
from calling import called
from conftest import Call
from mining.planted import random_traffic, write_straight
from supervised import PAGES, waited

from resim.jobs.mine import MineOptions, mine
from resim.recordings import Recording, write_recording
from resim.recordings.content import content_hash
from resim.results.catalog import Catalog
from resim.results.entry import CatalogEntry, CatalogFact, CatalogInput, CatalogOutcome
from resim.results.queue import TaskQueue, new_id
from resim.supervisor.processes import is_alive, read_whole
from resim.supervisor.runner import LIVE

ROOT = Path(__file__).parents[2]
COLORS_OF_CANVAS = """() => {
  const canvas = document.querySelector(".live canvas"), seen = new Set();
  const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  for (let k = 0; k < data.length; k += 4) seen.add(data.slice(k, k + 4).join());
  return seen.size > 3;
}"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as found:
        yield found


@pytest.fixture
def opened(browser: Any, served: Callable[..., Any]) -> Iterator[Callable[..., Any]]:
    """Open a page of a browser that was let in; fails at the end where one complained, or wanted anything elsewhere."""
    faults: list[str] = []
    contexts = []

    def enter(address: str, token: str, **look: Any) -> Any:
        context = browser.new_context(**look)
        context.set_default_timeout(180_000)  # where it is the first to simulate, that is compiled before
        contexts.append(context)
        page = context.new_page()
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on(
            "console", lambda m: "net::ERR_" in m.text or faults.append(m.text)
        )  # of a server that was killed
        page.on("request", lambda r: r.url.startswith((address, "data:")) or faults.append(r.url))
        page.goto(f"{address}/?token={token}")
        page.wait_for_selector("main")
        page.wait_for_url(re.compile(rf"{address}/[0-9a-f]{{32}}/$"))
        page.home = page.url.removesuffix("/")
        return page

    yield enter
    for context in contexts:
        context.close()
    assert not faults


def wait_for_scan(page: Any) -> None:
    """Wait until all that is registered is there; suites are looked at last."""
    page.goto(f"{page.home}/lake?kind=sweep-file")
    page.locator("a", has_text="perception_latency").first.wait_for()


def test_pages_fit_and_can_be_read(opened: Callable[..., Any], served: Callable[..., Any]) -> None:
    _, address, token = served(ROOT / "scenarios", ROOT / "adfunc")
    for width, dark in ((400, True), (2560, True), (1280, False)):
        look = {"viewport": {"width": width, "height": 900}, "color_scheme": "dark" if dark else "light"}
        page = opened(address, token, **look)
        for path in PAGES:
            page.goto(page.home + path, wait_until="domcontentloaded")
            over = page.evaluate(
                "document.documentElement.scrollWidth - document.documentElement.clientWidth"
            )
            assert over <= 0, (path, width)
            assert width == 2560 or too_faint(page) == [], (path, width)
            assert page.locator("h1").count() == 1
    page.keyboard.press("/")
    page.keyboard.type("cut_in_brake")
    page.keyboard.press("Enter")
    page.wait_for_url("**/lake?text=cut_in_brake")
    page.click("main a:text-is('cut_in_brake')")
    page.wait_for_url("**/experiments/*")
    page.click("main a:text-is('run')")
    assert page.locator("#f-recording option:checked").inner_text().startswith("cut_in_brake")


def test_a_job_is_started_watched_and_found_again(
    opened: Callable[..., Any], served: Callable[..., Any]
) -> None:
    server, address, token = served(ROOT / "scenarios")
    page = opened(address, token)
    wait_for_scan(page)
    page.goto(f"{page.home}/jobs/play")
    page.select_option("#f-drives", label="recording cut_in_brake – scenarios")
    page.click("text=Start >> nth=-1")
    page.wait_for_url("**/tasks/*")
    task = page.url
    page.locator("#log", has_text="player:").wait_for()  # as it is written
    page.locator(".badge", has_text="done").wait_for()
    with page.context.expect_page() as found:
        page.click("a.button:text-is('cut_in_brake.html')")
    player = found.value
    player.wait_for_selector("#player")
    assert player.title() == "cut_in_brake · player"
    assert player.evaluate("self.origin") == "null"  # what a document does, it does not do as this user
    assert player.evaluate("(() => { try { return document.cookie; } catch { return 'none'; } })()") == "none"
    player.close()
    page.locator("#connection", has_text="live").wait_for()
    port = address.rpartition(":")[2]
    server.kill()
    server.wait()
    command = ["--port", port]
    _, again, _ = served(*command)
    assert again == address
    page.goto(task)  # the cookie is good for the next server, too
    page.locator(".badge", has_text="done").wait_for()
    assert "player:" in page.inner_text("#log")


@pytest.mark.slow
def test_a_drive_that_is_registered_under_a_running_server_shows_up(
    opened: Callable[..., Any], served: Callable[..., Any], tmp_path: Path
) -> None:
    _, address, token = served()
    page = opened(address, token, viewport={"width": 400, "height": 900})
    page.goto(f"{page.home}/experiments")
    page.locator("p", has_text="There are no recordings yet").wait_for()
    shutil.copytree(ROOT / "scenarios" / "cut_in_brake", tmp_path / "new" / "drives" / "cut_in_brake")
    shutil.copytree(ROOT / "networks", tmp_path / "new" / "networks", ignore=shutil.ignore_patterns("*.md"))
    assert called("lake", "add", tmp_path / "new") == 0
    page.locator(".drive a:text-is('cut_in_brake')").wait_for()  # without a reload
    assert_verdicts_are_seen(page)


def assert_verdicts_are_seen(page: Any) -> None:
    """At 400 px no verdict, and no state of a step, is cut off or has to be scrolled to."""
    for box in page.locator("main .cell, main table .badge").all():
        where = box.bounding_box()
        assert where is not None
        assert where["x"] >= 0
        assert where["x"] + where["width"] <= 400, box.inner_text()


@pytest.mark.slow
def test_a_quiet_task_counts_on_and_its_buttons_keep_apart(
    opened: Callable[..., Any], served: Callable[..., Any], catalog: str, tmp_path: Path
) -> None:
    _, address, token = served()
    queue, name = TaskQueue(Catalog(catalog)), new_id()
    queue.host = "elsewhere"  # nobody here does it
    queue.add(name, "check", ("check", "--", "/nothing"), str(tmp_path / "tasks" / name))
    page = opened(address, token, viewport={"width": 400, "height": 900})
    page.goto(f"{page.home}/tasks")
    page.route("**/tasks", lambda route: route.abort())  # without asking the server
    told = page.locator("[data-age]")
    first = told.inner_text()
    page.wait_for_function("first => document.querySelector('[data-age]').textContent !== first", arg=first)
    assert told.inner_text().endswith(" s")
    assert_buttons_keep_apart(page, ".acts button", 5)
    page.goto(f"{page.home}/tasks/{name}")
    assert_buttons_keep_apart(page, "main form button", 4)


def assert_buttons_keep_apart(page: Any, which: str, count: int) -> None:
    boxes = [one.bounding_box() for one in page.locator(which).all()]
    assert len(boxes) == count
    for k, a in enumerate(boxes):
        for b in boxes[k + 1 :]:
            aside = max(b["x"] - a["x"] - a["width"], a["x"] - b["x"] - b["width"])
            below = max(b["y"] - a["y"] - a["height"], a["y"] - b["y"] - b["height"])
            assert max(aside, below) >= 4.0


@pytest.mark.slow
def test_a_task_is_cancelled_by_one_and_seen_by_another(
    opened: Callable[..., Any], served: Callable[..., Any], tmp_path: Path
) -> None:
    _, address, token = served(ROOT / "scenarios", ROOT / "adfunc")
    one, other = opened(address, token), opened(address, token)
    wait_for_scan(one)
    one.goto(f"{one.home}/jobs/verify")
    one.select_option("#f-suite", label="highway – scenarios/suites")
    one.select_option("#f-build", label="highway_pilot-1.0 – adfunc/builds")
    other.goto(f"{other.home}/tasks")
    one.click("text=Start >> nth=-1")
    one.wait_for_url("**/tasks/*")
    other.locator("td .badge", has_text="running").wait_for()
    one.click("button:has-text('Cancel')")
    other.locator("td .badge", has_text="cancelled").wait_for()
    other.click("button:has-text('Repeat')")
    one.locator(".badge", has_text="running").wait_for()
    other.locator("button:has-text('Cancel')").click()
    one.locator(".badge", has_text="cancelled").wait_for()
    begun = [read_whole(path) for path in (tmp_path / "tasks").glob("*/begun.json")]
    assert [b["attempt"] for b in begun] == [2]
    waited(lambda: not is_alive(begun[0]["process"]))


@pytest.mark.slow
def test_a_simulation_is_seen_as_it_runs(opened: Callable[..., Any], served: Callable[..., Any]) -> None:
    _, address, token = served(ROOT / "scenarios", ROOT / "adfunc")
    page = opened(address, token, viewport={"width": 1280, "height": 900})
    other = page.context.new_page()
    other.goto(f"{address}/live")  # by a bare address, as somebody else shares it
    other.wait_for_url("**/live")
    assert "Nothing runs" in other.inner_text("main")
    wait_for_scan(page)
    page.goto(f"{page.home}/jobs/verify")
    page.select_option("#f-suite", label="highway – scenarios/suites")
    page.select_option("#f-build", label="highway_pilot-1.0 – adfunc/builds")
    page.select_option(
        "#f-perception", label="proving_ground – adfunc/perception"
    )  # with up to 200 seeds: it lasts longer than all looks at it
    page.click("text=Start >> nth=-1")
    page.click("a:text-is('Watch it')")
    page.wait_for_url("**/live?task=*")
    page.locator("#live-state", has_text="highway_pilot-1.0, seed 0 · EGO").wait_for()
    page.wait_for_function(COLORS_OF_CANVAS)  # of road, EGO and objects
    moved = page.inner_text("#live-state")
    page.wait_for_function("then => document.getElementById('live-state').innerText !== then", arg=moved)
    page.click("#farther")
    other.bring_to_front()
    other.locator(
        "#live-state", has_text="highway_pilot-1.0, seed 0 · EGO"
    ).wait_for()  # it began to watch by itself
    page.locator("main button:has-text('Cancel')").click()
    page.locator(".badge", has_text="cancelled").first.wait_for()
    other.locator(".badge", has_text="cancelled").wait_for()
    other.locator("p:text-is('Nothing runs, nothing waits.')").wait_for()
    assert other.locator("h2", has_text="Running and waiting").count() == 1


def test_words_tell_the_last_state_of_a_simulation(
    opened: Callable[..., Any], served: Callable[..., Any], catalog: str, tmp_path: Path
) -> None:
    queue = TaskQueue(Catalog(catalog), "another machine")  # where nobody does it
    name, folder = new_id(), tmp_path / "tasks" / "watched"
    folder.mkdir(parents=True)
    queue.add(name, "run", ("run",), str(folder))
    _, address, token = served(ROOT / "scenarios")
    page = opened(address, token)
    page.goto(f"{page.home}/live?task={name}")
    for k in range(5):
        boxes = [["ego", "car", k, 0.0, 0.0, 20.0 + k, 4.5, 1.8]]
        state = {"t": k, "end": 9.0, "build": "pilot", "seed": 0, "map": "", "boxes": boxes}
        (folder / "new.json").write_text(json.dumps(state))
        (folder / "new.json").replace(folder / LIVE)
        page.wait_for_timeout(60)
    page.locator("#live-state", has_text="4.00 of 9.00 s · pilot, seed 0 · EGO 24.0 m/s").wait_for(
        timeout=5000
    )


def test_a_change_that_comes_while_a_page_is_fetched_is_shown(
    opened: Callable[..., Any], served: Callable[..., Any], catalog: str, tmp_path: Path
) -> None:
    queue, names = (
        TaskQueue(Catalog(catalog), "another machine"),
        [new_id() for _ in range(2)],
    )  # where nobody does it
    for name in names:
        (tmp_path / "tasks" / name).mkdir(parents=True)
    _, address, token = served()
    page = opened(address, token)
    page.goto(f"{page.home}/tasks")
    page.locator("#connection", has_text="live").wait_for()
    fetched: list[str] = []

    def slowly(route: Any) -> None:
        answer = route.fetch()
        fetched.append(answer.text())
        if len(fetched) == 1:
            queue.add(names[1], "check", ("check",), str(tmp_path / "tasks" / names[1]))
            page.wait_for_timeout(3000)  # in which the browser is told
        route.fulfill(response=answer)

    page.route("**/tasks", slowly)
    queue.add(names[0], "check", ("check",), str(tmp_path / "tasks" / names[0]))
    page.locator("a", has_text=names[0][:6]).wait_for()
    page.locator("a", has_text=names[1][:6]).wait_for(timeout=8000)  # long before the page looks by itself
    assert names[1] not in fetched[0]


EVIL = """<!DOCTYPE html><title>waiting</title><script>(async () => {
  const told = [];
  for (const path of ["/tasks", "/", "/events"]) {
    try { told.push((await fetch(path, { credentials: "include" })).status); } catch { told.push("none"); }
  }
  try { const got = await fetch("/tasks/TASK/cancel", { method: "POST", credentials: "include",
    headers: { "content-type": "application/x-www-form-urlencoded" }, body: "seal=x" }); told.push(got.status); }
  catch { told.push("none"); }
  try { told.push(document.cookie || "empty"); } catch { told.push("none"); }
  try { const form = document.createElement("form"); form.method = "post"; form.action = "/tasks/TASK/cancel";
    document.body.append(form); form.submit(); told.push("sent"); } catch { told.push("none"); }
  document.title = told.join(" ");
})();</script>"""
"""A document that tries to act for who looks at it."""


def test_a_hostile_document_can_do_nothing(
    browser: Any, served: Callable[..., Any], catalog: str, tmp_path: Path
) -> None:
    queue = TaskQueue(Catalog(catalog), "another machine")  # where nobody does it
    name = new_id()
    queue.add(name, "check", ("check",), str(tmp_path / "tasks" / name))
    (tmp_path / "tasks" / name).mkdir(parents=True)
    (tmp_path / "tasks" / name / "evil.html").write_text(EVIL.replace("TASK", name))
    _, address, token = served()
    context = browser.new_context()
    page = context.new_page()
    page.goto(f"{address}/?token={token}")
    page.wait_for_selector("main")
    page.goto(f"{page.url}tasks/{name}")
    assert "waiting" in page.inner_text("main")
    page.evaluate(
        "name => { location.href = location.pathname.replace(/tasks.*/, `open/tasks/${name}/evil.html`); }",
        name,
    )
    page.wait_for_url("**/pages/**")
    page.wait_for_function("document.title !== 'waiting'")
    assert page.title() == "none none none none none sent"
    page.wait_for_timeout(300)
    assert "/pages/" in page.url
    assert queue.get(name).state == "waiting"
    context.close()


TELLTALE = """<!DOCTYPE html><title>waiting</title><a href="http://127.0.0.1:PORT/left">on</a><script>(async () => {
  const told = [document.referrer, performance.getEntriesByType("navigation")[0].name, String(window.opener)];
  try { told.push(...navigation.entries().map(e => e.url), navigation.activation.from?.url); } catch { }
  try { await fetch("http://127.0.0.1:PORT/fetched", { mode: "no-cors", credentials: "include" }); } catch { }
  document.title = told.join(" ");
})();</script>"""
"""A document that looks for where its reader came from, and leads to another port."""


def test_another_port_of_the_host_gets_no_cookie_and_no_address_of_a_session(
    browser: Any, served: Callable[..., Any], catalog: str, tmp_path: Path
) -> None:
    heard: list[tuple[str, Any]] = []

    class Listener(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            heard.append((self.path, dict(self.headers)))
            self.send_response(200)
            self.send_header("content-type", "text/html")
            self.end_headers()
            again = "setTimeout(() => { location = '/again/tasks'; }, 50)"  # from its own origin, too
            self.wfile.write(b"" if "again" in self.path else f"<script>{again}</script>".encode())

        def log_message(self, *given: Any) -> None:
            pass

    queue, name = TaskQueue(Catalog(catalog), "another machine"), new_id()  # where nobody does it
    folder = tmp_path / "tasks" / name
    queue.add(name, "check", ("check",), str(folder))
    folder.mkdir(parents=True)
    _, address, token = served()
    with ThreadingHTTPServer(("127.0.0.1", 0), Listener) as listening:
        threading.Thread(target=listening.serve_forever, daemon=True).start()
        port = str(listening.server_address[1])
        (folder / "telltale.html").write_text(TELLTALE.replace("PORT", port))
        context = browser.new_context()
        page = context.new_page()
        page.goto(f"{address}/?token={token}")
        page.wait_for_selector("main")
        home = page.url.removesuffix("/").rpartition("/")[2]
        (cookie,) = context.cookies()
        assert cookie["path"] == f"/{home}/"
        page.goto(f"{address}/{home}/tasks/{name}")
        page.evaluate(
            "() => { location.href = location.pathname.replace('tasks', 'open/tasks') + '/telltale.html'; }"
        )
        page.wait_for_function("document.title && document.title !== 'waiting'")
        assert home not in page.title()
        page.click("a")
        page.wait_for_url("**/again/tasks")
        listening.shutdown()
    assert {path for path, _ in heard} >= {"/fetched", "/left", "/again/tasks"}
    for _, headers in heard:
        assert not {"Cookie", "cookie"} & set(headers)
        assert home not in str(headers)
    context.close()


@pytest.mark.slow
def test_two_builds_are_compared_and_a_number_is_traced_to_its_origin(
    opened: Callable[..., Any], served: Callable[..., Any], catalog: str, tmp_path: Path
) -> None:
    _, address, token = served(ROOT / "scenarios", ROOT / "adfunc")
    drive = ROOT / "scenarios" / "cut_in_brake"
    content = content_hash(drive)
    for day, (label, verdict) in enumerate((("pilot-1.0", "PASS"), ("pilot-1.1", "FAIL")), start=1):
        inputs = (
            CatalogInput("recording", drive.name, "", content),
            CatalogInput("build", label, "", f"{day:064x}"),
        )
        outcome = CatalogOutcome(drive.name, label, "rGT", verdict, "distance")
        written = f"2026-11-0{day}T05:00:00+00:00"
        entry = CatalogEntry("run", drive.name, tmp_path / label, "here", written, f"{day}", "0.1.0", verdict)
        made = CatalogFact("circumstances", '{"criteria": "highway ab"}')
        entry = replace(entry, counts={verdict: 1}, inputs=inputs, outcomes=(outcome,), facts=(made,))
        Catalog(catalog).add(entry)
    page = opened(address, token)
    wait_for_scan(page)
    page.goto(f"{page.home}/builds")
    page.click("button:text-is('Compare side by side')")
    page.locator(".badge", has_text="worse").wait_for()
    page.click("td a:has-text('FAIL')")
    page.wait_for_url("**/results/*")
    assert "Its folder is on here" in page.inner_text("main")
    page.click(f"main a:text-is('{drive.name}')")  # what went in
    page.wait_for_url("**/experiments/*")
    with page.expect_download() as found:
        page.click("a:has-text('RO-Crate')")
    found.value.save_as(tmp_path / "crate.zip")
    with zipfile.ZipFile(tmp_path / "crate.zip") as archive:
        names = archive.namelist()
    assert "ro-crate-metadata.json" in names
    assert any(name.endswith("cut_in_brake/gt.csv") for name in names)


@pytest.mark.slow
def test_what_a_command_put_in_is_done_and_traced_to_all_that_it_came_from(
    opened: Callable[..., Any], served: Callable[..., Any], call: Call, tmp_path: Path
) -> None:
    drive, build = ROOT / "scenarios" / "cut_in_brake", ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml"
    model, criteria = (
        ROOT / "adfunc" / "perception" / "latency.json",
        ROOT / "scenarios" / "criteria" / "highway.toml",
    )
    _, address, token = served(ROOT / "scenarios", ROOT / "adfunc", ROOT / "networks")
    page = opened(address, token)
    wait_for_scan(page)
    words = ("run", drive, "--build", build, "--perception", model, "--criteria", criteria, "--seed", "11")
    added = json.loads(call("tasks", "add", "--json", "--tasks", tmp_path / "tasks", *words)[1])
    page.goto(f"{page.home}/tasks/{added['id']}")
    page.locator("a:text-is('Its result')").click()
    page.wait_for_url("**/results/*")
    result = page.url
    page.locator("details:has-text('Versions')").click()
    told = page.inner_text("main")
    assert re.search(r"seed 11\b", told)
    for package in ("libsumo", "numpy", "resim"):
        assert re.search(rf"{package} \d", told), package
    for role, name in (
        ("recording", drive.name), ("build", "highway_pilot"), ("perception", "latency"), ("criteria", "highway"),
        ("map", "proving_ground"),
    ):  # fmt: skip
        page.goto(result)
        page.locator(f"tr:has(td:text-is('{role}')) th a").first.click()
        page.wait_for_url(lambda url: url != result)
        assert name in page.inner_text("h1"), (role, page.url)
    page.goto(result)
    again = shlex.split(page.locator("code", has_text="resim run").first.inner_text())
    made = subprocess.run(
        [sys.executable, "-m", *again], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert made.returncode == 1, made.stderr  # its verdict is bad, as that of the corner case is
    first = tmp_path / "tasks" / added["id"] / drive.name
    for name in ("tracks.parquet", "kpis.parquet", "plans.parquet"):
        assert (tmp_path / "again" / name).read_bytes() == (first / name).read_bytes()


MANY = f"""
name = "many"
criteria = "{ROOT}/scenarios/criteria/highway.toml"
build = ["{ROOT}/adfunc/builds/highway_pilot-1.0.toml"]
perception = "{ROOT}/adfunc/perception/latency.json"
seeds = 30

[[recording]]
folder = "{ROOT}/scenarios/cut_in_brake"

[[parameter]]
name = "perception.latency.speed"
low = 0.0
high = 1.2
steps = 20
"""
"""A sweep that takes minutes."""


@pytest.mark.slow
def test_a_sweep_is_seen_as_it_grows(
    opened: Callable[..., Any], served: Callable[..., Any], tmp_path: Path
) -> None:
    (tmp_path / "files").mkdir()
    (tmp_path / "files" / "many.toml").write_text(MANY)
    _, address, token = served(ROOT / "scenarios", ROOT / "adfunc")
    page = opened(address, token, viewport={"width": 400, "height": 900})
    wait_for_scan(page)
    page.goto(f"{page.home}/jobs/sweep")
    page.select_option("#f-file", label="many – files")
    page.click("text=Start >> nth=-1")
    page.wait_for_url("**/tasks/*")
    page.locator(".progress", has_text="runs").wait_for()
    page.locator("th:text-is('distance')").wait_for()  # criteria of runs that are done
    counted = page.locator(".progress span").inner_text()
    page.wait_for_function("then => document.querySelector('.progress span').innerText !== then", arg=counted)
    page.locator("main button:has-text('Pause')").click()
    page.locator(".badge", has_text="paused").first.wait_for()
    (journal,) = (tmp_path / "tasks").rglob("journal/*.jsonl")
    done = journal.read_bytes()
    assert done
    page.locator("main button:has-text('Resume')").click()
    waited(lambda: len(journal.read_bytes()) > len(done), 120.0)
    assert journal.read_bytes().startswith(done)  # what was done is not done again
    page.locator("main button:has-text('Cancel')").click()
    page.locator(".badge", has_text="cancelled").first.wait_for()


@pytest.fixture
def mined(tmp_path: Path) -> tuple[Path, Path]:
    """Two mined folders of drawn traffic, of which the first one takes a space some seconds, where jobs find them."""
    road = write_straight(tmp_path / "straight.xodr")
    folders = tmp_path / "files" / "mined", tmp_path / "files" / "mined_in_may"
    for seed, (folder, vehicles) in enumerate(zip(folders, (400, 40), strict=True)):
        tracks = random_traffic(np.random.default_rng(seed), vehicles, 16.0, 10.0)
        drive = tmp_path / "drives" / f"drive_{seed}"
        write_recording(Recording(drive.name, road, str(tracks.ids[0]), tracks, 10.0), drive)
        mine([drive], folder, MineOptions(write=False, accept=("OVERLAP",)))
    return folders


def choose(page: Any, field: str, text: str) -> None:
    page.select_option(field, value=page.locator(f"{field} option", has_text=text).get_attribute("value"))


@pytest.mark.slow
def test_a_space_is_seen_as_it_grows(
    opened: Callable[..., Any], served: Callable[..., Any], mined: tuple[Path, Path], tmp_path: Path
) -> None:
    assert called("lake", "add", tmp_path / "files", tmp_path / "drives") == 0
    _, address, token = served()
    page = opened(address, token, viewport={"width": 400, "height": 900})
    page.goto(f"{page.home}/jobs/space")
    choose(page, "#f-mined", "mining mined,")
    page.click("text=Start >> nth=-1")
    page.wait_for_url("**/tasks/*")
    bar = page.locator(".progress span")
    bar.filter(has_text="clusters").wait_for()  # of a bucket that is done
    counted = bar.inner_text()
    page.wait_for_function("then => document.querySelector('.progress span').innerText !== then", arg=counted)
    page.locator("a:text-is('Its result')").click()
    page.wait_for_url("**/results/*")
    before = drives_and_scenarios(page)
    page.goto(f"{page.home}/jobs/space-grow")
    choose(page, "#f-mined", "mining mined_in_may,")
    page.select_option("#f-space", index=1)
    page.click("text=Start >> nth=-1")
    page.wait_for_url("**/tasks/*")
    page.locator("a:text-is('Its result')").click()
    page.wait_for_url("**/results/*")
    drives, scenarios = drives_and_scenarios(page)
    assert before[0] == {"drive_0"}
    assert drives == {"drive_0", "drive_1"}
    assert scenarios > before[1]
    with page.expect_popup() as found:
        page.click("a:text-is('space.html')")
    found.value.locator("h1").wait_for()
    page.click("a:text-is('drive_1')")
    page.wait_for_url("**/experiments/*")
    assert "drive_1" in page.inner_text("h1")


def drives_and_scenarios(page: Any) -> tuple[set[str], int]:
    """The recordings that a page of a space names as what went in, and how many scenarios it counts."""
    drives = page.locator("tr:has(td:text-is('recording')) th").all_inner_texts()
    return set(drives), int(page.locator("td[data-label='scenarios']").first.inner_text())
