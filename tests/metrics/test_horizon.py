"""Limits beyond the usual 4 s and 150 m: judged as far ahead as they need, or INVALID."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from conftest import ROOT

from resim.metrics.criteria import Criteria
from resim.metrics.criteria_file import Criterion
from resim.metrics.drive import drive
from resim.metrics.measures.horizon import LONGEST
from resim.metrics.measures.inputs import MeasureInputs
from resim.recordings.checks import CODES
from resim.resimulation import AssessmentOptions, assess_recording, load_checked

GROUND = ROOT / "networks" / "proving_ground.xodr"
T = np.round(np.arange(0.0, 3.001, 0.04), 2)
V, GAP = 20.0, 160.0
"""m/s of the EGO, and m of the gap to a car that stands, at the first time: TTC = THW = 8 ... 5 s."""


def rows(name, x, v, t=T):
    y, size = -5.25, {"length": 4.7, "width": 1.9}
    return pd.DataFrame({"t": t, "id": name, "x": x, "y": y, "heading": 0.0, "v": v, **size, "kind": "car"})


@pytest.fixture
def judge(tmp_path):
    """Judge one limit over the EGO that comes nearer to the car, of which the rows after `until` [s] are missing."""

    def of(measure, until=9.0, gap=GAP, v=0.0, **limit):
        ego, t = rows("ego", 300.0 + V * T, V), T[until >= T]
        car = rows("1", 300.0 + gap + 4.7 + v * t, v, t)
        far = rows("2", 2000.0 + 40.0 * T, 40.0).assign(y=-8.75)
        both = pd.concat([ego, car, far]).sort_values("t", kind="stable")
        (tmp_path / "recording.toml").write_text(f'name = "d"\nmap = "{GROUND}"\nego = "ego"\n')
        both.to_csv(tmp_path / "gt.csv", index=False)
        criteria = Criteria("one", (Criterion(name="one", measure=measure, **limit),))
        how = AssessmentOptions(criteria=criteria, only=())
        return assess_recording(load_checked(tmp_path, accept=tuple(CODES)), how).blocks["GT"].verdicts["one"]

    return of


@pytest.mark.parametrize(
    ("measure", "limit", "outcome", "value"),
    [
        ("TTC", {"below": 7.0}, "FAIL", 5.0),
        ("TTC", {"below": 7.0, "duration": 2.3}, "PASS", 5.0),
        ("TTC", {"below": 4.9}, "PASS", None),
        ("THW", {"below": 5.5}, "FAIL", 5.0),
        ("DRAC", {"above": 0.5}, "FAIL", V**2 / (2.0 * 100.0)),
        ("DRAC", {"above": 1.9}, "FAIL", 2.0),
        ("DRAC", {"above": 2.1}, "PASS", None),
        ("gap ahead", {"below": 155.0}, "FAIL", 100.0),
        ("half speedometer", {"below": 120.0}, "FAIL", 100.0 - 1.8 * V),
    ],
)
def test_a_limit_beyond_4_s_or_150_m_is_judged_as_far_ahead_as_it_needs(
    judge, measure, limit, outcome, value
):
    found = judge(measure, **limit)
    assert found.outcome == outcome
    assert found.value == (None if value is None else pytest.approx(value, rel=2e-3))


def test_a_gap_beyond_the_usual_range_is_seen_where_the_limit_asks_for_it(judge):
    assert judge("gap ahead", gap=400.0, below=345.0).value == pytest.approx(340.0, abs=0.01)
    assert judge("gap ahead", gap=400.0, below=335.0).outcome == "PASS"
    assert judge("gap ahead", gap=800.0, below=900.0).outcome == "INVALID"


@pytest.mark.parametrize("measure", ["ETTC", "PET", "TTB", "TTK", "TTS", "TTR", "WTTR"])
def test_what_cannot_be_looked_for_so_far_is_invalid(judge, measure):
    found = judge(measure, below=7.0)
    assert found.outcome == "INVALID"
    assert "shows only that it is not below" in found.reason
    assert "(objects 1" in found.reason
    assert judge(measure, below=1.0).outcome == "PASS"


def test_full_braking_may_have_to_begin_long_before_a_contact_that_is_later_than_the_horizon(judge):
    """Braking from 20 m/s with 8.5 m/s² takes 1.18 s of the time to the contact."""
    assert judge("TTB", below=2.8).outcome == "PASS"
    assert judge("TTB", below=2.85).outcome == "INVALID"


def test_a_limit_beyond_the_longest_look_is_never_kept(judge):
    assert judge("TTC", v=V, below=LONGEST + 1.0).outcome == "INVALID"
    assert judge("TTC", v=V, below=LONGEST - 1.0).outcome == "PASS"
    assert judge("DRAC", v=V, above=V / (2.0 * LONGEST) - 0.01).outcome == "INVALID"


def test_who_vanishes_can_be_met_as_late_as_the_limit_asks(judge):
    assert judge("TTC", until=1.0, below=4.0).outcome == "INVALID"  # he may have come nearer
    assert judge("THW", until=2.9, gap=300.0, below=13.0).outcome == "FAIL"
    assert judge("THW", until=1.0, gap=300.0, below=12.5).outcome == "INVALID"
    assert judge("ETTC", until=1.0, gap=4000.0, below=4.5).outcome == "INVALID"


@pytest.mark.parametrize(
    ("name", "side", "limit"),
    [
        ("TTC", "below", 4.0),
        ("TTC", "above", 9.0),
        ("DRAC", "above", 9.0),
        ("ETTC", "below", 9.0),
        ("PMD", "below", 9.0),
    ],
)
def test_nothing_is_looked_farther_for_than_its_limit_needs(described, network, name, side, limit):
    scenario = described("overtake")
    t = np.round(scenario.ego.spawn_time + np.arange(0.0, 1.0, 0.1), 9)
    inputs = MeasureInputs(drive(scenario.tracks(network, t), ego=scenario.ego.id), network)
    seen = inputs.definition(name).ahead(inputs, side, limit)
    assert (seen.horizon, seen.reach) == (pytest.approx(4.0), 150.0)
