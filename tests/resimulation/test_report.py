"""report.json says a re-simulation, and is read back as it was written."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest
from conftest import ROOT

import resim
from resim.core.errors import InputError
from resim.core.spec import json_schema, read_json, to_json
from resim.resimulation import PerceptionSetup, ResimulationOptions
from resim.resimulation.report import RunReport
from resim.results import write_json

BUILD = ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml"
MODEL = ROOT / "adfunc" / "perception" / "proving_ground.json"


@pytest.fixture(scope="module")
def report() -> RunReport:
    seen = PerceptionSetup(resim.read_model(MODEL), (0, 1), ("latency.speed=0.4",), "ab" * 32)
    return resim.resimulate(
        ROOT / "scenarios" / "cut_in_brake", BUILD, ResimulationOptions(bases=("GT",)), perception=seen
    ).report


@pytest.fixture
def written(report: RunReport, tmp_path: Path) -> Path:
    write_json(to_json(report), tmp_path / "report.json")
    return tmp_path / "report.json"


def read(path: Path) -> RunReport:
    return read_json(path, RunReport, "resim run", "Run it again.")


def test_it_is_read_back_as_it_was_written(report: RunReport, written: Path) -> None:
    again = read(written)
    assert again.perception == report.perception
    assert again.errors == report.errors
    assert again.findings == report.findings
    write_json(to_json(again), written.with_name("again.json"))
    assert written.with_name("again.json").read_bytes() == written.read_bytes()


def test_its_schema_is_that_of_the_file(written: Path) -> None:
    jsonschema.validate(json.loads(written.read_text()), json_schema(RunReport))


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('"ego": "ego"', '"ego": 7', "ego"),
        ('"end": "duration"', '"end": "vanished"', "end"),
        ('"reaction": {', '"reactions": {', "reaction"),
        ('"seed": 0', '"seed": "0"', "seed"),
        ('"doubts": {', '"doubts": {"XX": {},', "doubts"),
    ],
)
def test_what_is_no_report_is_refused_with_the_field(written: Path, old: str, new: str, told: str) -> None:
    text = written.read_text()
    assert old in text
    written.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=rf"report\.json: is not what `resim run` writes: .*{told}"):
        read(written)
