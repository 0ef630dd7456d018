"""Sources that tell a drive that collides as one that passes: by doubles, classes, noise, and where rows end."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from metrics.passing import T, V, across, braking, ego, lead_that_is_lost, noisy, rows, standing, under

from resim.core.objects import ObjectIds
from resim.core.tracks import Tracks
from resim.recordings.checked import repair_recording
from resim.recordings.checks import CODES
from resim.resimulation import AssessmentOptions, assess_recording, load_checked


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


@pytest.mark.parametrize("rate", [3.0, 9.7])
def test_an_ego_that_stands_in_for_sensor_data_is_there_as_often_as_it_is_in_the_ground_truth(judge, rate):
    """In the GT the EGO is at 10 Hz, two others at 50 Hz: the rate of most rows is not the EGO's."""

    def at(t, name, x, y=-5.25, v=0.0):
        sides = {"heading": 0.0, "length": 4.7, "width": 1.9, "kind": "car"}
        return pd.DataFrame({"t": np.round(t, 6), "id": name, "x": x, "y": y, "v": v, **sides})

    seldom, often, sensed = (
        np.arange(0.0, 5.91, 0.1),
        np.arange(0.0, 5.901, 0.02),
        np.arange(0.0, 6.0, 1.0 / rate),
    )
    beside = [at(often, name, 310.0 + 10.0 * n + V * often, -1.75, V) for n, name in enumerate("23")]
    lead = at(sensed, "1", np.full(len(sensed), 300.0 + V * 5.5 + 4.7))
    found = judge(at(seldom, "ego", 300.0 + V * seldom, v=V), *beside, sd=(lead,))
    assert collision(found) in ("FAIL", "INVALID")


def test_a_contradiction_of_a_part_of_the_track_is_no_usual_error(judge):
    """The lead's places leave its heading sideways at 0.1 rad from 3.5 s on; the EGO, at 30 m/s, reaches it at 7 s."""
    fast, lead = rows("ego", 300.0 + 30.0 * T, v=30.0), rows("1", 339.7 + 25.0 * T, v=25.0)
    assert collision(judge(fast, lead)) == "FAIL"
    assert collision(judge(fast, lead.assign(y=lead.y - 2.4 * np.clip(T - 3.5, 0.0, None)))) == "INVALID"
    skewed = lead.assign(y=-8.75, heading=0.04)  # as it is throughout
    assert collision(judge(fast, skewed)) == "PASS"


@pytest.mark.parametrize("seed", range(4))
def test_a_place_in_doubt_along_the_told_heading_is_so_where_the_trace_is_turned(judge, seed):
    """A motorcycle crosses; its place is held, but for 2 cm, for the last half of the drive."""
    half, rng = T < 5.01, np.random.default_rng(seed)
    rider = rows(
        "1", 396.5, -5.25 + 8.0 * (T - 4.7), 8.0, heading=np.pi / 2, length=2.2, width=0.8, kind="motorcycle"
    )
    assert collision(judge(ego()[half], rider[half])) == "FAIL"
    still = T > 2.5
    places = {
        c: rider[c].mask(still & (c == "y")).ffill() + still * rng.normal(0.0, 0.02, len(T)) for c in "xy"
    }
    assert collision(judge(ego()[half], rider.assign(**places)[half])) == "INVALID"


def test_a_second_detection_with_another_heading_or_at_other_times_is_in_doubt_as_well(judge):
    own = ego().assign(gt_id="ego")
    along = rows("1", 400.0, 0.0, length=12.0, width=2.5, kind="truck")
    over = along.assign(heading=np.pi / 2, id="b", gt_id="1")[T > 1.0]
    assert collision(judge(ego(), along, sd=(own, along.assign(id="a", gt_id="1"), over))) == "INVALID"
    near = [rows("1", 400.0, y).assign(t=T + late, id=name, gt_id="1")
            for name, y, late in (("a", -8.75, 0.0), ("b", -6.85, 0.02))]  # fmt: skip
    assert collision(judge(ego(), rows("1", 400.0, -7.8), sd=(own, *near))) == "INVALID"


@pytest.mark.parametrize("lacks", ["v", "x", "rows"])
def test_an_ego_at_2_hz_that_lacks_a_value_for_its_last_second_is_cut_off(judge, lacks):
    seldom = np.isin(np.round(T / 0.04).astype(int), np.round(np.arange(0.0, 5.01, 0.52) / 0.04).astype(int))
    drive, lead = ego()[seldom], rows("1", 300.0 + V * 4.4 + 4.7)[seldom]
    assert collision(judge(drive, lead)) == "FAIL"
    late = drive.t > 3.9
    cut = drive[~late] if lacks == "rows" else drive.assign(**{lacks: drive[lacks].mask(late)})
    assert collision(judge(cut, lead)) == "INVALID"


def test_repairs_of_rows_after_the_ego_s_last_sample_change_nothing(judge, tmp_path):
    ahead = rows("1", 340.0 + V * T, v=V)
    judge(ego()[T < 4.0], ahead[(T < 5.0) | (T > 5.5)])
    repair_recording(tmp_path, tmp_path.with_name("repaired"))
    found = assess_recording(
        load_checked(tmp_path.with_name("repaired"), accept=tuple(CODES)), AssessmentOptions()
    )
    assert found.blocks["GT"].measures


@pytest.mark.parametrize("drift", [0.1 * T, 0.15 * np.sin(2.0 * T), 0.5 / (1.0 + np.exp(4.0 * (4.0 - T)))])
def test_who_stands_across_and_drifts_along_the_ego_s_way_is_not_turned_out_of_it(judge, drift):
    """A trace lies along its way, and its box with it: 12 m across the lane were 2.5 m beside it."""
    assert judge(ego(), across())["time to collision"].outcome == "FAIL"
    assert judge(ego(), across(x=400.0 + drift))["time to collision"].outcome == "INVALID"
    assert judge(ego(), across(x=400.0 + drift, y=12.0))["time to collision"].outcome == "PASS"
