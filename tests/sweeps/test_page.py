"""The report of a sweep: what it says of sweeps whose truth is known."""

from __future__ import annotations

import copy
import json
import re
import shlex
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from conftest import Call
from hostile import HOSTILE, figures_of, harmless, poisoned
from lxml import html
from resealed import edit
from swept import BIAS, LATENCY, THREE, TWO, read, write_adaptive, write_swept

from resim.core.errors import InputError
from resim.core.json_text import json_text
from resim.core.spec import from_json, read_json, to_json
from resim.jobs.schemas import schema_of
from resim.sweeps.page import write_sweep_page
from resim.sweeps.report import SweepReport
from resim.sweeps.result import read_swept

SPEED, AHEAD, GAP = (p.name for p in THREE)


def report(call: Call, folder: Path, **more: Any) -> tuple[dict[str, Any], str, str]:
    """report.json, the page, and what the command said, of a sweep as `write_swept` makes it."""
    write_swept(folder, **more)
    code, said, error = call("sweep", "report", folder)
    assert (code, error) == (0, "")
    return read(folder / "report.json"), (folder / "report.html").read_text(encoding="utf-8"), said


@pytest.mark.parametrize("plan", ["grid", "latin_hypercube", "one_at_a_time", "adaptive"])
def test_report_json_fits_its_schema_and_is_read_back_as_it_was_written(
    call: Call, tmp_path: Path, plan: str
) -> None:
    if plan == "adaptive":
        wide = (LATENCY.model_copy(update={"width": 0.1}), BIAS.model_copy(update={"width": 0.5}))
        write_adaptive(tmp_path / "swept", wide)
        assert call("sweep", "report", tmp_path / "swept")[0] == 0
    else:
        report(call, tmp_path / "swept", plan=plan, points=64, failed=2)
    path = tmp_path / "swept" / "report.json"
    said, schema = read(path), jsonschema.Draft202012Validator(schema_of("sweep_report"))
    schema.validate(said)
    again = read_json(path, SweepReport, "resim sweep report", "")
    assert json_text(to_json(again)) == path.read_text(encoding="utf-8")
    changes: list[Callable[[dict[str, Any]], Any]] = [
        lambda f: f.update(runs="many"), lambda f: f["sections"][0].pop("decisions"),
        lambda f: f["sections"][0]["worst"][0].update(collision=1), lambda f: f.update(mood="good"),
        lambda f: f["sections"][0].update(boundary={}),
    ]  # fmt: skip
    for change in changes:
        altered = copy.deepcopy(said)
        change(altered)
        assert not schema.is_valid(altered)
        path.write_text(json.dumps(altered), encoding="utf-8")
        with pytest.raises(InputError, match=r"report\.json: is not what `resim sweep report` writes: "):
            read_json(path, SweepReport, "resim sweep report", "")


def outcome(found: dict[str, Any], name: str) -> dict[str, Any]:
    return next(o for o in found["sections"][0]["outcomes"] if o["name"] == name)


@pytest.fixture
def grid(call: Call, tmp_path: Path) -> tuple[dict[str, Any], str, str]:
    return report(call, tmp_path / "grid")


def test_it_says_how_far_a_parameter_may_go(grid: tuple[dict[str, Any], str, str]) -> None:
    """The risk is 0.2 latency + 0.02 |bias - 0.5|: with the mean bias it is 0.1 near 0.39 s."""
    limit = outcome(grid[0], "kpi accident risk")["requirements"][SPEED][0]
    assert (limit["side"], limit["found"], limit["estimate"]) == ("under", "limit", [None, 0.3])
    assert (limit["bounds"], limit["beyond"]) == ([None, 0.2], [None, 0.3])
    assert limit["share"] > limit["least"] >= 0.95
    told = "latency of speed up to 0.2 s meets it in 95 % of runs (100 % of 135 runs, at least 96.1 %"
    assert told in grid[1]
    assert told in grid[2]
    assert "estimate: up to 0.3 s" in grid[1]
    over = outcome(grid[0], "same_decision")["requirements"][SPEED]
    assert [r["found"] for r in over] == ["none", "limit"]
    assert "no swept value meets it in 95 % of runs" in grid[1]


def test_it_finds_the_boundary(grid: tuple[dict[str, Any], str, str]) -> None:
    """The EGO makes the measured decision where the latency is above 0.3 s + 0.1 bias."""
    boundary = outcome(grid[0], "same_decision")["map"]["boundaries"]["0.5"]
    assert [c["b"] for c in boundary] == [-2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0]
    for c in boundary:
        assert abs(c["at"] - 0.3 - 0.1 * c["b"]) <= 0.0501
        assert c["rises"]
        assert c["low"] < c["at"] < c["high"]


def maps(page: str) -> list[dict[str, Any]]:
    """The maps on a page, as plotly.js reads them."""
    return [figure for figure in figures_of(html.fromstring(page)) if figure["data"][0]["type"] == "heatmap"]


def test_all_maps_have_the_same_axes(call: Call, tmp_path: Path) -> None:
    """Whichever of two parameters an outcome answers to most."""
    found, page, _ = report(call, tmp_path / "grid")
    axes = [[figure["layout"][side] for side in ("xaxis", "yaxis")] for figure in maps(page)]
    assert len(axes) > 1
    assert {tuple(axis["title"]["text"] for axis in both) for both in axes} == {
        ("latency of speed [s]", "longitudinal bias [m]")
    }
    assert {tuple(end for axis in both for end in axis["range"]) for both in axes} == {
        (-0.05, 1.05, -2.25, 2.25)
    }
    path = tmp_path / "turned.html"
    turned = copy.deepcopy(found)
    (drawn, *_) = (o["map"] for o in turned["sections"][0]["outcomes"] if o.get("map"))
    for one, other in (("a", "b"), ("at_a", "at_b")):
        drawn[one], drawn[other] = drawn[other], drawn[one]
    for name in ("share", "low", "high"):
        drawn[name] = [list(column) for column in zip(*drawn[name], strict=True)]
    write_sweep_page(from_json(turned, SweepReport, path, "resim sweep report", ""), path)
    assert maps(path.read_text(encoding="utf-8")) == maps(page)


def test_it_ranks_the_parameters(grid: tuple[dict[str, Any], str, str]) -> None:
    risk = outcome(grid[0], "risk")["sensitivity"]
    assert risk["ranking"] == [SPEED, AHEAD]
    assert risk["sobol"]["method"] == "anova"
    assert risk["sobol"][SPEED]["first"] == pytest.approx(0.004 / (0.004 + 0.00016), abs=0.03)
    constant = grid[0]["sections"][0]["constant"]
    assert [(c["name"], c["unit"]) for c in constant] == [("kpi lane", ""), ("value lane", "m")]
    assert "worst value of lane (−0.5 m)" in grid[1]


def test_responses_have_bands(grid: tuple[dict[str, Any], str, str]) -> None:
    found = outcome(grid[0], "risk")["responses"][SPEED]
    assert found["at"] == pytest.approx([k / 10 for k in range(11)])
    truth = [0.2 * x + 0.02 * 10.25 / 9 for x in found["at"]]
    for low, known, high in list(zip(found["low"], truth, found["high"], strict=True))[1:]:
        assert low <= known <= high
    assert found["points"] == [9] * 11
    assert found["runs"] == [45] * 11


def test_the_worst_runs_come_first(call: Call, tmp_path: Path) -> None:
    found, page, _ = report(call, tmp_path / "failed", failed=2)
    section = found["sections"][0]
    worst = section["worst"]
    assert [w["run"] for w in worst[:2]] == [0, 1]
    assert all(w["collision"] for w in worst[2:])
    assert worst[0]["collision"] is None
    risks = [w["risk"] for w in worst[2:]]
    assert risks == sorted(risks, reverse=True)
    assert len(worst) == 10
    assert section["failures"] == {"the process was ended by SIGSEGV": 2}
    assert "2 of 495 runs failed" in page
    lane = outcome(found, "kpi lane")  # what failed passes nothing
    assert lane["mean"] == pytest.approx(493 / 495, abs=1e-5)


def test_where_all_fail_nothing_is_kept(call: Call, tmp_path: Path) -> None:
    found, _, said = report(call, tmp_path / "failed", failed=495)
    assert found["sections"][0]["outcomes"] == []
    assert found["sections"][0]["largest_risk"] is None
    assert said.count("never met in this sweep; 495 runs failed, which count as not met") == 3


@pytest.mark.parametrize(
    "more",
    [
        {"plan": "halton", "points": 1, "seeds": 1}, {"plan": "latin_hypercube", "points": 3, "seeds": 1},
        {"seeds": 1}, {"failed": 250},
        {"plan": "sobol", "points": 64, "parameters": (LATENCY.model_copy(
            update={"low": None, "high": None, "values": (0.9, 0.0, 0.3)}), BIAS.model_copy(
            update={"mean": 0.3, "std": 0.4}))},
    ],
    ids=["one point", "three points", "one seed", "half failed", "values and a normal distribution"],
)  # fmt: skip
def test_small_and_broken_sweeps_have_a_report(call: Call, tmp_path: Path, more: dict[str, Any]) -> None:
    found, page, _ = report(call, tmp_path / "odd", **more)
    assert len(found["sections"]) == 1
    assert "Worst runs" in page


def test_what_is_drawn_is_smoothed_and_fitted(call: Call, tmp_path: Path) -> None:
    found, page, said = report(call, tmp_path / "drawn", parameters=THREE, plan="sobol", points=512)
    risk = outcome(found, "risk")["sensitivity"]
    assert risk["ranking"][:2] == [SPEED, AHEAD]
    assert risk["sobol"]["method"] == "chaos"
    assert risk["sobol"]["q2"] > 0.95
    assert risk["sobol"][GAP]["total"] < 0.01
    drawn = outcome(found, "same_decision")["map"]
    assert (drawn["a"], drawn["b"], drawn["others"]) == (SPEED, AHEAD, [GAP])
    for c in drawn["boundaries"]["0.5"]:
        if abs(c["b"]) < 1.5:
            assert c["at"] == pytest.approx(0.3 + 0.1 * c["b"], abs=0.05)
    assert "varies, too: time gap of the function" in page
    assert "of the ranges; bounds are of the smoothed share" in page
    assert "in the bin of drawn values" in said


def test_one_at_a_time_has_main_effects_only(call: Call, tmp_path: Path) -> None:
    found, page, _ = report(call, tmp_path / "one", parameters=THREE, plan="one_at_a_time")
    risk = outcome(found, "risk")
    assert risk["sensitivity"]["sobol"] is None
    assert risk["sensitivity"]["ranking"][0] == SPEED
    assert risk["responses"][SPEED]["points"] == [1] * 11
    assert outcome(found, "same_decision")["map"] is None
    assert "means reach over" in page


def test_each_recording_and_build_has_its_part(call: Call, tmp_path: Path) -> None:
    several = (("cut_in", "pilot-1.0"), ("a <b>", "pilot-1.0"), ("cut_in", "pilot-1.1"))
    found, page, said = report(call, tmp_path / "several", sections=several)
    assert [(s["recording"], s["build"]) for s in found["sections"]] == list(several)
    assert "a <b>" not in page
    tree = html.fromstring(page)
    assert [part.get("id") for part in tree.xpath("//details[@class='part']")] == ["s-0", "s-1", "s-2"]
    assert said.count("pass every criterion") == 3


def test_the_same_rows_give_the_same_bytes(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for place in ("one", "two"):
        (tmp_path / place).mkdir()
        monkeypatch.chdir(tmp_path / place)
        report(call, Path("out"), parameters=THREE, plan="halton", points=100)
    for name in ("report.html", "report.json"):
        one, two = ((tmp_path / place / "out" / name).read_bytes() for place in ("one", "two"))
        assert one == two
        assert str(tmp_path).encode() not in one


@pytest.mark.parametrize("name", ["my sweep", "$(touch x); it's", "-rf"])
def test_the_command_names_the_folder_from_here(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    found, page, _ = report(call, tmp_path / name / "out")
    worst = found["sections"][0]["worst"][0]
    read = ["sh", "-c", f"printf '%s\\n' {worst['command']}"]
    words = subprocess.run(read, capture_output=True, text=True, check=True).stdout.splitlines()
    place, run = f"{'./' * (name == '-rf')}{name}/out", str(worst["run"])
    assert words == ["resim", "sweep", "repeat", place, run, "--out", f"{place}-run-{run}"]
    (Path(name) / "out" / "manifest.json").unlink()
    code, _, error = call("sweep", "report", tmp_path / name / "out")
    assert code == 2
    line = error.partition("Do what is missing: ")[2].strip()
    assert shlex.split(line)[:3] == ["resim", "sweep", "FILE"]
    assert shlex.split(line)[4] == str(tmp_path / name / "out")
    assert not re.search(
        r"\d\d:\d\d:\d\d", page.split("</head>")[1].split('<script type="application/gzip"')[0]
    )


def test_a_parameter_that_is_not_varied_has_no_response(call: Call, tmp_path: Path) -> None:
    still = BIAS.model_copy(update={"low": None, "high": None, "values": (0.0,)})
    found, _, _ = report(call, tmp_path / "still", parameters=(LATENCY, still))
    risk = outcome(found, "risk")
    assert list(risk["responses"]) == [SPEED]
    assert risk["sensitivity"]["ranking"] == [SPEED]


def test_a_hundred_thousand_rows(call: Call, tmp_path: Path) -> None:
    fine = tuple(p.model_copy(update={"steps": n}) for p, n in zip(TWO, (200, 100), strict=True))
    found, page, _ = report(call, tmp_path / "large", parameters=fine)
    assert found["runs"] == 100_000
    assert len(page) < 2_000_000
    limit = outcome(found, "kpi accident risk")["requirements"][SPEED][0]
    assert 0.33 < limit["bounds"][1] <= limit["estimate"][1] <= limit["possible"][1] < 0.38


def test_the_file_may_be_named(call: Call, tmp_path: Path) -> None:
    write_swept(tmp_path / "swept")
    assert call("sweep", "report", tmp_path / "swept", "--out", tmp_path / "mine.html")[0] == 0
    assert (tmp_path / "mine.html").is_file()
    assert read(tmp_path / "mine.json")["schema"] == "resim-sweep-report-1"
    assert not (tmp_path / "swept" / "report.html").exists()


@pytest.mark.parametrize(
    ("lost", "told"),
    [
        ("sweep.json", "holds no sweep"),
        ("manifest.json", "is not finished, 0 runs are there so far"),
        ("runs/part-00000.parquet", "cannot be read"),
    ],
)
def test_what_is_not_finished_is_refused(call: Call, tmp_path: Path, lost: str, told: str) -> None:
    write_swept(tmp_path / "swept")
    (tmp_path / "swept" / lost).unlink()
    code, said, error = call("sweep", "report", tmp_path / "swept")
    assert (code, said) == (2, "")
    assert error.count("\n") == 1
    assert told in error
    assert lost == "sweep.json" or "--resume" in error


def test_no_bit_of_the_table_may_be_another(tmp_path: Path) -> None:
    write_swept(tmp_path / "swept")
    part = tmp_path / "swept" / "runs" / "part-00000.parquet"
    whole = part.read_bytes()
    for at in range(0, len(whole), len(whole) // 100):
        part.write_bytes(whole[:at] + bytes([whole[at] ^ 1 << at % 8]) + whole[at + 1 :])
        with pytest.raises(
            InputError, match=r"part-00000\.parquet: was changed after it was written.* --resume"
        ):
            read_swept(tmp_path / "swept")
    part.write_bytes(whole)
    assert len(read_swept(tmp_path / "swept").rows) == 495


@pytest.mark.parametrize(
    ("more", "told"),
    [({"runs": 500}, "holds 495 runs, expected 500"),
     ({"schema": "resim-sweep-9"}, "schema: expected 'resim-sweep-1'"),
     ({"columns": ["run", "other"]}, "has no column 'other'")],
)  # fmt: skip
def test_a_manifest_of_something_else_is_refused(
    call: Call, tmp_path: Path, more: dict[str, object], told: str
) -> None:
    write_swept(tmp_path / "swept")
    edit(tmp_path / "swept" / "manifest.json", lambda said: said.update(more))
    code, _, error = call("sweep", "report", tmp_path / "swept")
    assert code == 2
    assert told in error


@pytest.mark.parametrize("name", ["manifest.json", "sweep.json"])
@pytest.mark.parametrize(
    ("old", "new", "told"),
    [("known", "unknown", "was changed after it was written"), ("{", "", "is not JSON")],
)
def test_an_edited_manifest_is_refused(
    call: Call, tmp_path: Path, name: str, old: str, new: str, told: str
) -> None:
    write_swept(tmp_path / "swept")
    path = tmp_path / "swept" / name
    path.write_text(path.read_text().replace(old, new, 1))
    code, _, error = call("sweep", "report", tmp_path / "swept")
    assert code == 2
    assert f"{name}: {told}" in error


@pytest.mark.parametrize("name", ["page.html", "page.json"])
def test_what_is_not_its_own_is_not_replaced(call: Call, tmp_path: Path, name: str) -> None:
    write_swept(tmp_path / "swept")
    arguments = ("sweep", "report", tmp_path / "swept", "--out", tmp_path / "page.html")
    for _ in range(2):
        assert call(*arguments)[0] == 0
    held = {kind: (tmp_path / f"page.{kind}").read_bytes() for kind in ("html", "json")}
    (tmp_path / name).write_text('{"name": "of another tool"}<html></html>')
    code, _, error = call(*arguments)
    assert code == 2
    assert f"{name}: exists, is not such a resim file, and would be lost" in error
    left = {kind: (tmp_path / f"page.{kind}").read_bytes() for kind in ("html", "json")}
    assert sum(left[kind] != held[kind] for kind in held) == 1


def test_a_page_is_html(call: Call, tmp_path: Path) -> None:
    write_swept(tmp_path / "swept")
    code, _, error = call("sweep", "report", tmp_path / "swept", "--out", tmp_path / "page.json")
    assert code == 2
    assert "Name an .html file" in error


@pytest.mark.parametrize("plan", ["grid", "adaptive"])
def test_nothing_in_a_report_makes_elements(call: Call, tmp_path: Path, plan: str) -> None:
    """Every text of report.json is hostile but those that the page looks up in tables of its own."""
    if plan == "grid":
        found, _, _ = report(call, tmp_path / "grid", failed=2)
    else:
        wide = [LATENCY.model_copy(update={"width": 0.1}), BIAS.model_copy(update={"width": 0.5})]
        write_adaptive(tmp_path / "grid", tuple(wide))
        assert call("sweep", "report", tmp_path / "grid")[0] == 0
        found = read(tmp_path / "grid" / "report.json")
    ours = {"plan", "engine", "found", "side", "end", "method", "schema", "traffic", "sides", "drivers"}
    named = {"responses", "range", "requirements", "widths", "finest", "widest", "builds", "recordings", "versions",
             "decisions", "failures", "parameters", "changes"}  # fmt: skip
    evil = poisoned(found, ours, named)
    for section in evil["sections"]:
        for o in section.get("outcomes", []):
            sobol = o["sensitivity"]["sobol"]
            for p in found["parameters"]:
                if sobol is not None:
                    sobol[p["name"] + HOSTILE] = sobol.pop(p["name"])
    evil["inputs"]["sweep"]["parameter"] = found["inputs"]["sweep"]["parameter"]  # a hostile name is refused
    path = tmp_path / "page.html"
    write_sweep_page(from_json(evil, SweepReport, path, "resim sweep report", ""), path)
    harmless((tmp_path / "page.html").read_text(encoding="utf-8"))
