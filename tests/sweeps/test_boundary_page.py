"""The report of an adaptive sweep: where its outcome changes, and nothing that its points are too uneven for."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from conftest import Call
from resealed import edit
from swept import BIAS, GAP, LATENCY, read, write_adaptive

ONE = (LATENCY.model_copy(update={"steps": 6, "width": 0.025}),)
TWO = (*ONE, BIAS.model_copy(update={"steps": 5, "width": 0.25}))
THREE = (ONE[0].model_copy(update={"width": 0.1}), TWO[1].model_copy(update={"width": 1.0}),
         GAP.model_copy(update={"width": 1.0}))  # fmt: skip
SPEED, AHEAD = (p.name for p in TWO)


def report(call: Call, folder: Path, *given: Any, **more: Any) -> tuple[dict[str, Any], str, str]:
    """The boundary in report.json, the page, and what the command said."""
    write_adaptive(folder, *given, **more)
    code, said, error = call("sweep", "report", folder)
    assert (code, error) == (0, "")
    (section,) = read(folder / "report.json")["sections"]
    return section["boundary"], (folder / "report.html").read_text(encoding="utf-8"), said


def test_one_parameter_has_a_threshold(call: Call, tmp_path: Path) -> None:
    found, page, said = report(call, tmp_path / "one", ONE)
    assert found["known"]
    assert found["cells"] == [[[0.3, 0.325]]]
    assert found["ranges"] == [{"parameter": SPEED, "side": "over", "value": 0.325, "points": 6}]
    for told in (
        "the EGO makes the measured decision, in 3 or more of the 5 seeds of a point",
        "between 0.300 s and 0.325 s of latency of speed (0 of 5 seeds good at the lower end, 4 at the upper one)",
        "the EGO makes the measured decision at every tested point with latency of speed of 0.325 s or more (6 points)",
    ):
        assert told in page
        assert told in said


def test_the_share_of_the_seeds_says_what_is_good(call: Call, tmp_path: Path) -> None:
    found, _, said = report(call, tmp_path / "all", ONE, share=1.0)
    assert (found["needed"], found["cells"]) == (5, [[[0.325, 0.35]]])
    assert "in each seed of a point" in said


def test_two_parameters_have_a_band(call: Call, tmp_path: Path) -> None:
    found, page, said = report(call, tmp_path / "two", TWO)
    assert found["known"]
    for (low, high), (under, over) in found["cells"]:
        assert low <= 0.3 + 0.1 * over + 1e-9
        assert high > 0.3 + 0.1 * under - 1e-9
    assert found["strips"][0]["at"][0] == -2.0
    assert found["strips"][-1]["at"][1] == 2.0
    for strip in found["strips"]:
        (change,) = strip["changes"]
        assert (change["below"], change["above"]) == (False, True)
    over, *_ = (r for r in found["ranges"] if r["parameter"] == SPEED)
    assert (over["side"], over["value"]) == ("over", pytest.approx(0.525))
    assert "(good above)" in said
    assert "for some values of longitudinal bias" in page


def test_three_parameters_are_projected(call: Call, tmp_path: Path) -> None:
    found, page, said = report(call, tmp_path / "three", THREE)
    assert found["strips"] is None
    assert page.count("all points and cells, projected") == 3
    assert "for some values of the others" in said
    assert found["changes"][GAP.name] == [[0.5, 2.5]]


@pytest.mark.parametrize("parameters", [ONE, TWO, THREE], ids=["one", "two", "three"])
def test_points_that_run_out_are_told(call: Call, tmp_path: Path, parameters: Any) -> None:
    first = 1
    for p in parameters:
        first *= p.steps
    found, page, said = report(call, tmp_path / "few", parameters, points=first)
    assert not found["known"]
    assert found["widest"][SPEED] == 0.2
    for told in (
        f"points = {first} ran out",
        "cells of up to 0.200 s" if parameters != THREE else "of up to 0.2 s",
    ):
        assert told in page
        assert told in said


def test_what_does_not_change_is_told(call: Call, tmp_path: Path) -> None:
    found, page, said = report(call, tmp_path / "lane", TWO, outcome="lane")
    assert (found["known"], found["cells"], found["widest"]) == (True, [], None)
    assert "“lane” is passed at every tested point" in page
    assert "30 points tested, 30 of them good: the outcome does not change" in said


def test_nothing_is_told_of_the_ranges(call: Call, tmp_path: Path) -> None:
    _, page, said = report(call, tmp_path / "two", TWO)
    found = read(tmp_path / "two" / "report.json")
    assert not {"outcomes", "demanded", "confidence"} & {*found, *found["sections"][0]}
    worst = found["sections"][0]["worst"][0]
    assert (
        worst["command"] == f"resim sweep repeat {tmp_path / 'two'} {worst['run']} --out run-{worst['run']}"
    )
    for part in ("Requirements <i>", "Sensitivity <i>", "How often a run is good", "95 %"):
        assert part not in page
    assert "95 %" not in said


def test_the_same_rows_give_the_same_bytes(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for place in ("a", "b"):
        (tmp_path / place).mkdir()
        monkeypatch.chdir(tmp_path / place)
        report(call, Path("out"), TWO)
    for name in ("report.html", "report.json"):
        one, two = ((tmp_path / place / "out" / name).read_bytes() for place in ("a", "b"))
        assert one == two
        assert str(tmp_path).encode() not in one


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda said: said.pop("boundaries"), "is not what"),
        (lambda said: said["inputs"]["recordings"].pop("cut_in"), "does not say what"),
    ],
)
def test_a_damaged_boundary_is_refused(
    call: Call, tmp_path: Path, change: Callable[[dict[str, Any]], Any], told: str
) -> None:
    write_adaptive(tmp_path / "swept", ONE)
    edit(tmp_path / "swept" / "manifest.json", change)
    code, _, error = call("sweep", "report", tmp_path / "swept")
    assert (code, error.count("\n")) == (2, 1)
    assert told in error
