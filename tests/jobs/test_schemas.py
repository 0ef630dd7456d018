"""What resim writes and what ships fits the published JSON Schemas; what was altered does not."""

from __future__ import annotations

import copy
import json
import tomllib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from conftest import ROOT

import resim
from resim.core.json_text import json_text
from resim.core.sealed import sealed
from resim.core.spec import read_json, read_sealed_json, to_json
from resim.jobs.mine import MineOptions, mine
from resim.jobs.schemas import FORMATS, schema_of
from resim.resimulation import PerceptionSetup, ResimulationOptions
from resim.verification.request import VerifyOptions

PILOT, NEWER = (ROOT / "adfunc" / "builds" / f"highway_pilot-1.{k}.toml" for k in (0, 1))
MODEL = ROOT / "adfunc" / "perception" / "proving_ground.json"
CORNER_CASE = ROOT / "scenarios" / "cut_in_brake"
CRITERIA = ROOT / "scenarios" / "criteria" / "highway.toml"
SUITE = """name = "s"
criteria = "{root}/scenarios/criteria/highway.toml"
agreement = 0.5
recording = [{{folder = "{root}/scenarios/cut_in_brake"}}, {{folder = "nowhere"}}]
"""


def content(path: Path) -> Any:
    text = path.read_text(encoding="utf-8")
    return tomllib.loads(text) if path.suffix == ".toml" else json.loads(text)


@cache
def validator(name: str) -> jsonschema.Draft202012Validator:
    schema = schema_of(name)
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def valid(name: str, said: Any) -> bool:
    return bool(validator(name).is_valid(said))


SHIPPED = {
    "recording": [*ROOT.glob("scenarios/**/recording.toml")],
    "build": [*ROOT.glob("adfunc/builds/*.toml")],
    "criteria": [one for one in ROOT.glob("scenarios/criteria/*.toml") if one.name != "release.toml"],
    "release_limits": [ROOT / "scenarios" / "criteria" / "release.toml"],
    "suite": [*ROOT.glob("scenarios/suites/*.toml")],
    "sweep": [*ROOT.glob("scenarios/sweeps/*.toml")],
    "recipe": [*ROOT.glob("scenarios/catalog/generate/*.toml")],
    "naturalistic": [*ROOT.glob("scenarios/traffic/*.toml")],
    "perception": [*ROOT.glob("adfunc/perception/*.json")],
    "labels": [*ROOT.glob("scenarios/mining/*.toml")],
    "kinds": [*ROOT.glob("scenarios/catalog/kinds.toml")],
}


@pytest.mark.parametrize("name", SHIPPED)
def test_what_ships_is_valid_and_an_unknown_field_is_not(name: str) -> None:
    assert SHIPPED[name]
    for path in SHIPPED[name]:
        said = content(path)
        assert valid(name, said), path
        assert not valid(name, {**said, "mood": "good"})


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with a perception model, the same drive verified, and two builds compared on it."""
    folder = tmp_path_factory.mktemp("out")
    seen = PerceptionSetup(resim.read_model(MODEL), (0,), (), "ab" * 32)
    options = ResimulationOptions(bases=("GT",))
    resim.resimulate(CORNER_CASE, PILOT, options, perception=seen, criteria=CRITERIA).write(folder / "run")
    (folder / "suite.toml").write_text(SUITE.format(root=ROOT), encoding="utf-8")
    asked = VerifyOptions(perception=MODEL, seeds=5)
    resim.verify(folder / "suite.toml", PILOT, folder / "verified", asked, workers=1)
    resim.compare(folder / "suite.toml", NEWER, PILOT, folder / "compared", workers=1)
    resim.assess(CORNER_CASE, criteria=CRITERIA).write(folder / "assessed")
    mine([CORNER_CASE], folder / "mined", MineOptions(fit=False))
    resim.convert(ROOT / "networks" / "proving_ground.xodr", folder / "converted")
    return folder


Alter = Callable[[Any], Any]
WRITTEN: dict[str, tuple[str, list[Alter]]] = {
    "run/report.json": ("report", [
        lambda f: f.update(ego=7), lambda f: f.pop("reaction"), lambda f: f["end"].update(rGT="vanished"),
        lambda f: f["perception"]["seeds"][0].update(seed="0"), lambda f: f.update(mood="good"),
    ]),
    "run/run.json": ("run", [
        lambda f: f.pop("checksum"), lambda f: f.update(step="0.01"), lambda f: f["times"].update(fit=None),
        lambda f: f["perception"]["seeds"][0].pop("time"),
    ]),
    "run/assessment.json": ("run_assessment", [
        lambda f: f.pop("checksum"), lambda f: f.pop("GT"), lambda f: f["rGT"].update(verdict="fine"),
        lambda f: f["rGT+M"]["seeds"][0].pop("collision"), lambda f: f["inputs"]["recording"].update(hash=None),
        lambda f: f["GT"]["measures"].update(TTC=[1.0]), lambda f: f.update(mood="good"),
    ]),
    "assessed/assessment.json": ("assessment", [
        lambda f: f.pop("t"), lambda f: f["SD"].pop("risk"), lambda f: f.update(rGT=f["SD"]),
        lambda f: f["criteria"]["time headway"].update(limit=None), lambda f: f["risk"]["reasons"].pop("r_ind"),
    ]),
    "converted/conversion.json": ("conversion", [
        lambda f: f.pop("files"), lambda f: f["lanes"][0].update(worst="large"), lambda f: f["lanes"][0].pop("sumo"),
        lambda f: f.update(not_exact=0.5), lambda f: f.update(mood="good"),
    ]),
    "run/GT.jscen.json": ("jscen", [lambda f: f.clear()]),
    "verified/verification.json": ("verification", [
        lambda f: f["recordings"][0].update(verdict="fine"), lambda f: f["summary"].pop("good"),
        lambda f: f["recordings"][0]["ways"]["rGT+M"]["share"].update(low=None),
        lambda f: f["recordings"][1].pop("crashed"), lambda f: f.update(checksum="0"),
    ]),
    "verified/inputs.json": ("inputs", [
        lambda f: f.pop("files"), lambda f: f["inputs"].update(agreement=0.1), lambda f: f.update(mood="good"),
    ]),
    "verified/cases/cut_in_brake.json": ("case", [
        lambda f: f.pop("key"), lambda f: f["entry"].update(way="straight on"), lambda f: f.update(traces=None),
        lambda f: f["entry"].update(name="cut_in_brake"), lambda f: f["entry"].pop("kpis"),
    ]),
    "compared/cases/cut_in_brake.json": ("case", [
        lambda f: f["entry"].pop("pairs"), lambda f: f["traces"].pop("now"), lambda f: f["entry"].update(way="rGT"),
    ]),
    "compared/verification.json": ("verification", [
        lambda f: f["recordings"][0]["pairs"][0].update(lost="all"),
        lambda f: f["summary"]["limits"]["lost"].update(kept=1),
    ]),
    "mined/mined.json": ("mined", [
        lambda f: f.pop("files"), lambda f: f["parts"][0].update(hours="many"), lambda f: f["parts"][0].pop("content"),
    ]),
}  # fmt: skip


@pytest.mark.parametrize("file", WRITTEN)
def test_what_was_written_is_valid_and_what_was_altered_is_not(out: Path, file: str) -> None:
    name, alterations = WRITTEN[file]
    said = content(out / file)
    jsonschema.validate(said, schema_of(name))
    for alter in alterations:
        altered = copy.deepcopy(said)
        alter(altered)
        assert altered != said
        assert not valid(name, altered)


@pytest.mark.parametrize("file", [file for file, (name, _) in WRITTEN.items() if name != "jscen"])
def test_what_was_written_is_read_and_written_again_the_same(out: Path, file: str) -> None:
    form = FORMATS[WRITTEN[file][0]]
    if form.sealed:
        again = json_text(sealed(to_json(read_sealed_json(out / file, form.kind, "resim", ""))))
    else:
        again = json_text(to_json(read_json(out / file, form.kind, "resim", "")))
    assert again == (out / file).read_text(encoding="utf-8")


def test_every_kind_of_file_has_a_schema_that_knows_no_other_fields() -> None:
    for name in FORMATS:
        assert schema_of(name)["additionalProperties"] is False, name
