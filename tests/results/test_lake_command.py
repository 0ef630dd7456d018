"""`resim lake` on the command line, and the same as a table in Python."""

from __future__ import annotations

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from conftest import Call

from resim.core.errors import InputError
from resim.jobs.lake import lake_find, lake_show, the_catalog

ROOT = Path(__file__).parents[2]


@pytest.fixture
def lake(tmp_path: Path, made: Path, call: Call, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A lake with what the run in `made` was made of."""
    monkeypatch.setenv("RESIM_CATALOG", str(tmp_path / "catalog.sqlite"))
    shutil.copytree(made / "run", tmp_path / "out" / "run")
    paths = ("scenarios/cut_in_brake", "scenarios/criteria/highway.toml", "networks/proving_ground.xodr",
             "adfunc/builds/highway_pilot-1.0.toml")  # fmt: skip
    code, out, _ = call("lake", "add", tmp_path / "out", *(ROOT / path for path in paths))
    assert (code, out.strip()) == (0, "5 there: 5 new, 0 changed; 0 gone")
    return tmp_path


def said(call: Call, *words: object) -> Any:
    code, out, _ = call(*words, "--json")
    assert code == 0
    return json.loads(out)


def test_what_was_registered_is_found_as_table_json_csv_and_frame(lake: Path, call: Call) -> None:
    code, out, _ = call(
        "lake", "find", "cut_in", "--kind", "recording", "--place", "proving", "--risk-above", 0.001
    )
    assert (code, out.count("cut_in_brake")) == (0, 2)
    found = said(call, "lake", "find", "--build", "highway_pilot", "--sort", "name")
    assert [one["kind"] for one in found["found"]] == ["recording", "run"] or found["count"] == 2
    code, out, _ = call("lake", "find", "--verdict", "fail", "--format", "csv")
    (row,) = csv.DictReader(out.splitlines())
    assert (row["kind"], row["folder"]) == ("run", str(lake / "out" / "run"))
    frame = lake_find(kinds=("run",), verdict="FAIL")
    assert frame.loc[0, "folder"] == row["folder"]
    assert list(lake_find(text="nothing like this").columns) == [*frame.columns]
    assert "nothing was found" in call("lake", "find", "nothing like this")[1]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("find", "--kind", "runs"), "there is no 'runs'. There are: run, assessment"),
        (("show", "beef"), "beef: is nothing that the lake .* knows. `resim lake find`"),
        (("add", "nowhere"), "nowhere: is not there. Give recordings"),
    ],
)
def test_what_is_wrong_is_told(lake: Path, call: Call, words: tuple[str, ...], told: str) -> None:
    import re

    code, _, error = call("lake", *words)
    assert code == 2
    assert re.search(told, " ".join(error.split())), error


def test_filters_that_there_are_not_are_refused(lake: Path) -> None:
    with pytest.raises(InputError, match="there is no filter 'colour'"):
        lake_find(colour="red")
    with pytest.raises(InputError, match="there is no kind 'runs'"):
        lake_find(kinds=("runs",))


def test_links_lead_both_ways_and_to_the_command_that_makes_it_again(lake: Path, call: Call) -> None:
    links = lake_show(str(lake / "out" / "run"))
    drive, build = ROOT / "scenarios" / "cut_in_brake", ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml"
    criteria = ROOT / "scenarios" / "criteria" / "highway.toml"
    assert links.command == f"resim run {drive} --build {build} --criteria {criteria} --out again"
    assert {i.role: [item.folder for item in items] for i, items in links.origins} == {
        "recording": [str(drive)], "build": [str(build)], "criteria": [str(criteria)],
        "map": [str(ROOT / "networks" / "proving_ground.xodr")],
    }  # fmt: skip
    for role, count in (("recording", 1), ("build", 2), ("map", 2), ("criteria", 1)):
        (item,) = next(items for i, items in links.origins if i.role == role)
        back = lake_show(item.id)
        assert (back.count, links.entry.id in {f.id for f in back.followers}) == (count, True)
    shown = said(call, "lake", "show", links.entry.id[:6])
    assert (shown["command"], shown["state"]) == (links.command, "there")
    assert "what came of it: 2" in call("lake", "show", build)[1]
    code, out, _ = call("lake", "rm", build)
    assert (code, out.strip()) == (0, "forgotten: 1")
    assert lake_show(links.entry.id).command == ""  # nobody knows where this build is
    assert said(call, "lake", "scan")["seen"] == 4


def test_an_assessment_leads_to_its_run_and_back(lake: Path, made: Path, call: Call) -> None:
    shutil.copytree(made / "assessment", lake / "out" / "assessment")
    assert call("lake", "scan")[0] == 0
    links, run = lake_show(str(lake / "out" / "assessment")), lake_show(str(lake / "out" / "run"))
    (its,) = [[item.id for item in items] for i, items in links.origins if i.role == "run"]
    assert its == [run.entry.id]
    assert links.entry.id in {item.id for item in run.followers}
    assert run.origin.settings["seed"] == "0"
    assert run.origin.versions["resim"]


def test_what_names_no_map_leads_to_those_of_its_recordings(lake: Path, call: Call) -> None:
    (lake / "out" / "mined").mkdir()
    entry = lake_show(str(lake / "out" / "run")).entry
    drives = tuple(i for i in entry.inputs if i.role == "recording")
    the_catalog().add(
        replace(entry, kind="suite", folder=lake / "out" / "mined", digest="ab" * 32, inputs=drives)
    )
    links = lake_show(str(lake / "out" / "mined"))
    (map_,) = [items[0].folder for i, items in links.origins if i.role == "map"]
    assert map_ == str(ROOT / "networks" / "proving_ground.xodr")
    assert map_ in call("lake", "show", lake / "out" / "mined")[1].replace("\n", "")


def test_a_space_enters_itself_with_its_clusters_when_it_is_built_and_built_again(
    lake: Path, made: Path, call: Call
) -> None:
    for _ in range(2):
        assert call("space", "build", made / "mining", "--out", lake / "space")[0] == 0
        spaces, clusters = (lake_find(kinds=(kind,)) for kind in ("space", "cluster"))
        assert [*spaces["folder"]] == [str(lake / "space")]
        assert len(clusters) > 0
        assert {*clusters["folder"]} == {str(lake / "space")}
