"""Sources that tell a drive that collides as one that passes: by doubles, classes, noise, and where rows end."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from metrics.passing import T, V, across, braking, ego, lead_that_is_lost, noisy, rows, standing, under

from resim.core.objects import ObjectIds
from resim.core.tracks import Tracks


def collision(found):
    return found["no collision"].outcome


def other(name, along, y=-1.75):
    """A little faster than the EGO, so that it is as far as the lead is lost."""
    return rows(name, 350.0 + along + 1.02 * V * T, y, 1.02 * V)


@pytest.mark.parametrize("apart", [2.2, 4.0, 5.5])
def test_one_other_that_is_reported_twice_does_not_show_the_range(judge, apart):
    lead = lead_that_is_lost()
    assert collision(judge(ego(), lead)) == "FAIL"
    assert collision(judge(ego(), lead[T < 2.0], other("2", 0.0), other("3", apart))) == "INVALID"
    two = other("2", 0.0), other("3", 0.0, 1.75)
    assert collision(judge(ego(), lead[T < 2.0], *two)) == "PASS"


def turned_truck(**columns):
    """A truck that stands across the EGO's lane, and is told along it for most of the time."""
    return across(heading=np.where(T < 2.0, np.pi / 2, 0.0), **columns)


@pytest.mark.parametrize("last", [0.04, 3.0])
def test_a_truck_is_no_pedestrian_by_a_part_of_its_ids(judge, last):
    parts = under(turned_truck(), ("1", 0.0, 9.04 - last), ("2", 9.04 - last, 9.1))
    for called in (("pedestrian", "truck"), ("truck", "pedestrian"), ("pedestrian", "pedestrian")):
        told = [part.assign(kind=kind) for part, kind in zip(parts, called, strict=True)]
        assert collision(judge(ego(), *told)) == "INVALID", called


def test_a_truck_is_no_pedestrian_by_its_first_rows(judge):
    truck = turned_truck(kind=np.where(T < 5.0, "pedestrian", "truck"))
    assert collision(judge(ego(), truck)) == "INVALID"


@pytest.mark.parametrize("first", [1, 2, 3])
def test_who_is_told_seldom_is_looked_at_until_the_ego_s_last_sample(judge, first):
    """The EGO touches him at 4.765 s, after he was told last, and ends at 4.8 s."""
    ends = T < 4.81
    seldom = standing()[ends].iloc[first::5]
    assert 4.8 - 0.2 < seldom.t.max() < 4.765
    assert collision(judge(ego()[ends], standing()[ends])) == "FAIL"
    assert collision(judge(ego()[ends], seldom)) == "INVALID"


def test_who_is_told_seldom_beside_the_ego_makes_nothing_invalid(judge):
    seldom = rows("1", 300.0 + V * T, -7.75, V).iloc[2::5]
    assert {v.outcome for v in judge(ego(), seldom).values()} == {"PASS"}


@pytest.mark.parametrize("sigma", [0.1, 0.2, 0.3])
def test_noise_does_not_hide_that_places_and_speeds_part_for_long(judge, sigma):
    """By its speed the lead drives 1.4 m/s slower than its places say, from 1 s on: 12 m in all."""
    slower = rows("1", 309.0 + V * T, v=V - 1.4 * (T > 1.0))
    by_speed = slower.assign(x=309.0 + V * T - 1.4 * np.clip(T - 1.0, 0.0, None))
    assert collision(judge(ego(), by_speed)) == "FAIL"
    assert collision(judge(ego(), noisy(slower, sigma))) == "INVALID"


def test_a_noisy_honest_lead_stays_pass(judge):
    for sigma in (0.05, 0.1, 0.2):
        assert collision(judge(ego(), noisy(rows("1", 330.0 + V * T, v=V), sigma))) == "PASS"
        assert collision(judge(ego(), noisy(braking(2.2).assign(y=-8.75), 0.5 * sigma))) == "PASS"


@pytest.mark.parametrize("lacks", ["v", "heading", "x"])
def test_others_whose_rows_lack_a_value_show_as_well_that_the_ego_is_cut_off(judge, lacks):
    cut = T <= 4.5
    rest = standing().assign(**{lacks: lambda car: car[lacks].mask(~cut)})
    assert collision(judge(ego()[cut], rest)) == "INVALID"


@pytest.mark.parametrize("when", ["after", "before"])
def test_sensor_data_without_the_ego_last_as_long_as_it_drives(judge, when):
    """The sensor loses all at once, or sees nobody at first: the EGO hits the car that stands."""
    seen = (T < 3.0) if when == "after" else (T > 5.4)
    lead, beside = standing(), rows("2", 330.0 + V * T, 1.75, V)
    whole = judge(ego(), lead, beside, sd=(lead, beside))
    assert collision(whole) == "FAIL"
    assert collision(judge(ego(), lead, beside, sd=(lead[seen], beside[seen]))) == "INVALID"


def criteria_of(folder, side, limit, measure="gap ahead"):
    path = folder / "criteria.toml"
    path.write_text(
        f'name = "c"\n[[criterion]]\nname = "no collision"\nmeasure = "{measure}"\n{side} = {limit}\nsource = "test"\n'
    )
    return path


def leading(gap=30.0):
    return rows("1", 300.0 + 4.7 + gap + V * T, v=V)


@pytest.mark.parametrize(("measure", "limit"), [("gap ahead", 40.0), ("THW", 2.0)])
def test_a_limit_above_is_in_doubt_where_a_place_is(judge, tmp_path, measure, limit):
    """The lead is told 30 m ahead; by its speed it is up to 50 m ahead."""
    criteria = criteria_of(tmp_path, "above", limit, measure)
    assert collision(judge(ego(), leading(), criteria=criteria)) == "PASS"
    assert collision(judge(ego(), leading(50.0), criteria=criteria)) == "FAIL"
    slower = leading().assign(v=V + 2.5 * (T > 3.0))
    assert collision(judge(ego(), slower, criteria=criteria)) == "INVALID"


def test_a_limit_above_is_in_doubt_while_somebody_is_not_seen(judge, tmp_path):
    criteria = criteria_of(tmp_path, "above", 40.0)
    gone = leading()[(T < 3.0) | (T > 6.0)]
    assert collision(judge(ego(), gone, criteria=criteria)) == "INVALID"


def test_a_limit_above_is_not_kept_by_who_is_beyond_the_horizon(judge, tmp_path):
    criteria = criteria_of(tmp_path, "above", 5.0, "THW")
    assert collision(judge(ego(), leading(60.0), criteria=criteria)) == "PASS"
    assert collision(judge(ego(), leading(800.0), criteria=criteria)) == "INVALID"


def test_a_measure_of_one_s_own_of_places_alone_is_in_doubt_where_a_place_is(judge, tmp_path):
    (tmp_path / "own.py").write_text(
        "import numpy as np\n\n\ndef apart(drive, road):\n    t = drive.tracks\n"
        "    return np.hypot(t.x - t.x[:1], t.y - t.y[:1])[1:].T\n"
    )
    path = tmp_path / "criteria.toml"
    path.write_text(
        'name = "c"\n[[measure]]\nname = "apart"\nfunction = "own:apart"\nunit = "m"\nworst = "low"\n'
        '[[criterion]]\nname = "no collision"\nmeasure = "apart"\nbelow = 0.0\nsource = "test"\n'
    )
    assert collision(judge(ego(), leading(), criteria=path)) == "PASS"
    assert collision(judge(ego(), leading().assign(v=V + 2.5 * (T > 3.0)), criteria=path)) == "INVALID"


@pytest.mark.parametrize("as_", [{"kind": "truck"}, {"length": 12.0, "width": 2.5}, {"width": 0.6}])
def test_somebody_else_who_begins_where_one_was_lost_is_not_the_same(judge, as_):
    """The lead is lost and brakes; somebody of another kind or size begins where it would be, beyond it."""
    lead = braking(2.2)
    one = rows("2", 340.0 + V * T, v=V, **as_)
    assert collision(judge(ego(), lead[T < 2.0], one[T > 2.5])) == "INVALID"
    tracks = Tracks.from_frame(pd.concat([ego(), lead[T < 2.0], one[T > 2.5]]).sort_values("t"))
    whom = ObjectIds.of(tracks, ego="ego")
    assert [k.ids for k in whom.others] == [("1",), ("2",)]
    assert whom.same == (("1", "2"),)


@pytest.mark.parametrize("late", [0.0, 4.5])
def test_a_second_detection_of_one_object_puts_its_place_in_doubt(judge, late):
    """The sensor sees the standing car twice, 3.5 m apart; the shorter track is dropped."""
    lead = standing()
    aside = lead.assign(y=-8.75, id="s1", gt_id="1")
    there = lead[late + 0.1 < T].assign(id="s2", gt_id="1")
    own = ego().assign(gt_id="ego")
    assert collision(judge(ego(), lead, sd=(own, aside, there))) == "INVALID"
    near = lead[late + 0.1 < T].assign(y=-8.55, id="s2", gt_id="1")
    assert collision(judge(ego(), lead, sd=(own, aside, near))) == "PASS"
