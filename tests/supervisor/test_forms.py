"""What is filled in becomes a command line, and nothing else."""

from __future__ import annotations

import json
import stat
from pathlib import Path
from typing import Any

import pytest

from resim.cli.job_forms import OFFERED, job_forms
from resim.core.errors import InputError
from resim.supervisor.forms import FormError, FormField, JobForm, command_line

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
    ), "--out", "result",
)  # fmt: skip


def path_of(name: str, kinds: tuple[str, ...]) -> Path:
    if name != "1":
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
        "run", "--step=0.02", "--basis=sd", "--no-stop", "--set=a=1", "--set=b=2", "--out=/tasks/7/result", "--",
        "/drives/cut -in",
    ]  # fmt: skip
    assert line(("recording", "1"), ("stop", "yes")) == [
        "run",
        "--out=/tasks/7/result",
        "--",
        "/drives/cut -in",
    ]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("recording", ""), ("recording", "/etc/passwd"), ("recording", "../1"), ("step", "0"), ("step", "nan"),
        ("step", "inf"), ("step", "1;rm -rf /"), ("seeds", "1.5"), ("seeds", "1001"), ("seeds", "0x10"),
        ("basis", "both; x"), ("stop", "--gui"), ("settings", "a\x00b"), ("settings", "x" * 301), ("out", "/etc"),
        ("gui", "yes"), ("step", "--out=/etc"), ("settings", "\n".join(["a=1"] * 300)), ("step", "1e400"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused(name: str, value: str) -> None:
    given = [("recording", "1")] * (name != "recording") + [(name, value)]
    with pytest.raises((FormError, InputError)):
        line(*given)


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
    }  # look at new ones


def test_every_option_of_a_form_is_one_of_its_command(call: Any) -> None:
    for form in job_forms():
        _, text, _ = call(*form.words, "--help")
        for field in form.fields:
            if field.option:
                assert field.option in text
            if field.off:
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
