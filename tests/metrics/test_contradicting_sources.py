"""Rows and sources that contradict each other: nobody knows who is right, and who passes is in doubt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from metrics.conftest import TRAFFIC
from metrics.passing import T, V, ego, noisy, rows, standing

from resim.metrics.criteria import read_criteria
from resim.recordings.checks import CODES
from resim.resimulation import AssessmentOptions, assess_recording, load_checked


def collision(found):
    return found["no collision"].outcome


def aside(y=-12.0):
    return rows("1", 400.0, y)


def lead():
    return rows("2", 330.0 + V * T, -1.75, V)


@pytest.mark.parametrize("later", [1e-9, 4e-7, 1e-5, 1e-3, 0.01, 0.02, 0.03])
@pytest.mark.parametrize("every", [1, 3, 20])
def test_who_hops_between_two_places_is_at_one_of_them(judge, later, every):
    """Between samples of the EGO the other is in its way, each time or seldom."""
    hops = standing().assign(t=T + later)[(np.arange(len(T)) % every == 0) & (T < 8.0)]
    assert collision(judge(ego(), standing())) == "FAIL"
    assert collision(judge(ego(), aside())) == "PASS"
    assert collision(judge(ego(), aside(), hops)) != "PASS"


def test_rows_with_a_place_alone_count_where_it_contradicts_the_others(judge):
    assert collision(judge(ego(), aside(), standing().assign(t=T + 4e-7, v=np.nan))) == "INVALID"
    assert collision(judge(ego(), aside(), aside(-12.5).assign(t=T + 4e-7, v=np.nan))) == "PASS"


def test_noise_of_half_a_metre_is_no_hop(judge):
    assert collision(judge(ego(), noisy(aside(), 0.2))) == "PASS"


@pytest.mark.parametrize("rest", ["whole", "no v", "a while"])
@pytest.mark.parametrize("source", ["gt", "sd"])
def test_repeated_rows_that_were_accepted_leave_open_which_is_right(judge, rest, source):
    second = standing().assign(v=np.nan) if rest == "no v" else standing()
    tables = ego(), lead(), aside(), second[(T > 4.0) & (T < 6.0)] if rest == "a while" else second
    if source == "gt":
        assert collision(judge(*tables)) == "INVALID"
    else:
        assert collision(judge(ego(), lead(), aside(), sd=tables)) == "INVALID"


def test_an_empty_row_among_them_hides_nothing(judge, tmp_path):
    empty = standing().assign(x=np.nan, y=np.nan, heading=np.nan, v=np.nan)
    assert collision(judge(ego(), aside(), standing(), empty)) == "INVALID"
    with pytest.raises(Exception, match=r"DUPLICATE_SAMPLES: .* with other values \(y by up to 6.75\)"):
        load_checked(tmp_path)


@pytest.mark.parametrize("lasts", [3.0, 4.2])
@pytest.mark.parametrize("lacks", ["nothing", "v"])
def test_a_truth_that_ends_before_the_sensor_data_is_cut_short(judge, lasts, lacks):
    cut, more = lasts > T, [standing(), lead()]
    if lacks == "v":
        more = [table.assign(v=table.v.mask(~cut)) for table in more]
    truth = ego()[cut], standing()[cut], lead()[cut]
    assert collision(judge(*truth)) == "PASS"
    assert collision(judge(*truth, sd=more)) == "INVALID"
    late = T > 5.5
    assert collision(judge(ego()[late], standing()[late], lead()[late], sd=more)) == "INVALID"


def test_sensor_data_that_end_before_the_truth_are_cut_short(judge, tmp_path):
    cut = T < 3.0
    sd = ego()[cut], standing()[cut], lead()[cut]
    assert collision(judge(ego(), lead(), sd=sd)) == "INVALID"
    found = assess_recording(load_checked(tmp_path), AssessmentOptions())
    assert found.blocks["GT"].measures
    whole = ego(), standing().assign(y=-12.0), lead()
    assert collision(judge(*whole, sd=tuple(table[T < 8.9] for table in whole))) == "PASS"


@pytest.mark.parametrize("source", ["gt", "sd"])
def test_of_who_is_told_a_hundred_times_too_small_nobody_knows_the_size(judge, source):
    small = rows("1", 400.0, -7.1, length=0.047, width=0.019)
    assert collision(judge(ego(), rows("1", 400.0, -7.1))) == "FAIL"
    if source == "gt":
        assert collision(judge(ego(), small, lead())) == "INVALID"
    else:
        assert collision(judge(ego(), lead(), aside(), sd=(ego(), small, lead()))) == "INVALID"


def test_a_stated_rate_bridges_no_gap_of_the_ego(judge, tmp_path):
    there = (T < 3.0) | (T > 6.5)
    judge(ego()[there], standing(), sd=(standing(),))
    recording = replace(load_checked(tmp_path, accept=tuple(CODES)), gt_rate=0.1)
    known = recording.ego_at(np.array([2.0, 5.0, 7.0])).valid[0]
    assert known.tolist() == [True, False, True]


@pytest.mark.parametrize("plans", [(0.0, 2.9, "PASS"), (0.0, 8.8, "INVALID")])
def test_plans_that_are_made_after_the_truth_ends_show_that_it_is_cut_short(judge, tmp_path, plans):
    first, last, outcome = plans
    cut = T < 3.0
    judge(ego()[cut], standing()[cut], lead()[cut])
    made = np.arange(first, last, 0.2)
    pd.DataFrame({"t": made, "t_plan": made + 1.0, "x": 300.0 + V * (made + 1.0), "y": -5.25, "v": V}).to_csv(
        tmp_path / "plan.csv", index=False
    )
    found = assess_recording(load_checked(tmp_path), AssessmentOptions(criteria=read_criteria(TRAFFIC)))
    assert collision(found.blocks["GT"].verdicts) == outcome


def test_an_ego_that_the_sensor_data_have_elsewhere_is_in_doubt(judge):
    beside = ego(y=-5.25), lead(), standing().assign(id="s1", gt_id="ego")
    own = [table.assign(gt_id=table.id) if "gt_id" not in table else table for table in beside[1:]]
    assert collision(judge(ego(), lead(), sd=own)) == "INVALID"
    near = [table.assign(gt_id=table.id) for table in (ego().assign(x=lambda e: e.x - 2.0), lead())]
    assert collision(judge(ego(), lead(), sd=near)) == "PASS"
