"""The page of an assessment."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from conftest import ROOT
from hostile import HOSTILE, figures_of, harmless
from lxml import html as parser

from resim.metrics.criteria import read_criteria
from resim.report import write_assessment_page
from resim.report.assessment.marks import least, marked
from resim.resimulation import AssessmentOptions, assess_folder

HIGHWAY = ROOT / "scenarios" / "criteria" / "highway.toml"


@pytest.fixture(scope="module")
def collision():
    return assess_folder(ROOT / "scenarios" / "rear_end", AssessmentOptions(criteria=read_criteria(HIGHWAY)))


def html(assessed, folder):
    write_assessment_page(assessed, folder / "page.html")
    return (folder / "page.html").read_text(encoding="utf-8")


def test_verdicts_curves_scenes_and_worst_values_stand_on_the_page(collision, tmp_path):
    text = html(collision, tmp_path)
    body = text[text.index("<main>") :]
    assert [f'id="{name}"' in body for name in ("risk", "scenes-GT", "scenes-SD")] == [True] * 3
    assert "✕ FAIL" in body
    assert "✓ PASS" in body
    assert re.search(
        r"collision above 0 for [\d.]+ s<br><span class=\"note\">worst: 1 at 4\.7 s, object 1<", body
    )
    assert re.search(
        r"✕ FAIL</span><br>TTC below 1\.5 s for 1\.6 s<br><span class=\"note\">worst: 0 s at 4\.8 s, object 1<",
        body,
    )
    assert "risk above 0.1 for " in body
    figures = str(figures_of(parser.fromstring(body)))
    assert ", risk 1'" in figures
    assert re.findall(r"risk \[?[\d.]* ?%", body + figures) == []  # a share, as in the criteria
    assert "②" in body + figures  # before, and the collision: there is nothing after it
    assert not re.findall(r'(?:src|href)="https?:', body)
    assert html(collision, tmp_path) == text


def test_marked_scenes_are_before_at_and_after_the_largest_risk(collision):
    gt = collision.blocks["GT"]
    scenes = marked(gt)
    peak = int(gt.risk.r_ind.argmax())
    assert peak in scenes
    assert gt.risk.r_ind[scenes[0]] <= 0.1 * gt.risk.r_ind[peak]
    calm = replace(gt, risk=replace(gt.risk, r_ind=np.zeros(len(gt.risk.r_ind))))
    assert marked(calm) == [0, (len(gt.drive.t) - 1) // 2, len(gt.drive.t) - 1]


def test_the_least_of_no_object_is_none(collision):
    gt = collision.blocks["GT"]
    ttc = gt.measures["TTC"]
    empty = replace(ttc, value=ttc.value[:, :0], state=ttc.state[:, :0])
    alone = replace(gt, measures={**gt.measures, "TTC": empty})
    assert np.isnan(least(alone, "TTC")).all()
    assert np.nanmin(least(gt, "TTC")) == np.nanmin(ttc.value)


def test_without_criteria_it_says_so(tmp_path):
    text = html(assess_folder(ROOT / "scenarios" / "overtake", AssessmentOptions()), tmp_path)
    assert "no criteria were given" in text
    assert "PASS" not in text[text.index("<main>") :]


OWN = """name = {text}
[[measure]]
name = {text}
function = "hostile_measures:beside"
unit = {text}
kind = "quantitative"
worst = "low"
[[criterion]]
name = {text}
measure = {text}
below = 5.0
source = {text}
[[criterion]]
name = "risk"
measure = "risk"
above = 0.9
"""


def test_names_units_and_sources_make_no_elements(collision, tmp_path):
    """The unit of an own measure once ran as a script in four pages."""
    (tmp_path / "hostile_measures.py").write_text("def beside(drive, network):\n    return drive.t\n")
    text = json.dumps(HOSTILE)
    (tmp_path / "own.toml").write_text(OWN.format(text=text))
    found = assess_folder(
        ROOT / "scenarios" / "rear_end", AssessmentOptions(criteria=read_criteria(tmp_path / "own.toml"))
    )
    blocks = {}
    for name, a in found.blocks.items():
        verdicts = {k: replace(v, reason=HOSTILE, object=HOSTILE) for k, v in a.verdicts.items()}
        drive = replace(a.drive, ids=tuple(i + HOSTILE for i in a.drive.ids))
        blocks[name] = replace(a, drive=drive, verdicts=verdicts)
    evil = replace(found, name=HOSTILE, findings=(HOSTILE,), failures={"GT": HOSTILE}, blocks=blocks)
    page = harmless(html(evil, tmp_path))
    assert HOSTILE.replace("\x1b", "") in page.xpath("//h1")[0].text
