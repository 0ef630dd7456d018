"""What pages show: results and their documents, drives and what is missing, builds side by side, places."""

from __future__ import annotations

import io
import json
import os
import platform
import re
import shutil
import tempfile
import threading
import time
import zipfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from supervised import waited

from resim.recordings.content import content_hash
from resim.results.asked import AskedResults, AskedValue, write_asked
from resim.results.catalog import Catalog
from resim.results.entry import KINDS, CatalogEntry, CatalogFact, CatalogInput, CatalogOutcome
from resim.results.lake import LakeQuery, find_page
from resim.results.queue import new_id
from resim.results.scanning import register
from resim.results.tones import tone
from resim.supervisor.documents import find_document
from resim.supervisor.processes import process_name
from resim.supervisor.views.common import MissingError, result_folder
from resim.supervisor.words import size

ROOT = Path(__file__).parents[2]
DRIVE = ROOT / "scenarios" / "cut_in_brake"
EVIL = "<script>alert(1)</script>"
HASH = content_hash(DRIVE)


def entry(name: str = "cut_in_brake", day: int = 1, **more: Any) -> CatalogEntry:
    told: dict[str, Any] = {
        "kind": "run", "folder": Path("/results") / f"{name}-{day}", "host": "cluster", "digest": f"{day:064x}",
        "verdict": "FAIL", "counts": {"PASS": 1, "FAIL": 1},
        "inputs": (CatalogInput("recording", name, "", HASH), CatalogInput("build", "pilot-1.0", "", "ab" * 32)),
        "outcomes": (
            CatalogOutcome(name, "pilot-1.0", "GT", "PASS"),
            CatalogOutcome(name, "pilot-1.0", "rGT", "FAIL", "distance"),
            CatalogOutcome(name, "pilot-1.0", "rSD", "INVALID"),
        ),
    } | more  # fmt: skip
    return CatalogEntry(name=name, written=f"2026-11-{day:02}T05:00:00.000+00:00", resim="0.1.0", **told)


def made_with(**told: str) -> CatalogFact:
    return CatalogFact("circumstances", json.dumps({"criteria": "highway ab", "vehicle": "kinematic"} | told))


def build(label: str, digest: str, day: int, verdicts: dict[str, str], **told: str) -> CatalogEntry:
    inputs = [CatalogInput("recording", name, "", f"{name:0>64}") for name in verdicts]
    return entry(
        "suite", day, kind="verification", inputs=(*inputs, CatalogInput("build", label, "", digest)),
        outcomes=tuple(CatalogOutcome(name, label, verdict=v) for name, v in verdicts.items()),
        facts=(made_with(**told),),
    )  # fmt: skip


@pytest.fixture
def known(catalog: str) -> Catalog:
    return Catalog(catalog)


def cells(text: str, name: str) -> list[tuple[str, str]]:
    """State and words of the cells of a drive."""
    rows = next(part for part in text.split("<tbody>") if f">{name}</a>" in part)
    return re.findall(r'class="cell (\w+)"[^>]*>(?:<a[^>]*>)?([^<]*)', rows)


def test_empty_pages_say_what_to_do(user: Any) -> None:
    assert "resim runs add FOLDER" in user.get("/").text
    assert 'href="/jobs"' in user.get("/results").text
    assert 'href="/jobs/verify"' in user.get("/builds").text
    assert user.get("/tasks").text.count("Nothing") == 2
    assert "No recording fits" in user.get("/experiments?text=nothing here").text


def test_everything_is_found_by_the_filters_of_the_command(user: Any, known: Catalog) -> None:
    known.add(
        entry(
            facts=(CatalogFact("maneuver", "cut_in_left", 2.0, HASH), CatalogFact("risk", "GT", 0.25, HASH))
        )
    )
    for query, count in (
        ("", 20), ("kind=recording", 3), ("kind=recording&maneuver=cut_in", 1), ("kind=recording&risk_above=0.2", 1),
        ("kind=recording&risk_below=0.2", 0), ("kind=recording&place=proving", 3), ("verdict=FAIL", 1),
        ("text=pilot", 5),
        ("kind=build&sort=name", 8), ("weather=fogdensity=excellent", 3),
        ("finding=speed", 1),
    ):  # fmt: skip
        text = user.get(f"/lake?{query}").text
        found = re.search(r"1 to \d+ of (\d+) things", text)
        assert (int(found[1]) if found else 0) >= count > 0 or (count, found) == (0, None), query
        assert "Nothing fits" in text or found
    (drive,) = re.findall(
        r'href="(/experiments/\w+)"', user.get("/lake?kind=recording&text=cut_in_brake").text
    )
    assert ">0.25<" in user.get(drive).text


def test_one_click_leads_from_a_result_to_all_it_came_from_and_back(
    supervisor: Any, user: Any, known: Catalog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted = {"build": "highway_pilot-1.0", "criteria": "highway"}
    files = {k: next(i for i in supervisor.files(k, most=20) if i.name == n) for k, n in wanted.items()}
    (drive,) = [i for i in supervisor.files("recording", most=20) if i.name == "cut_in_brake"]
    told = {"recording": drive, **files}
    inputs = tuple(CatalogInput(role, i.name, "", i.digest) for role, i in told.items())
    run = entry(folder=tmp_path, inputs=inputs)
    known.add(run)
    (tmp_path / "run.json").write_text("{}")
    monkeypatch.setattr("resim.results.asked.digest", lambda folder, kind: run.digest)
    options = {"recording": "", "build": "--build", "criteria": "--criteria"}
    asked = (AskedValue(options[role], i.folder, i.digest) for role, i in told.items())
    write_asked(AskedResults(("run",), (*asked, AskedValue("--set", "latency.speed=0.4"))), tmp_path)
    page = user.get(f"/results/{run.id}").text
    assert (
        f"resim run {drive.folder} --build {files['build'].folder} --criteria {files['criteria'].folder} "
        "--set latency.speed=0.4" in page
    )
    for item in told.values():
        (link,) = set(re.findall(rf'href="(/\w+/\w+)">{re.escape(item.name)}</a>', page))
        assert f"/results/{run.id}" in user.get(link).text, item
    assert user.get("/lake/nothing").status_code == 404


def test_a_sweep_leads_to_the_page_that_a_task_wrote_of_it(
    supervisor: Any, user: Any, known: Catalog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "swept_ä%").mkdir()
    monkeypatch.setattr("resim.results.entry.digest", lambda folder, kind: f"{1:064x}")  # its folder holds it
    sweep = entry("drives_ä%", kind="sweep", folder=tmp_path / "swept_ä%", host=supervisor.queue.host)
    known.add(sweep)
    assert f'href="/jobs/sweep-report?folder={sweep.id}"' in user.get(f"/results/{sweep.id}").text
    for k, folder in enumerate((sweep.folder, tmp_path / "swept_äx")):
        name = f"{k}" * 16
        (tmp_path / name).mkdir()
        (tmp_path / name / "late.html").touch()
        words = ("sweep", "report", f"--out={tmp_path / name / 'late.html'}", "--", str(folder))
        supervisor.queue.add(name, "sweep-report", words, str(tmp_path / name))
        assert supervisor.queue.end(supervisor.queue.claim("me"), "done", code=0)
    page = user.get(f"/results/{sweep.id}").text
    assert re.findall(r'href="/open/tasks/(\w+)/late.html"', page) == ["0" * 16]


def test_results_are_listed_filtered_and_paged(user: Any, known: Catalog) -> None:
    for day in range(1, 29):
        for k in range(2):
            verdict = "PASS" if k else "FAIL"
            known.add(entry("drive", day, digest=f"{day}{k}", verdict=verdict, outcomes=()))
    page = user.get("/results").text
    assert "1 to 50 of 56 results" in page
    link = re.search(r'href="([^"]+)" rel="next"', page)
    assert link is not None
    assert "51 to 56 of 56 results" in user.get(link[1].replace("&amp;", "&")).text
    assert "1 to 28 of 28 results" in user.get("/results?verdict=PASS&kind=run&text=pilot").text
    assert "No result fits" in user.get("/results?kind=sweep").text
    assert "No result fits" in user.get("/results?text=100%25").text


def test_what_is_never_judged_hides_no_verdict_on_the_dashboard(user: Any, known: Catalog) -> None:
    known.add(one := entry(), *(entry("mined", day, kind="mining", verdict="") for day in range(2, 12)))
    text = user.get("/").text
    assert f'href="/results/{one.id}"' in text.partition("Newest verdicts")[2]
    assert '<p class="big">11</p>' in text.partition("Catalog</h2>")[2]  # all results are counted


def test_what_is_never_judged_is_not_said_to_be_not_judged(user: Any, known: Catalog) -> None:
    told = {"verdict": "", "counts": {"scenarios": 1, "recordings": 2}, "outcomes": ()}
    known.add(one := entry("cut_in_brake", kind="mining", **told), entry("swept", 2, kind="sweep", **told))
    page = user.get("/results").text
    assert page.count("not judged") == 1
    assert "1 scenario, 2 recordings" in page
    assert "<td>mining</td>" in page
    assert "not judged" not in user.get(f"/results/{one.id}").text.partition("<h2>")[0]


def test_a_drive_shows_what_was_found_what_is_missing_and_what_runs(
    supervisor: Any, user: Any, known: Catalog
) -> None:
    nothing = cells(user.get("/experiments").text, "cut_in_brake")
    assert nothing == [
        ("done", "there"), ("missing", "not yet"), ("missing", "not yet"), ("missing", "not yet"),
        ("done", "there"), ("missing", "not yet"), ("missing", "not yet"),
    ]  # fmt: skip
    (drive,) = [f for f in supervisor.files("recording", most=9) if f.name == "cut_in_brake"]
    for path in ("/experiments?text=cut_in_brake", f"/experiments/{drive.id}"):
        for name in ("gt.csv", "sd.csv"):
            assert (
                f'href="/open/lake/{drive.id}/{name}" target="_blank" rel="noopener">there'
                in user.get(path).text
            )
    known.add(entry())
    told = cells(user.get("/experiments?text=cut_in_brake").text, "cut_in_brake")
    assert told == [
        ("done", "there"), ("good", "PASS"), ("bad", "FAIL"), ("missing", "not yet"),
        ("done", "there"), ("missing", "not yet"), ("unsure", "INVALID"),
    ]  # fmt: skip
    name = new_id()
    supervisor.queue.add(name, "run", ("run", "--", drive.folder), f"/tasks/{name}")
    assert cells(user.get("/experiments?state=waiting").text, "cut_in_brake")[2] == ("waiting", "waiting")
    task = supervisor.queue.claim("me")
    assert cells(user.get("/experiments?state=running").text, "cut_in_brake")[2] == ("running", "running")
    assert supervisor.queue.end(task, "failed", code=2, told="broken map")
    assert cells(user.get("/experiments").text, "cut_in_brake")[2] == ("bad", "error")
    page = user.get(f"/experiments/{drive.id}").text
    assert HASH[:16] in page
    assert f'href="/jobs/run?recording={drive.id}"' in page
    assert "broken map" in user.get("/").text


def test_a_drive_shows_a_verification_of_its_suite_that_waits_runs_or_failed(
    supervisor: Any, user: Any
) -> None:
    def told() -> dict[str, str]:
        text = user.get("/experiments").text
        return {name: cells(text, name)[3][1] for name in ("cut_in_brake", "overtake", "rear_end")}

    suite, name = ROOT / "scenarios" / "suites" / "highway.toml", new_id()
    supervisor.queue.add(name, "verify", ("verify", "--out=/x", "--", str(suite)), f"/tasks/{name}")
    waiting = {
        "cut_in_brake": "waiting",
        "overtake": "waiting",
        "rear_end": "not yet",
    }  # which is not in the suite
    assert told() == waiting
    task = supervisor.queue.claim("me")
    assert told() == {name: words.replace("waiting", "running") for name, words in waiting.items()}
    assert "overtake</a>" in user.get("/experiments?state=running").text
    assert "rear_end</a>" not in user.get("/experiments?state=running").text
    assert supervisor.queue.end(task, "failed", code=2, told="broken map")
    assert told() == {name: words.replace("waiting", "error") for name, words in waiting.items()}


def test_what_is_not_judged_hides_no_verdict(user: Any, known: Catalog) -> None:
    known.add(entry(day=1))
    unjudged = tuple(replace(o, verdict="", cause="") for o in entry().outcomes)
    known.add(entry(day=2, verdict="", counts={}, outcomes=unjudged))
    told = cells(user.get("/experiments").text, "cut_in_brake")
    assert told[2] == ("bad", "FAIL, then not judged")
    known.add(entry(day=3))
    assert cells(user.get("/experiments").text, "cut_in_brake")[2] == ("bad", "FAIL")


def test_a_result_of_other_content_is_not_taken_for_one_of_this_drive(
    supervisor: Any, user: Any, known: Catalog
) -> None:
    known.add(entry(inputs=(CatalogInput("recording", "cut_in_brake", "/other", "cd" * 32),)))
    assert [words for _, words in cells(user.get("/experiments").text, "cut_in_brake")].count("not yet") == 5


def test_a_comparison_of_builds_verifies_no_drive(supervisor: Any, user: Any, known: Catalog) -> None:
    told = CatalogOutcome("cut_in_brake", "pilot-1.1", verdict="same")
    known.add(entry(kind="verification", verdict="within limits", outcomes=(told,)))
    assert cells(user.get("/experiments").text, "cut_in_brake")[3] == ("missing", "not yet")
    known.add(entry(day=2, kind="verification", outcomes=(replace(told, verdict="not verified"),)))
    assert cells(user.get("/experiments").text, "cut_in_brake")[3] == ("bad", "not verified")


def test_two_builds_stand_side_by_side_the_worst_first(user: Any, known: Catalog) -> None:
    known.add(
        build("pilot-1.0", "aa" * 32, 1, {"a": "verified", "b": "not verified", "c": "verified", "d": ""})
    )
    known.add(
        build(
            "pilot-1.1",
            "bb" * 32,
            2,
            {"a": "verified", "b": "verified", "c": "not verified", "d": "verified"},
        )
    )
    ids = re.findall(r'name="one" value="(\w+)"', user.get("/builds").text)
    assert len(ids) == 2
    text = user.get("/builds/compare", params={"one": ids[0], "other": ids[1]}).text
    rows = re.findall(r"<tr><th><a [^>]*>(\w)</a></th>.*?>([\w ]+)</span></td></tr>", text, re.DOTALL)
    assert rows == [("c", "worse"), ("d", "not known"), ("a", "same"), ("b", "better")]
    page = user.get(f"/builds/{ids[0]}").text
    assert "pilot-1.0" in page
    assert "1 results" in page or "<dd>1</dd>" in page


def test_results_of_other_circumstances_are_no_pair(user: Any, known: Catalog) -> None:
    def compared() -> list[tuple[str, str, str]]:
        ids = re.findall(r'name="one" value="(\w+)"', user.get("/builds").text)
        text = user.get("/builds/compare", params={"one": ids[0], "other": ids[1]}).text
        row = r'<tr><th><a [^>]*>(\w)</a></th>.*?>([\w ]+)</span>(?: <span class="note">([^<]*)</span>)?</td></tr>'
        return re.findall(row, text, re.DOTALL)

    known.add(build("pilot-1.0", "aa" * 32, 1, {"a": "verified"}, seeds="0 to 19"))
    known.add(build("pilot-1.1", "bb" * 32, 2, {"a": "verified"}, criteria="lax cd", seeds="0 to 19"))
    told = "criteria: highway ab, lax cd"
    assert compared() == [("a", "not comparable", told)]
    known.add(build("pilot-1.1", "bb" * 32, 3, {"a": "not verified"}, seeds="0 to 19", resim="0.2"))
    assert compared() == [("a", "worse", "made with resim , 0.2")]
    known.add(build("pilot-1.1", "bb" * 32, 4, {"a": "verified"}, criteria="lax cd", seeds="0 to 19"))
    assert compared() == [("a", "worse", "made with resim , 0.2"), ("a", "not comparable", told)]
    known.add(replace(build("pilot-1.1", "bb" * 32, 5, {"a": "verified"}), facts=()))
    assert compared()[1][2] == "how one of them was made is not known"


@pytest.mark.parametrize(
    "path",
    [
        "/lake?kind=runs", "/lake?sort=DROP", "/lake?risk_above=abc", "/lake?risk_below=nan", "/lake?colour=red",
        "/lake?verdict=fine", "/results?kind=map", "/results?verdict=fine", "/results?first=x", "/experiments?state=zz",
        "/experiments?place=x", "/builds?label=x", "/tasks?state=done",
    ],
)  # fmt: skip
def test_filters_that_there_are_not_are_told(user: Any, path: str) -> None:
    answer = user.get(path)
    assert answer.status_code == 400
    assert "This cannot be looked for" in answer.text
    assert re.search(r"There are: |expected ", answer.text)


def test_what_cannot_be_read_is_offered_to_no_job(
    supervisor: Any, user: Any, known: Catalog, seal: str, tmp_path: Path
) -> None:
    shutil.copytree(DRIVE, tmp_path / "drives" / "lost")  # without its map
    register(known, [tmp_path / "drives"])
    (lost,) = find_page(known, LakeQuery("lost", ("recording",))).items
    assert lost.fault
    page = user.get(f"/experiments/{lost.id}").text
    assert "Nothing can be started with it, as it cannot be read" in page
    assert "/jobs/" not in page
    assert lost.id not in user.get("/jobs/run").text
    data = {"seal": seal, "recording": lost.id}
    answer = user.post("/jobs/check", data=data, headers={"origin": "http://127.0.0.1:8765"})
    assert answer.status_code == 422
    assert "cannot be used" in answer.text
    assert supervisor.queue.counts() == {}


def test_the_dashboard_shows_who_works(supervisor: Any, user: Any) -> None:
    for k, server in enumerate(("77@1.0", supervisor.worker.server)):
        supervisor.queue.add(f"{k}" * 16, "check", ("check",), "/tasks/x")
        supervisor.queue.claim(server)
    text = user.get("/").text
    assert "1 of 1" in text
    assert "1 other busy" in text
    rows = re.findall(r"process (\d+)(, this server)?</span></th><td[^>]*>([^<]*)</td>.*?<code>(\w+)", text)
    own = supervisor.worker.server.partition("@")[0]
    assert rows == [(own, ", this server", "1 of 1", "111111"), ("77", "", "1", "000000")]


def test_the_dashboard_shows_how_busy_the_cores_are_whichever_thread_asks(supervisor: Any, user: Any) -> None:
    assert "not known yet" in user.get("/").text
    stop, text = threading.Event(), ""

    def work() -> None:
        while not stop.is_set():
            pass

    worker = threading.Thread(target=work)
    worker.start()
    supervisor.changes.start()
    try:
        waited(lambda: supervisor.changes.busy)
        text = user.get("/").text
    finally:
        stop.set()
        supervisor.changes.stop()
        worker.join()
    assert int(re.findall(r"Cores</h2><p class=\"big\">(\d+) %", text)[0]) > 0


def test_crates_leave_nothing_behind(
    user: Any, known: Catalog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    left = tmp_path / "resim-crate-1@2.000-abc"  # of a server that was killed
    alive = tmp_path / f"resim-crate-{process_name()}-abc"
    for folder in (left, alive):
        (folder / "crate").mkdir(parents=True)
    (drive,) = find_page(known, LakeQuery("cut_in_brake", ("recording",))).items
    answer = user.get(f"/crate/{drive.id}")
    assert answer.status_code == 200
    assert zipfile.ZipFile(io.BytesIO(answer.content)).testzip() is None
    assert [*tmp_path.glob("resim-crate-*")] == [alive]


def test_what_goes_on_after_a_pause_is_said(supervisor: Any, user: Any) -> None:
    for job in ("verify", "run"):
        name = new_id()
        supervisor.queue.add(name, job, (job,), "/tasks/1")
        assert supervisor.queue.claim("me").id == name
        supervisor.queue.pause(name)
        assert supervisor.queue.put_aside(supervisor.queue.get(name))
    text = user.get("/tasks").text
    told = re.findall(r"<a [^>]*>(\w+) <code>[^§]*?class=\"note\">(.*?)</span>", text)
    assert sorted(told) == [("run", "it begins anew"), ("verify", "what it finished is kept")]


def test_a_verdict_for_another_reason_is_not_the_same(user: Any, known: Catalog) -> None:
    causes = {
        "pilot-1.0": ("distance", "sensor: 1 m"),
        "pilot-1.1": ("no collision, distance", "sensor: 2 m"),
    }
    for k, (label, (cause, detailed)) in enumerate(causes.items()):
        outcomes = (
            CatalogOutcome("a", label, "rGT", "FAIL", cause),
            CatalogOutcome("b", label, "rGT", "FAIL", detailed),
        )
        drives = [CatalogInput("recording", name, "", f"{name:0>64}") for name in "ab"]
        inputs = (*drives, CatalogInput("build", label, "", f"{k}{k}" * 32))
        one = entry(label, k + 1, verdict="FAIL", counts={"FAIL": 2}, inputs=inputs, outcomes=outcomes)
        known.add(replace(one, facts=(made_with(),)))
    ids = re.findall(r'name="one" value="(\w+)"', user.get("/builds").text)
    text = user.get("/builds/compare", params={"one": ids[0], "other": ids[1]}).text
    rows = re.findall(r"<tr><th><a [^>]*>(\w)</a></th>.*?>([\w ]+)</span></td></tr>", text, re.DOTALL)
    assert rows == [("a", "changed"), ("b", "same")]


def test_names_of_others_are_never_markup(supervisor: Any, user: Any, known: Catalog) -> None:
    label, one = f"pilot{EVIL}", entry(EVIL)
    hostile = entry(
        EVIL, 2, verdict=EVIL, counts={EVIL: 1}, inputs=(*one.inputs, CatalogInput("build", label, EVIL, EVIL)),
        outcomes=(CatalogOutcome(EVIL, label, EVIL, EVIL, EVIL),), folder=Path("/results") / EVIL, host=EVIL,
    )  # fmt: skip
    known.add(hostile)
    name = new_id()
    supervisor.queue.add(name, EVIL, (EVIL, f"/x/{EVIL}"), f"/tasks/{EVIL}")
    supervisor.queue.end(supervisor.queue.claim("me"), "failed", told=EVIL)
    pages = ["/", "/results", f"/results/{hostile.id}", "/builds", "/experiments", "/tasks", f"/tasks/{name}"]
    builds = re.findall(r'name="one" value="(\w+)"', user.get("/builds").text)
    pages += [f"/builds/{b}" for b in builds] + [
        f"/lake?text={EVIL}",
        f"/builds/compare?one={builds[0]}&other={builds[1]}",
    ]
    for page in pages:
        answer = user.get(page)
        assert answer.status_code == 200, page
        assert EVIL not in answer.text, page
    assert "&lt;script&gt;" in user.get("/results").text


def test_documents_open_in_an_origin_of_their_own(
    user: Any, client: Any, known: Catalog, tmp_path: Path
) -> None:
    folder = tmp_path / "out"
    (folder / "reports").mkdir(parents=True)
    (folder / "report.html").write_text(f"<p>{EVIL}")
    (folder / "reports" / "a.html").write_text("a")
    (folder / "run.json").write_text("{}")
    one = entry(folder=folder, host=platform.node())
    known.add(one)
    page = user.get(f"/results/{one.id}").text
    assert f'href="/open/results/{one.id}/report.html"' in page
    answer = user.get(f"/open/results/{one.id}/report.html")
    assert answer.status_code == 303
    client.cookies.clear()
    document = client.get(answer.headers["location"])
    assert document.status_code == 200
    assert EVIL in document.text
    policy = document.headers["content-security-policy"]
    assert policy.startswith("sandbox allow-scripts")
    assert "allow-same-origin" not in policy
    beside = answer.headers["location"].replace("report.html", "reports/a.html")
    assert client.get(beside).text == "a"
    assert client.get(answer.headers["location"].replace(one.id, entry(day=2).id)).status_code in (403, 404)
    assert client.get(re.sub(r"/pages/\d", "/pages/9", answer.headers["location"])).status_code == 403
    assert client.get(re.sub(r"/pages/[^/]+/", "/pages/x/", answer.headers["location"])).status_code == 403
    assert client.get(f"/open/results/{one.id}/report.html").status_code == 401


def test_a_folder_that_holds_no_result_is_not_read(user: Any, known: Catalog, tmp_path: Path) -> None:
    (tmp_path / "private.json").write_text("{}")
    one = entry(folder=tmp_path, host=platform.node())
    known.add(one)
    assert user.get(f"/open/results/{one.id}/private.json").status_code == 404
    assert "private.json" not in user.get(f"/results/{one.id}").text


@pytest.mark.parametrize(
    "name",
    [
        "../secret.json", "..", ".", "", "/etc/passwd", "a/../../secret.json", "link.json", "inside/x.json",
        ".hidden.json", "run", "run.json/", "run.json\0", "run.sh", "a\\b.json", "folder.json", "x" * 5000 + ".json",
    ],
)  # fmt: skip
def test_no_document_leads_out_of_its_folder(tmp_path: Path, name: str) -> None:
    from resim.core.errors import InputError

    folder = tmp_path / "out"
    (folder / "folder.json").mkdir(parents=True)
    (tmp_path / "secret.json").write_text("secret")
    (tmp_path / "x.json").write_text("secret")
    (folder / "run.json").write_text("{}")
    (folder / "run.sh").write_text("x")
    (folder / ".hidden.json").write_text("{}")
    (folder / "link.json").symlink_to(tmp_path / "secret.json")
    (folder / "inside").symlink_to(tmp_path)
    assert find_document(folder, "run.json").path == folder / "run.json"
    with pytest.raises(InputError, match="is no file of this folder"):
        find_document(folder, name)


def test_a_result_whose_folder_became_a_link_is_not_here(tmp_path: Path) -> None:
    real, folder = tmp_path / "elsewhere", tmp_path / "result"
    real.mkdir()
    (real / KINDS["run"][0]).write_text("{}")
    catalog = SimpleNamespace(entries=lambda ids: [SimpleNamespace(folder=folder, kind="run")])
    folder.symlink_to(real)
    with pytest.raises(MissingError, match="is not here"):
        result_folder(SimpleNamespace(catalog=catalog), "a")  # type: ignore[arg-type]


def test_verdicts_that_are_not_known_are_never_good() -> None:
    assert [tone(v) for v in ("PASS", "FAIL", "INVALID", "failed", "", "new word")] == [
        "pass", "fail", "invalid", "failed", "none", "none"
    ]  # fmt: skip
    assert [size(v) for v in (0, 999, 1.5e6, 2e15)] == ["0 B", "999 B", "1.5 MB", "2e+03 TB"]


def test_pages_of_many_drives_and_results_come_soon(supervisor: Any, user: Any, known: Catalog) -> None:
    from sqlalchemy import insert

    from resim.results.tables import INPUT, ITEM, OUTCOME

    n = 3000
    with known.connected() as connection, connection.begin():
        told = {
            "kind": "run",
            "host": "h",
            "digest": "d",
            "resim": "0",
            "verdict": "PASS",
            "counts": {},
            "files": {},
            "fault": "",
        }
        connection.execute(insert(ITEM), [
            {**told, "id": f"{k:016x}", "name": f"d{k}", "folder": f"/r/{k}",
             "written": f"2026-01-01T00:00:00.{k:06}+00:00"} for k in range(n)
        ])  # fmt: skip
        connection.execute(insert(INPUT), [
            {"item": f"{k:016x}", "row": 0, "role": "recording", "name": f"d{k}", "path": "", "hash": f"{k:064x}"}
            for k in range(n)
        ])  # fmt: skip
        connection.execute(insert(OUTCOME), [
            {"item": f"{k:016x}", "row": 0, "recording": f"d{k}", "hash": f"{k:064x}",
             "build": "", "source": "rGT", "verdict": "PASS",
             "cause": ""} for k in range(n)
        ])  # fmt: skip
    user.get("/experiments")
    for path in (
        "/experiments?text=d2",
        "/experiments?state=good&first=2000",
        "/results?text=d2",
        "/results?first=2900",
    ):
        begin = time.monotonic()
        answer = user.get(path)
        assert answer.status_code == 200
        assert len(answer.text) < 120_000  # of thousands, one page
        assert time.monotonic() - begin < 5.0  # it does not hang; docs/validation.md has figures


def test_a_recording_with_its_map_is_downloaded_as_a_crate_by_those_who_may_run(
    supervisor: Any, user: Any, tmp_path: Path
) -> None:
    (drive,) = [i for i in supervisor.files("recording", most=20) if i.name == "cut_in_brake"]
    assert f'href="/crate/{drive.id}"' in user.get(f"/experiments/{drive.id}").text
    answer = user.get(f"/crate/{drive.id}")
    assert (answer.status_code, answer.headers["content-type"]) == (200, "application/zip")
    assert "attachment" in answer.headers["content-disposition"]
    (tmp_path / "crate.zip").write_bytes(answer.content)
    with zipfile.ZipFile(tmp_path / "crate.zip") as archive:
        archive.extractall(tmp_path / "crate")
    (found,) = (tmp_path / "crate").rglob("recording.toml")
    assert (found.parent / "gt.csv").read_bytes() == (DRIVE / "gt.csv").read_bytes()
    assert user.get(f"/crate/{drive.id}").status_code == 200  # the first one left nothing locked
    assert user.get("/crate/nothing").status_code == 404
    known = Catalog(supervisor.catalog.name)
    known.add(gone := entry())
    assert user.get(f"/crate/{gone.id}").status_code == 409  # its folder is on another machine
    user.cookies.clear()
    user.get("/", params={"token": supervisor.access.tokens["look"]})
    assert user.get(f"/crate/{drive.id}").status_code == 403
    assert "/crate/" not in user.get(f"/experiments/{drive.id}").text


def test_code_in_help_is_shown_as_code_and_markup_never_is() -> None:
    from resim.supervisor.words import coded

    assert coded("what `resim <b>` wrote") == "what <code>resim &lt;b&gt;</code> wrote"
    assert coded("one ` <b>") == "one ` &lt;b&gt;"


def test_one_click_leads_to_the_traces_of_a_run_above_others(
    user: Any, known: Catalog, tmp_path: Path
) -> None:
    for name in ("1", "2"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "run.json").write_text("{}")
    runs = [entry(day=day, folder=tmp_path / str(day), host=platform.node()) for day in (1, 2)]
    known.add(*runs)
    (link,) = re.findall(r'href="(/jobs/play[^"]*)">Above others', user.get(f"/results/{runs[0].id}").text)
    form = user.get(link.replace("&amp;", "&")).text
    assert f'value="{runs[0].id}" selected' in form
    assert f'value="{runs[1].id}" selected' not in form
    assert re.search(r'name="together".*?<option selected>yes', form)
    for day, run in enumerate(runs, start=1):  # told apart
        assert (
            f'value="{run.id}"{" selected" if day == 1 else ""}>run cut_in_brake, 2026-11-0{day} 05:00:00, pilot-1.0<'
            in form
        )


def test_moments_at_which_criteria_were_not_met_open_the_player_there(
    user: Any, known: Catalog, tmp_path: Path
) -> None:
    import duckdb

    one = entry(folder=tmp_path, host=platform.node())
    (tmp_path / "run.json").write_text("{}")
    (tmp_path / "report.html").write_text("")
    duckdb.execute(
        "COPY (SELECT 'rGT' AS source, 'distance' AS name, 'FAIL' AS verdict, 7.5 AS t, '1' AS object,"
        f" 'too near' AS reason, 0.5 AS value) TO '{tmp_path / 'kpis.parquet'}' (FORMAT parquet)"
    )
    known.add(one)
    assert f'href="/open/results/{one.id}/report.html#t=7.50"' in user.get(f"/results/{one.id}").text
    (tmp_path / "kpis.parquet").write_bytes(b"PAR1")  # damaged: there is no table
    assert "When criteria" not in user.get(f"/results/{one.id}").text


@pytest.fixture
def registered(supervisor: Any, tmp_path: Path) -> Path:
    """A folder of its own with a drive, a map and a suite, which are in the lake."""
    from resim.results.scanning import scan

    home = tmp_path / "registered"
    shutil.copytree(DRIVE, home / "scenarios" / "drive")
    (home / "networks").mkdir()
    shutil.copy(ROOT / "networks" / "proving_ground.xodr", home / "networks")
    told = (home / "scenarios" / "drive" / "recording.toml").read_text()
    (home / "scenarios" / "drive" / "recording.toml").write_text(told.replace("../../", f"{home}/"))
    (home / "page.html").write_text(f"<p>{EVIL}")
    suite = 'name = "ours"\ncriteria = "highway.toml"\n[[recording]]\nfolder = "scenarios/drive"\n'
    (home / "suite.toml").write_text(suite)
    scan(supervisor.catalog, [home])
    return home


def known_at(supervisor: Any, path: Path) -> Any:
    from resim.results.lake import items_below

    (one,) = [i for i in items_below(supervisor.catalog, str(path), most=9) if i.folder == str(path)]
    return one


def test_what_is_named_without_a_hash_leads_to_what_lies_there(
    supervisor: Any, user: Any, registered: Path
) -> None:
    drive = known_at(supervisor, registered / "scenarios" / "drive")
    road = known_at(supervisor, registered / "networks" / "proving_ground.xodr")
    suite = user.get(f"/lake/{known_at(supervisor, registered / 'suite.toml').id}").text
    assert f'<a href="/experiments/{drive.id}"><code>{drive.folder}</code></a>' in suite
    page = user.get(f"/experiments/{drive.id}").text
    assert re.search(r'<a href="/lake/\w+">proving_ground</a>', page)
    assert f'href="/lake?{"kind=map"}&amp;text=proving_ground"' in user.get("/lake?kind=recording").text
    assert f'href="/jobs/map-check?path={road.id}"' in user.get(f"/lake/{road.id}").text


def test_files_of_a_drive_are_opened_from_its_page(
    supervisor: Any, user: Any, client: Any, registered: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = registered / "scenarios" / "drive"
    (tmp_path / "secret.csv").write_text("secret")
    for name, text in (
        ("page.html", f"<p>{EVIL}"),
        ("run.sh", "x"),
        (".hidden.csv", "x"),
        ("big.csv", "x" * 9000),
    ):
        (folder / name).write_text(text)
    (folder / "trace.osi").write_bytes(b"\0")
    (folder / "link.csv").symlink_to(tmp_path / "secret.csv")
    (folder / "way").symlink_to(tmp_path)
    os.mkfifo(folder / "pipe.csv")
    drive = known_at(supervisor, folder)
    page = user.get(f"/experiments/{drive.id}").text
    listed = set(re.findall(rf'href="/open/lake/{drive.id}/([^"]+)"', page))
    assert listed == {"recording.toml", "gt.csv", "sd.csv", "plan.csv", "page.html", "big.csv", "trace.osi"}
    monkeypatch.setattr("resim.supervisor.documents.SHOWN", 8000)
    for name, kind, kept in (
        ("recording.toml", "text/plain; charset=utf-8", False), ("big.csv", "text/plain; charset=utf-8", True),
        ("page.html", "text/html; charset=utf-8", False), ("trace.osi", "application/octet-stream", True),
    ):  # fmt: skip
        answer = client.get(user.get(f"/open/lake/{drive.id}/{name}").headers["location"])
        assert answer.content == (folder / name).read_bytes()
        assert answer.headers["content-type"] == kind
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert ("attachment" in answer.headers.get("content-disposition", "")) is kept
        assert answer.headers["content-security-policy"].startswith("sandbox allow-scripts")
        assert "allow-same-origin" not in answer.headers["content-security-policy"]
    for name in (
        "link.csv", "way/secret.csv", ".hidden.csv", "run.sh", "pipe.csv", "%2e%2e/suite.toml",
        "..%2fsuite.toml", "gt.csv%00", "", "/etc/passwd", "gt.csv/", "x" * 3000 + ".csv",
    ):  # fmt: skip
        assert user.get(f"/open/lake/{drive.id}/{name}").status_code in (400, 404), name


def test_of_a_file_in_the_lake_that_one_alone_is_opened(
    supervisor: Any, user: Any, client: Any, registered: Path, tmp_path: Path
) -> None:
    road = known_at(supervisor, registered / "networks" / "proving_ground.xodr")
    (registered / "networks" / "other.xodr").write_text("secret")
    answer = client.get(user.get(f"/open/lake/{road.id}/proving_ground.xodr").headers["location"])
    assert answer.headers["content-type"].startswith("text/plain")
    assert user.get(f"/open/lake/{road.id}/other.xodr").status_code == 404
    assert user.get(f"/open/lake/{'0' * 16}/proving_ground.xodr").status_code == 404
    shutil.move(registered / "networks", tmp_path / "networks")
    (registered / "networks").symlink_to(tmp_path / "networks")  # by now it leads out
    assert user.get(f"/open/lake/{road.id}/proving_ground.xodr").status_code == 404
    assert "/open/lake/" not in user.get(f"/lake/{road.id}").text
