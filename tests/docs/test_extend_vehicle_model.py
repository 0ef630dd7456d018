"""A new vehicle model, as docs/extend/vehicle_model.md says."""

from __future__ import annotations

import json

import pytest
from extend import Extended, extended


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Extended:
    return extended("vehicle_model.md", tmp_path_factory.mktemp("vehicle"))


def test_its_code_and_its_test_are_as_ours(copy: Extended) -> None:
    copy.check()


def test_the_help_lists_it(copy: Extended) -> None:
    for command in ("run", "verify", "sweep"):
        told = "".join(copy.resim(command, "--help").split())  # a name may be broken at its hyphen
        assert "kinematic,single-track,point." in told


@pytest.mark.slow
def test_it_moves_the_ego(copy: Extended) -> None:
    copy.commands("vehicle_model.md")
    told = json.loads((copy.folder / "out" / "point" / "run.json").read_text())
    assert told["vehicle"] == "point"
    report = json.loads((copy.folder / "out" / "point" / "report.json").read_text())
    assert report["decision"]["rGT"][0] == "brake"
