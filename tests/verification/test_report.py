"""verification.json is read back by field, as it was written; what is none is refused with the field."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from conftest import ROOT
from resealed import edit

import resim
from resim.core.errors import InputError
from resim.core.json_text import json_text
from resim.core.sealed import sealed
from resim.core.spec import sealed_schema
from resim.verification import folder
from resim.verification.cases import VerificationCase, kept
from resim.verification.entries import RecordingSource, VerifiedRecording
from resim.verification.folder import read, text
from resim.verification.report import VerificationReport
from resim.verification.request import VerifyOptions

PILOT = ROOT / "adfunc" / "builds" / "highway_pilot-1.0.toml"
MODEL = ROOT / "adfunc" / "perception" / "proving_ground.json"
SUITE = """name = "two"
criteria = "{root}/scenarios/criteria/highway.toml"
agreement = 0.5
recording = [{{folder = "{root}/scenarios/cut_in_brake"}}, {{folder = "nowhere"}}]
"""

Change = Callable[[dict[str, Any]], Any]


@pytest.fixture(scope="module")
def verified(tmp_path_factory: pytest.TempPathFactory) -> resim.Verification:
    """A drive that is judged by seeds, and a recording that is not there."""
    folder = tmp_path_factory.mktemp("verified")
    (folder / "suite.toml").write_text(SUITE.format(root=ROOT), encoding="utf-8")
    asked = VerifyOptions(perception=MODEL, seeds=5)
    return resim.verify(folder / "suite.toml", PILOT, folder / "out", asked, workers=1)


@pytest.fixture
def written(verified: resim.Verification, tmp_path: Path) -> Path:
    path = tmp_path / "verification.json"
    path.write_bytes((verified.folder / "verification.json").read_bytes())
    return path


def test_it_is_read_back_as_it_was_written(verified: resim.Verification, written: Path) -> None:
    again = read(written)
    assert again == verified.report
    assert text(again) == written.read_text(encoding="utf-8")
    judged, failed = again.recordings
    assert isinstance(judged, VerifiedRecording)
    assert judged.decision.over_seeds is not None
    assert len(judged.seeds) == len(judged.reaction.each()["rGT+M"])
    assert (failed.verdict, failed.reports) == ("error", ())


def test_its_schema_is_that_of_the_file(written: Path) -> None:
    found = json.loads(written.read_text())
    jsonschema.validate(found, sealed_schema(VerificationReport))
    found["recordings"][0]["verdict"] = "fine"
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(found, sealed_schema(VerificationReport))


CHANGES: dict[str, Change] = {
    "recordings.0.verified.verdict": lambda f: f["recordings"][0].update(verdict="fine"),
    "recordings.0.verified.kpis": lambda f: f["recordings"][0].pop("kpis"),
    "recordings.0.verified.mood": lambda f: f["recordings"][0].update(mood="good"),
    "recordings.0.verified.reaction.GT": lambda f: f["recordings"][0]["reaction"].update(GT="1.0"),
    "recordings.1.failed.crashed": lambda f: f["recordings"][1].update(crashed=0),
    "summary.measured.good": lambda f: f["summary"].update(good="yes"),
    "inputs.build.hash": lambda f: f["inputs"]["build"].pop("hash"),
    "schema": lambda f: f.update(schema="resim-verification-9"),
    "recordings": lambda f: f.update(recordings=[]),
}


@pytest.mark.parametrize("field", CHANGES)
def test_what_is_none_is_refused_with_the_field(written: Path, field: str) -> None:
    edit(written, CHANGES[field])
    with pytest.raises(
        InputError, match=rf"is not what `resim verify` writes: .*{field.replace('.', '[.]')}"
    ):
        read(written)


def test_a_kept_case_is_read_by_field(verified: resim.Verification, tmp_path: Path) -> None:
    (file,) = (verified.folder / "cases").glob("*.json")
    (tmp_path / "cases").mkdir()
    copy = tmp_path / "cases" / file.name
    copy.write_bytes(file.read_bytes())
    judged, key = verified.report.recordings[0], json.loads(file.read_text())["key"]
    source, damaged = RecordingSource(judged.name, judged.folder, judged.hash), list[Path]()
    case = kept(tmp_path, source, key, damaged.append)
    assert isinstance(case, VerificationCase)
    assert case.entry.verdict == judged.verdict
    assert kept(tmp_path, source, "0" * 64, damaged.append) is None
    assert damaged == []
    edit(copy, lambda said: said["entry"].update(way="straight on"))
    assert kept(tmp_path, source, key, damaged.append) is None
    assert damaged == [copy]


def test_what_somebody_puts_into_the_folder_meanwhile_stays(
    verified: resim.Verification, tmp_path: Path
) -> None:
    """And what the verification wrote of another suite before goes, if nothing leads to it any more."""
    out = tmp_path / "out"
    shutil.copytree(verified.folder, out)
    asked = verified.report.inputs
    other = {"gone": next(iter(asked.recordings.values()))}
    folder.begin(out, asked.model_copy(update={"recordings": other}))
    (out / "cases" / "gone.json").write_text("{}")
    folder.begin(out, asked)
    notes = out / "cases" / "notes.txt"
    notes.touch()
    (out / "drives" / "mine").mkdir()
    folder.write(out, verified.report, {})
    assert notes.is_file()
    assert (out / "drives" / "mine").is_dir()
    assert not (out / "cases" / "gone.json").exists()
    assert (out / "inputs.json").read_bytes() == (verified.folder / "inputs.json").read_bytes()


def test_names_that_a_verification_never_writes_are_not_deleted(
    verified: resim.Verification, tmp_path: Path
) -> None:
    """Whoever hands over a folder can state any names in it."""
    out, mine = tmp_path / "out", tmp_path / "mine.txt"
    shutil.copytree(verified.folder, out)
    mine.write_text("precious")
    names = ["../mine.txt", str(mine), "cases/../../mine.txt", "verification.json", "cases/..", 5, "x" * 5000]
    said = json.loads((out / "inputs.json").read_text())
    del said["checksum"]
    said["files"] += names
    (out / "inputs.json").write_text(json_text(sealed(said)))
    folder.begin(out, verified.report.inputs)
    folder.write(out, verified.report, {})
    assert mine.read_text() == "precious"
    assert (out / "verification.json").is_file()
    for inputs in ([], {"build": "x"}):
        said["inputs"] = inputs
        (out / "inputs.json").write_text(json_text(sealed(said)))
        with pytest.raises(InputError):
            folder.begin(out, verified.report.inputs)
