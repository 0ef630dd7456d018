"""`resim tasks` steers the queue as the pages do, and `resim lake compare` compares builds as they do."""

from __future__ import annotations

import json
import os
import pwd
import shlex
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from conftest import Call

from resim.cli.task_calls import task_call
from resim.results.catalog import Catalog
from resim.results.database import data_folder
from resim.results.entry import CatalogEntry, CatalogFact, CatalogInput, CatalogOutcome
from resim.results.queue import TaskQueue

ROOT = Path(__file__).parents[2]


@pytest.fixture
def catalog(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Catalog:
    monkeypatch.setenv("RESIM_CATALOG", str(tmp_path / "catalog.sqlite"))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    return Catalog(str(tmp_path / "catalog.sqlite"))


def order(call: Call) -> list[tuple[str, str]]:
    code, out, _ = call("tasks", "list", "--json")
    assert code == 0
    return [(one["id"][:4], one["state"]) for one in json.loads(out)["tasks"]]


def test_tasks_are_listed_and_steered(catalog: Catalog, call: Call) -> None:
    assert "no tasks" in call("tasks", "list")[1]
    queue = TaskQueue(catalog)
    for name in ("aaaa0000aaaa0000", "bbbb0000bbbb0000", "cccc0000cccc0000"):
        queue.add(name, "check", ("check", "--", "/drives/cut_in"), f"/tasks/{name}")
    for words, expected in (
        (("first", "cccc"), ["cccc", "aaaa", "bbbb"]), (("earlier", "bbbb0"), ["cccc", "bbbb", "aaaa"]),
        (("later", "cccc"), ["bbbb", "cccc", "aaaa"]),
    ):  # fmt: skip
        assert call("tasks", *words)[0] == 0
        assert [name for name, _ in order(call)] == expected
    assert "aaaa00 check cut_in: paused" in call("tasks", "pause", "aaaa")[1]
    assert "aaaa00 check cut_in: waiting" in call("tasks", "resume", "aaaa")[1]
    assert "bbbb00 check cut_in: cancelled" in call("tasks", "cancel", "bbbb")[1]
    assert ("bbbb", "cancelled") in order(call)
    assert "bbbb00 check cut_in: waiting" in call("tasks", "retry", "bbbb")[1]
    for words, why in (
        (("resume", "aaaa"), "is not paused: it is waiting"), (("retry", "aaaa"), "has not ended"),
        (("cancel", "dddd"), "is no task"), (("cancel", "aa"), "4 or more digits"), (("cancel", "%___"), "is no task"),
    ):  # fmt: skip
        code, _, err = call("tasks", *words)
        assert (code, why in " ".join(err.split())) == (2, True), (words, err)


def test_tasks_of_a_higher_priority_come_first(catalog: Catalog, call: Call) -> None:
    queue = TaskQueue(catalog)
    for name in ("aaaa0000aaaa0000", "bbbb0000bbbb0000", "cccc0000cccc0000"):
        queue.add(name, "check", ("check",), f"/tasks/{name}")
    for words, expected in (
        (("priority", "cccc", "high"), "cab"), (("priority", "aaaa", "low"), "cba"), (("pause", "cccc"), "cba"),
        (("priority", "cccc", "low"), "cba"), (("resume", "cccc"), "bac"), (("first", "cccc"), "cba"),
        (("priority", "aaaa", "high"), "acb"), (("priority", "aaaa", "normal"), "cab"),
    ):  # fmt: skip
        assert call("tasks", *words)[0] == 0
        assert "".join(name[0] for name, _ in order(call)) == expected, words
    claimed = [queue.claim("server") for _ in range(3)]
    assert [one and one.id[0] for one in claimed] == ["c", "a", "b"]
    assert call("tasks", "priority", "aaaa", "high")[0] == 2  # it runs
    assert call("tasks", "priority", "aaaa", "soon")[0] == 2


def words_of(call: Call, *words: object) -> list[str]:
    code, out, err = call("tasks", "add", *words)
    assert code == 0, err
    found = json.loads(call("tasks", "list", "--json")[1])["tasks"]
    told: list[str] = max(found, key=lambda one: out.startswith(one["id"][:6]))["command"]
    return told


def test_a_command_is_put_into_the_queue(
    catalog: Catalog, call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(ROOT / "scenarios" / "cut_in_brake", "drives/a b")
    for shipped in ("adfunc", "networks"):
        shutil.copytree(ROOT / shipped, shipped)
    Path("traffic.json").write_text("{}", "utf-8")
    home, here, build = data_folder() / "tasks", str(tmp_path), "adfunc/builds/highway_pilot-1.0.toml"
    words = words_of(
        call, "--priority", "high", "run", "drives/a b", "--seed=7", "--build", build, "--no-stop-at-collision",
        "--traffic", "traffic.json",
    )  # fmt: skip
    (task,) = TaskQueue(catalog).unfinished()
    assert (task.job, task.priority, task.folder) == ("run", 1, str(home / task.id))
    assert (words[0], words[-2:]) == ("run", ["--", f"{here}/drives/a b"])
    assert {*words[1:-2]} == {
        f"--out={home / task.id / 'a_b'}", "--seed=7", f"--build={here}/{build}", "--no-stop-at-collision",
        f"--traffic={here}/traffic.json",
    }  # fmt: skip
    sweep = ROOT / "scenarios/sweeps/perception_latency.toml"
    for given, called in (  # as forms call results
        (("suite", "new", "drives/a b", "--criteria", ROOT / "scenarios/criteria/highway.toml"), "a_b.toml"),
        (("play", "drives/a b"), "a_b.html"),
        (("sweep", "run", sweep), "perception_latency"), (("mine", "drives/a b", "--out", "b"), "b"),
    ):  # fmt: skip
        (out,) = (Path(w.removeprefix("--out=")) for w in words_of(call, *given) if w.startswith("--out="))
        assert out.name == called
    for given, job in (
        (("check", "drives/a b"), "check"), (("check", "drives/a b", "--fix", "b"), "repair"),
        (("verify", "--replay", "v"), "replay"),
        (("verify", ROOT / "scenarios/suites/highway.toml", "--build", build), "verify"),
        (("sweep", "run", sweep), "sweep"), (("sweep", "run", "--dry-run", sweep), "sweep-estimate"),
        (("sweep", "run", sweep, "--dry-run"), "sweep-estimate"),
        (("export", "osi", "drives/a b"), "export-osi"),
        (("import", "mcity", "drives"), "import-mcity"), (("space", "grow", "a", "b"), "space-grow"),
    ):  # fmt: skip
        words_of(call, *given)
        task = TaskQueue(catalog).unfinished()[-1]
        assert task.job == job
        assert (
            task_call(replace(task, attempt=2).call, tmp_path)[0].name == job
        )  # a further attempt can be made
    trail = (data_folder() / "audit.jsonl").read_text().splitlines()
    assert json.loads(trail[1])["action"] == "/jobs/run"
    assert json.loads(trail[1])["form"] == [["command", f"run {shlex.join(words[1:])}"], ["priority", "high"]]
    count = len(TaskQueue(catalog).unfinished())
    for given, why in (
        (("frob", "a"), "is no job of tasks"), (("run",), "Missing argument"), (("serve",), "is no job of tasks"),
        (("run", "drives/a b", "--sed", "1"), "--seed"), (("run", "drives/a b", "--seed", "x"), "--seed"),
    ):  # fmt: skip
        code, _, err = call("tasks", "add", *given)
        assert (code, why in " ".join(err.split())) == (2, True), (given, err)
    assert len(TaskQueue(catalog).unfinished()) == count


def test_the_log_of_a_task_is_printed(catalog: Catalog, call: Call, tmp_path: Path) -> None:
    name = "aaaa0000aaaa0000"
    TaskQueue(catalog).add(name, "check", ("check",), str(tmp_path))
    code, _, err = call("tasks", "log", "aaaa")
    assert (code, "It is waiting, and done on" in " ".join(err.split())) == (2, True)
    (tmp_path / "log.txt").write_bytes(b"$ resim check\n\xff\x1b[2Jdone\n")
    code, out, _ = call("tasks", "log", "aaaa")
    assert (code, out.splitlines()[0], "\x1b" in out) == (0, "$ resim check", False)


def test_who_steers_in_the_terminal_is_in_the_trail(
    catalog: Catalog, call: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = "aaaa0000aaaa0000"
    TaskQueue(catalog).add(name, "check", ("check",), f"/tasks/{name}")
    monkeypatch.setenv("LOGNAME", "somebody")
    assert [call("tasks", act, "aaaa")[0] for act in ("pause", "retry")] == [0, 2]
    assert call("users", "add", "anna", "--role", "run")[0] == 0
    trail = data_folder() / "audit.jsonl"
    lines = [json.loads(line) for line in trail.read_text().splitlines()]
    assert {(line["user"], line["client"]) for line in lines} == {
        (pwd.getpwuid(os.getuid()).pw_name, "terminal")
    }
    assert [(line["action"], line["outcome"].split(":")[0]) for line in lines] == [
        (f"/tasks/{name}/pause", "asked"), (f"/tasks/{name}/pause", "done"), (f"/tasks/{name}/retry", "asked"),
        (f"/tasks/{name}/retry", "refused"), ("/users/add", "asked"), ("/users/add", "done"),
    ]  # fmt: skip
    code, out, _ = call("users", "trail", "--most", 2)
    told = out.splitlines()
    assert (code, len(told), "/users/add  name=anna role=run: done" in told[0]) == (0, 2, True)
    trail.unlink()
    assert call("users", "trail")[1].strip() == "nobody did anything yet"
    trail.mkdir()  # what cannot be noted is not done
    code, _, err = call("tasks", "resume", "aaaa")
    assert (code, "cannot be written" in " ".join(err.split())) == (2, True)
    assert TaskQueue(catalog).get(name).state == "paused"


def test_builds_are_compared_under_equal_circumstances(catalog: Catalog, call: Call) -> None:
    def result(label: str, day: int, verdict: str, criteria: str) -> None:
        inputs = (
            CatalogInput("recording", "cut_in", "", "cd" * 32),
            CatalogInput("build", label, "", label[-1] * 64),
        )
        one = CatalogEntry("run", "cut_in", Path(f"/r/{day}"), "h", f"2026-11-0{day}T05:00:00+00:00", f"{day}", "0.1",
                           verdict)  # fmt: skip
        outcome = CatalogOutcome("cut_in", label, "rGT", verdict)
        made = CatalogFact("circumstances", json.dumps({"criteria": criteria}))
        catalog.add(replace(one, inputs=inputs, outcomes=(outcome,), facts=(made,)))

    def compared(*builds: str) -> Any:
        code, out, _ = call("lake", "compare", *builds, "--json")
        assert code == 0
        return [(pair["change"], pair["differs"]) for pair in json.loads(out)["pairs"]]

    result("pilot-1", 1, "PASS", "highway")
    result("pilot-2", 2, "FAIL", "strict")
    assert compared("pilot-1", "pilot-2") == [("not comparable", ["criteria: highway, strict"])]
    result("pilot-2", 3, "FAIL", "highway")
    assert compared("pilot-1", "2222") == [("worse", [])]
    assert "worse: cut_in, run rGT: PASS and FAIL" in call("lake", "compare", "pilot-1", "pilot-2")[1]
    assert [line.split()[1] for line in call("lake", "builds")[1].splitlines()] == ["pilot-1", "pilot-2"]
    code, _, err = call("lake", "compare", "pilot-1", "pilot-3")
    assert (code, "is no build that a result names" in err) == (2, True)
