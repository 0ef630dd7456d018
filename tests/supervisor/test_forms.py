"""What is filled in becomes a command line, and nothing else."""

from __future__ import annotations

import inspect
import json
import re
import stat
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from supervised import waited
from typer.main import get_group

from resim.cli.app import app
from resim.cli.job_forms import job_forms
from resim.cli.offered import NOT_OFFERED, OFFERED
from resim.core.errors import InputError
from resim.results.queue import new_id
from resim.results.scanning import add_roots
from resim.supervisor.files import file_id
from resim.supervisor.forms import FormError, FormField, JobForm, command_line

ROOT = Path(__file__).parents[2]
ORIGIN = "http://127.0.0.1:8765"
FORM = JobForm(
    "run", ("run",), "", (
        FormField("recording", "", "file", of=("recording",), required=True),
        FormField("drives", "", "file", of=("recording",), many=True),
        FormField("step", "", "number", "--step", low=0.001),
        FormField("seeds", "", "whole", "--seeds", low=1, high=1000),
        FormField("basis", "", "choice", "--basis", choices=("gt", "sd")),
        FormField("stop", "", "flag", "--stop", "--no-stop", default="yes"),
        FormField("settings", "", "text", "--set", many=True),
        FormField("pose", "", "number", "--pose", size=3),
        FormField("traffic", "", "choice", "--traffic", patterns=("*.toml",), choices=("traces",)),
        FormField("report", "", "page", "--report", "report.html", default="no"),
        FormField("result_name", "", "name"),
    ), "--out",
)  # fmt: skip


def path_of(name: str, field: FormField) -> Path:
    if name != "1" or not field.has_files:
        raise InputError(name, "is none")
    return Path("/drives/cut -in")


def line(*given: tuple[str, str]) -> list[str]:
    return command_line(FORM, given, path_of, Path("/tasks/7"))


def test_what_is_filled_in_becomes_a_command_line() -> None:
    given = [
        ("recording", "1"),
        ("step", "0.02"),
        ("basis", "sd"),
        ("stop", "no"),
        ("settings", "a=1\nb=2\n"),
    ]
    assert line(*given, ("seeds", "")) == [
        "run", "--step=0.02", "--basis=sd", "--no-stop", "--set=a=1", "--set=b=2", "--out=/tasks/7/cut_-in", "--",
        "/drives/cut -in",
    ]  # fmt: skip
    assert line(("recording", "1"), ("stop", "yes")) == [
        "run",
        "--out=/tasks/7/cut_-in",
        "--",
        "/drives/cut -in",
    ]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("recording", ""), ("recording", "/etc/passwd"), ("recording", "../1"), ("step", "0"), ("step", "nan"),
        ("step", "inf"), ("step", "1;rm -rf /"), ("seeds", "1.5"), ("seeds", "1001"), ("seeds", "0x10"),
        ("basis", "both; x"), ("stop", "--gui"), ("settings", "a\x00b"), ("settings", "x" * 301), ("out", "/etc"),
        ("pose", "1 2"), ("pose", "1 2 --out=/etc"), ("pose", "1 2 3 4"), ("traffic", "/etc/passwd"),
        ("report", "/etc/page.html"), ("report", "../x"), ("result_name", "../x"), ("result_name", ".x"),
        ("result_name", "a/b"), ("result_name", "-x"), ("result_name", "log.txt"), ("result_name", "lock"),
        ("result_name", "x" * 61), ("result_name", "ä"), ("result_name", "a b"),
        ("gui", "yes"), ("step", "--out=/etc"), ("settings", "\n".join(["a=1"] * 300)), ("step", "1e400"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused(name: str, value: str) -> None:
    given = [("recording", "1")] * (name != "recording") + [(name, value)]
    with pytest.raises((FormError, InputError)):
        line(*given)


def test_numbers_files_beside_words_pages_and_names() -> None:
    more = [("pose", "1 -2.5 0"), ("traffic", "1"), ("report", "yes"), ("result_name", "mine")]
    assert line(("recording", "1"), *more) == [
        "run", "--pose", "1", "-2.5", "0", "--traffic=/drives/cut -in", "--report=/tasks/7/report.html",
        "--out=/tasks/7/mine", "--", "/drives/cut -in",
    ]  # fmt: skip
    assert "--traffic=traces" in line(("recording", "1"), ("traffic", "traces"), ("report", "no"))
    assert FORM.result(line(("recording", "1"), ("result_name", "mine"))) == Path("/tasks/7/mine")


def test_no_value_becomes_an_option() -> None:
    found = line(("recording", "1"), ("settings", "--out=/etc\n-v"))
    assert found[1:3] == ["--set=--out=/etc", "--set=-v"]
    assert found[-2:] == ["--", "/drives/cut -in"]


def test_the_forms_have_the_parameters_of_their_commands() -> None:
    forms = {form.name: form for form in job_forms()}
    assert set(forms) == set(OFFERED)
    run = {f.name: f for f in forms["run"].fields}
    assert (run["recording"].of, run["recording"].required, run["recording"].option) == (
        ("recording",),
        True,
        "",
    )
    assert (run["seeds"].kind, run["seeds"].low, run["seeds"].high) == ("whole", 1, 1000)
    assert run["basis"].choices == ("gt", "sd", "both")
    assert (run["settings"].option, run["settings"].many) == ("--set", True)
    assert (run["stop_at_collision"].off, run["stop_at_collision"].default) == (
        "--no-stop-at-collision",
        "yes",
    )
    assert forms["sweep"].words == ("sweep", "run")
    assert {f.name for f in forms["verify"].fields if f.required} == {"suite", "build"}


def test_no_text_of_a_page_can_be_a_path() -> None:
    texts = {(form.name, f.name) for form in job_forms() for f in form.fields if f.kind == "text"}
    names = {name for _, name in texts}
    assert names == {
        "settings",
        "accept",
        "vary",
        "driven_by",
        "around",
        "objects",
        "maneuvers",
        "ego",
        "trial",
        "kind",
    }  # look at new ones


HELPERS = {
    "given": "what jobs are given", "labelled": "maneuvers of a drive that is played",
    "driven_traffic": "part of traffic", "space_members": "part of space", "space_recordings": "part of space",
    "space_drives": "part of space",
    "verdicts": "words of verdicts", "schemas": "JSON Schemas of files, for editors",
    "lake": "the lake: pages find and show", "mirror": "sends results to a server of MLflow",
    "chain": "a download of each page", "builds": "two builds side by side: a page shows that",
    "tasks": "what the buttons of tasks do",
}  # fmt: skip
"""Modules of `resim.jobs` without a form, and why."""


def commands(group: Any, words: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    if not hasattr(group, "commands"):
        yield words
    for name, one in getattr(group, "commands", {}).items():
        yield from commands(one, (*words, name))


def test_every_command_has_a_form_or_a_reason_for_none() -> None:
    known = set(commands(get_group(app)))
    offered = {tuple(w for w in one.words if not w.startswith("--")) for one in OFFERED.values()}
    reasons = {words for words in known if any(words[: len(no)] == no for no in NOT_OFFERED)}
    assert offered | reasons == known
    assert not offered & reasons
    assert all(any(words[: len(no)] == no for words in known) for no in NOT_OFFERED)


def test_every_job_is_one_of_a_command_with_a_form() -> None:
    offering = {inspect.getmodule(one.job).__name__ for one in OFFERED.values()}  # type: ignore[union-attr]
    sources = "".join(Path(import_module(name).__file__ or "").read_text() for name in offering)
    jobs = {path.stem for path in (ROOT / "resim" / "jobs").glob("[a-z]*.py")}
    called = {
        j for j in jobs if re.search(rf"from resim\.jobs(\.{j} import| import ([\w ,]+, )?{j}\b)", sources)
    }
    assert jobs <= called | set(HELPERS)
    assert set(HELPERS) <= jobs


def test_every_option_of_a_form_is_one_of_its_command(call: Any) -> None:
    for form in job_forms():
        _, text, _ = call(*form.words, "--help")
        for field in form.fields:
            if field.option:
                assert field.option in text
            if field.off and field.kind == "flag":
                assert field.off in text


def test_a_job_is_put_in_by_its_form(supervisor: Any, user: Any, seal: str) -> None:
    (drive,) = [f for f in supervisor.files("recording", most=9) if f.name == "cut_in_brake"]
    page = user.get("/jobs/check", params={"recording": drive.id})
    assert f'value="{drive.id}" selected' in page.text
    answer = user.post("/jobs/check", data={"seal": seal, "recording": drive.id}, headers={"origin": ORIGIN})
    assert answer.status_code == 303
    (task,) = supervisor.queue.unfinished()
    assert answer.headers["location"] == f"/tasks/{task.id}"
    assert (task.state, list(task.words)) == ("waiting", ["check", "--", drive.folder])
    assert "cut_in_brake" in user.get("/tasks").text
    for act, state in (("first", "waiting"), ("cancel", "cancelled"), ("retry", "waiting")):
        headers = {"origin": ORIGIN}
        assert user.post(f"/tasks/{task.id}/{act}", data={"seal": seal}, headers=headers).status_code == 303
        assert supervisor.queue.get(task.id).state == state
    assert (
        user.post(f"/tasks/{task.id}/burn", data={"seal": seal}, headers={"origin": ORIGIN}).status_code
        == 404
    )


def test_what_was_done_leaves_a_trace(supervisor: Any, user: Any, seal: str) -> None:
    headers = {"origin": ORIGIN}
    assert user.post("/jobs/check", data={"seal": seal, "recording": "x"}, headers=headers).status_code == 422
    assert user.post("/jobs/nothing", data={"seal": seal}, headers=headers).status_code == 404
    path = supervisor.audit.path
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    assert [line["outcome"].partition(":")[0] for line in lines] == ["asked", "refused"] * 2
    assert lines[0]["form"] == [["recording", "x"]]
    assert seal not in path.read_text()
    assert user.cookies["resim_8765"] not in path.read_text()
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    path.unlink()
    path.mkdir()  # what leaves no trace is not done
    drive = supervisor.files("recording", most=9)[0].id
    with pytest.raises(OSError, match="Is a directory"):
        user.post("/jobs/check", data={"seal": seal, "recording": drive}, headers=headers)
    assert supervisor.queue.counts() == {}


def test_a_form_that_does_not_fit_says_why(supervisor: Any, user: Any, seal: str) -> None:
    data = {"seal": seal, "recording": "/etc/passwd"}
    answer = user.post("/jobs/check", data=data, headers={"origin": ORIGIN})
    assert answer.status_code in (404, 422)
    assert "is no recording in a registered folder" in answer.text
    assert supervisor.queue.counts() == {}


def post(user: Any, seal: str, job: str, **given: str) -> Any:
    return user.post(f"/jobs/{job}", data={"seal": seal, **given}, headers={"origin": ORIGIN})


def offered(user: Any, job: str, field: str) -> dict[str, str]:
    """What may be chosen on a form: ids by names."""
    found = re.search(rf'<select name="{field}".*?</select>', user.get(f"/jobs/{job}").text, re.DOTALL)
    assert found
    return {name: value for value, name in re.findall(r'<option value="([^"]+)"[^>]*>([^<]*)', found[0])}


def test_what_a_job_made_is_in_the_lake_and_leads_to_what_it_came_from(
    supervisor: Any, user: Any, seal: str
) -> None:
    assert "scenarios" not in offered(user, "suite", "folder")  # nobody registered it
    add_roots(supervisor.catalog, [ROOT / "scenarios"])
    scenarios = offered(user, "suite", "folder")["scenarios"]
    (criteria,) = [f for f in supervisor.files("criteria", most=9) if f.name == "highway"]
    answer = post(user, seal, "suite", folder=scenarios, criteria=criteria.id, result_name="ours")
    assert answer.status_code == 303
    waited(lambda: (supervisor.worker.look(), not supervisor.queue.unfinished())[1])
    page = user.get(answer.headers["location"]).text
    (link,) = re.findall(r'href="(/lake/\w+)">ours<', page)
    assert f'href="/lake/{criteria.id}"' in page
    suite = user.get(link).text
    assert f'href="{answer.headers["location"]}"' in suite
    (drive,) = [f for f in supervisor.files("recording", most=9) if f.name == "cut_in_brake"]
    assert f'href="/experiments/{drive.id}"' in suite
    assert "ours" in [name.partition(" ")[0] for name in offered(user, "verify", "suite")]
    (task,) = supervisor.queue.ended(0, 9)
    supervisor.queue.retry(task.id)  # its command refuses to write over what is there
    waited(lambda: (supervisor.worker.look(), not supervisor.queue.unfinished())[1])
    assert supervisor.queue.get(task.id).state == "done"
    names = ("ours.toml", "ours.before-1.toml")
    once, twice = ((Path(task.folder) / name).read_text("utf-8") for name in names)
    assert once == twice


def test_only_what_lies_in_the_folder_of_a_task_is_put_aside_for_a_further_attempt(
    supervisor: Any, tmp_path: Path
) -> None:
    (tmp_path / "mine.toml").write_text("a user's own\n")
    criteria = f"--criteria={ROOT / 'scenarios/criteria/highway.toml'}"
    words = ("suite", "new", criteria, f"--out={tmp_path / 'mine.toml'}", "--", str(ROOT / "scenarios"))
    name = new_id()
    supervisor.queue.add(name, "suite", words, str(tmp_path / "tasks" / name))
    for attempt in (1, 2):
        waited(lambda: (supervisor.worker.look(), not supervisor.queue.unfinished())[1])
        assert (supervisor.queue.get(name).attempt, supervisor.queue.get(name).state) == (attempt, "failed")
        supervisor.queue.retry(name)
    assert [path.name for path in tmp_path.glob("mine*")] == ["mine.toml"]


def test_files_that_the_lake_does_not_know_are_chosen_by_number(
    supervisor: Any, user: Any, seal: str, tmp_path: Path
) -> None:
    inside, beside = tmp_path / "registered", tmp_path / "secret"
    for folder in (inside / "drive", beside):
        folder.mkdir(parents=True)
        (folder / "limits.toml").write_text("a = 1\n")
    (inside / "mine.toml").write_text("a = 1\n")
    (inside / ".hidden.toml").write_text("a = 1\n")
    (inside / "drive" / "recording.toml").write_text("")
    (inside / "link.toml").symlink_to(beside / "limits.toml")
    (inside / "way").symlink_to(beside)
    add_roots(supervisor.catalog, [inside])
    found = offered(user, "mine", "labels")
    assert found == {
        "registered/mine.toml": file_id(inside / "mine.toml"),
        "criteria/release.toml": file_id(ROOT / "scenarios" / "criteria" / "release.toml"),
    }
    (drive,) = [f for f in supervisor.files("recording", most=9) if f.name == "cut_in_brake"]
    for given in (
        file_id(beside / "limits.toml"), file_id(inside / "link.toml"), file_id(inside / "way" / "limits.toml"),
        file_id(inside / ".hidden.toml"), file_id(inside / "drive" / "limits.toml"), "file-", "file-0" * 8,
        str(inside / "mine.toml"), "../mine.toml", "file-../mine.toml",
    ):  # fmt: skip
        answer = post(user, seal, "mine", recordings=drive.id, labels=given)
        assert answer.status_code == 422, given
    assert supervisor.queue.counts() == {}
    assert (
        post(user, seal, "mine", recordings=drive.id, labels=found["registered/mine.toml"]).status_code == 303
    )
    (task,) = supervisor.queue.unfinished()
    assert f"--labels={inside / 'mine.toml'}" in task.words


def test_nothing_is_written_into_what_no_task_made(
    supervisor: Any, user: Any, seal: str, tmp_path: Path
) -> None:
    from resim.results.entry import CatalogEntry

    ours = supervisor.settings.tasks / "0" / "space"
    known = []
    for folder in (tmp_path / "space", ours):
        folder.mkdir(parents=True)
        (folder / "space.json").write_text("{}")
        known.append(
            CatalogEntry(
                "space", "space", folder, supervisor.queue.host, "2026-01-01T00:00:00+00:00", "", "0", ""
            )
        )
    swept = CatalogEntry("sweep", "s", ours, supervisor.queue.host, "2026-01-01T00:00:00+00:00", "", "0", "")
    (ours / "manifest.json").write_text("{}")
    supervisor.catalog.add(*known, swept)
    assert list(offered(user, "space-cover", "space").values()) == [known[1].id]
    refused, taken = (post(user, seal, "space-cover", space=one.id, sweep=swept.id) for one in known)
    assert (refused.status_code, taken.status_code) == (422, 303)
    assert "was made by no task" in refused.text


def test_who_may_look_only_starts_nothing(supervisor: Any, client: Any) -> None:
    client.get("/", params={"token": supervisor.access.tokens["look"]})
    seal = supervisor.access.form_seal(client.cookies["resim_8765"])
    for form in job_forms():
        assert client.get(f"/jobs/{form.name}").status_code == 200
        assert post(client, seal, form.name).status_code == 403
    assert supervisor.queue.counts() == {}
