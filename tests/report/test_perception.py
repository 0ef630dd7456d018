"""The page of a perception model."""

from __future__ import annotations

import dataclasses
import json

import pytest
from conftest import ROOT

from resim.ingest import read_recording
from resim.perception.model import read_model
from resim.perception.validation import judge
from resim.report import write_perception_page


@pytest.fixture(scope="module")
def model():
    return read_model(ROOT / "adfunc" / "perception" / "proving_ground.json")


@pytest.fixture(scope="module")
def found(model):
    return judge(
        model, [read_recording(ROOT / "scenarios" / n) for n in ("cut_in_brake", "overtake")], seeds=1
    )


def test_the_page_tells_measured_beside_model_and_every_parameter(model, found, tmp_path):
    pages = []
    for name in "ab":
        write_perception_page(model, found, tmp_path / name)
        pages.append((tmp_path / name).read_text(encoding="utf-8"))
    assert pages[0] == pages[1]
    body = pages[0][pages[0].index("<main>") :]
    assert [f'id="{name}"' in body for name in ("errors", "correlation", "dropouts")] == [True] * 3
    speed = f"{found.quantities['speed'].wasserstein:.4f}"
    for text in ("longitudinal [m]", "latency.speed", f"{model.latency.speed:.4g}", speed):
        assert text in body
    assert '<p id="dropouts">There are no drop-outs: nothing was lost, measured or in the model.</p>' in body
    assert "longitudinal: lag [s]" in body


def test_a_report_is_json_and_drop_outs_are_drawn(model, found, tmp_path):
    assert json.loads(json.dumps(dataclasses.asdict(found)))["drives"] == 2
    lossy = dataclasses.replace(
        found, dropouts_measured=(0.2, 0.4), dropouts_model=(0.3,), detected=(0.9, 0.8)
    )
    write_perception_page(model, lossy, tmp_path / "page")
    body = (tmp_path / "page").read_text(encoding="utf-8")
    assert "objects are detected 90.0 % of the time, in the model 80.0 %; 2 drop-outs, in the model 1" in body
    assert "nothing was lost" not in body
    assert '<div id="dropouts"' in body
