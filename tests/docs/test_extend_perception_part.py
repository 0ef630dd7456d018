"""A new part of perception, as docs/extend/perception_part.md says."""

from __future__ import annotations

import json

import pages
import pytest
from extend import Extended, extended
from pages import DOCS

HASHES = """
import sys
from pathlib import Path
from resim.perception.model import read_model
from resim.perception.parameters import unit
print(*(read_model(path).hash for path in sorted(Path("adfunc/perception").glob("*.json"))))
print(unit("haze.visibility"), file=sys.stderr)
"""


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Extended:
    return extended("perception_part.md", tmp_path_factory.mktemp("part"))


@pytest.mark.slow
def test_its_code_and_its_test_are_as_ours(copy: Extended) -> None:
    copy.check()


@pytest.mark.slow
def test_a_run_takes_its_parameter(copy: Extended) -> None:
    (model,) = pages.blocks(DOCS / "extend" / "perception_part.md", "json")
    (copy.folder / "hazy.json").write_text(model, encoding="utf-8")
    copy.commands("perception_part.md")
    told = json.loads((copy.folder / "out" / "hazy" / "report.json").read_text())["perception"]
    (seed,) = told["seeds"]
    assert told["model"]["set"] == ["haze.visibility=150"]
    assert seed["failure"] in (None, "")


def test_a_wrong_parameter_is_told_by_its_name(copy: Extended) -> None:
    words = ("scenarios/rear_end", "--build", "adfunc/builds/highway_pilot-1.0.toml", "--out", "out/wrong")
    model = "adfunc/perception/none.json"
    done = copy.run("-m", "resim", "run", *words, "--perception", model, "--set", "haze.visibility=-1")
    assert (done.returncode, "haze.visibility: " in done.stderr) == (2, True), done.stderr


def test_models_without_it_keep_their_hash(copy: Extended) -> None:
    from resim.perception.model import read_model

    done = copy.run("-c", HASHES)
    shipped = sorted((copy.folder / "adfunc" / "perception").glob("*.json"))
    assert done.stdout.split() == [read_model(path).hash for path in shipped], done.stderr
    assert done.stderr.strip() == "m"
