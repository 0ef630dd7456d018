"""The page of a perception model."""

from __future__ import annotations

import dataclasses
import json

import pytest
from conftest import ROOT
from hostile import HOSTILE, figures_of, harmless
from lxml import html

from resim.perception.model import FailedAssumption, LeftOut, ModelFit, read_model
from resim.perception.validation import judge
from resim.recordings import read_recording
from resim.report.perception import write_perception_page


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
    assert "longitudinal: lag [s]" in str(figures_of(html.fromstring(body)))


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


def test_the_page_says_whether_the_model_fits_and_what_was_left_out(model, found, tmp_path):
    assert model.training is not None
    misfit = FailedAssumption(
        quantity="speed", assumption="bias", on="speed", size=0.7, unit="m/s", p=1e-6, text="speed is <3 %> too high"
    )  # fmt: skip
    part = LeftOut(what="samples", reason="outliers", count=7, of=900)
    pages = []
    for fit in (None, ModelFit(drives=10, tests=90), ModelFit(drives=10, tests=90, misfits=(misfit,))):
        training = model.training.model_copy(update={"fit": fit, "left_out": (part,)})
        write_perception_page(model.model_copy(update={"training": training}), found, tmp_path / "page")
        pages.append((tmp_path / "page").read_text(encoding="utf-8"))
    assert "whether the model fits was not tested" in pages[0]
    assert "no misfit found by 90 tests on 10 drives." in pages[1]
    assert "the model does not fit: 1 of 90 tests on 10 drives fail." in pages[2]
    assert "<li>speed is &lt;3 %&gt; too high</li>" in pages[2]
    assert all("7 of 900" in page for page in pages)


def test_names_and_units_make_no_elements(model, found, tmp_path):
    trained = model.training
    if trained is not None:
        known = {name + HOSTILE: value for name, value in trained.estimates.items()}
        trained = trained.model_copy(update={"estimates": known})
    evil = model.model_copy(update={"name": HOSTILE, "provenance": HOSTILE, "training": trained})
    quantities = {k + HOSTILE: dataclasses.replace(a, unit=HOSTILE) for k, a in found.quantities.items()}
    latencies = {k + HOSTILE: v for k, v in found.latencies.items()}
    write_perception_page(
        evil, dataclasses.replace(found, quantities=quantities, latencies=latencies), tmp_path / "p"
    )
    harmless((tmp_path / "p").read_text(encoding="utf-8"))
