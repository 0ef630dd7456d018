"""Objects that vanish, lack values or change size: what they could have broken is INVALID, and nothing else."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from metrics.passing import (
    HIT,
    T,
    V,
    across,
    aside,
    braking,
    ego,
    held,
    lead_that_is_lost,
    noisy,
    rows,
    standing,
    under,
)  # fmt: skip

from resim.core.objects import ObjectIds
from resim.core.spec import exactly, to_json
from resim.core.tracks import Tracks
from resim.metrics.doubts.reach import MOST, Reach
from resim.metrics.doubts.unseen import Absence, absences


def without_speed(car):
    return car.assign(v=np.nan)


def without_place(car):
    near = (car.t - HIT).abs() < 1.5
    return car.assign(x=car.x.mask(near), y=car.y.mask(near))


def away(half):
    return lambda car: car[(car.t - HIT - 0.3).abs() > half]


def late(car):
    return car[car.t > HIT + 1.0]


def gone(car):
    return car[car.t < HIT - 3.0]


def once(car):
    return car[car.t == 4.0]


VANISHES = {
    "its speed is blank": (without_speed, "from 0.00 to 9.00 s: its rows lack v"),
    "its position is blank around the contact": (without_place, "from 3.24 to 6.28 s: its rows lack x, y"),
    "left out for 1.1 s": (away(0.55), "from 4.48 to 5.64 s: not seen"),
    "left out for 6 s": (away(3.0), "from 2.04 to 8.08 s: not seen"),
    "never seen again": (gone, "from 1.76 to 9.00 s: not seen"),
    "not seen before": (late, "from 0.00 to 5.80 s: not seen"),
    "seen once": (once, "from 0.00 to 9.00 s: not seen"),
}  # fmt: skip


def absence(t, state):
    return Absence(
        object="1", start=0.0, end=float(t[-1]), why="", straight=False, size=(4.7, 1.9), t=t, state=state
    )


def test_whole_it_fails(judge):
    assert judge(ego(), standing())["no collision"].outcome == "FAIL"


@pytest.mark.parametrize("how", VANISHES)
def test_who_vanishes_where_the_ego_hits_him_makes_what_he_could_break_invalid(judge, how):
    change, reason = VANISHES[how]
    found = judge(ego(), change(standing()))
    assert found["no collision"].outcome == "INVALID"
    assert found["no collision"].reason == f"object 1 {reason}; it may have exceeded the limit, above 0"
    assert found["time to collision"].outcome in ("INVALID", "FAIL")
    for alone in ("hard braking", "on the road"):
        assert found[alone].outcome == "PASS"


def test_the_same_holds_of_sensor_data(judge):
    whole = ego(), standing()
    found = judge(*whole, sd=(ego(), away(3.0)(standing())))
    assert found["no collision"].outcome == "INVALID"


@pytest.mark.parametrize("y", [-1.5, 1.75, 12.0])
def test_beside_the_ego_a_short_gap_says_nothing_of_a_collision(judge, y):
    beside = rows("1", 310.0 + V * T, y, V)
    found = judge(ego(), beside[(beside.t - 5.0).abs() > 0.55])
    assert found["no collision"].outcome == found["time headway"].outcome == "PASS"


def test_a_gap_that_can_be_bridged_is_bridged(judge):
    beside = rows("1", 340.0 + V * T, v=V)
    assert {v.outcome for v in judge(ego(), beside[(beside.t - 5.0).abs() > 0.45]).values()} == {"PASS"}


def test_who_is_far_away_and_oncoming_invalidates_nothing(judge):
    away_ = rows("1", 800.0 - 15.0 * T, 15.0, 15.0, heading=np.pi)
    assert {v.outcome for v in judge(ego(), away_[(away_.t - 3.0).abs() > 1.0]).values()} == {"PASS"}


def test_a_gap_counts_to_the_time_that_a_limit_is_broken(judge):
    """0.5 s headway for 2 s, 1.5 s not seen, then 2 s again: 3 s are not to be broken."""
    ahead = rows("1", 310.0 + 4.7 + V * T, v=V)
    ahead = ahead[(ahead.t > 1.0) & (ahead.t < 3.0) | (ahead.t > 4.5) & (ahead.t < 6.5)]
    found = judge(ego(), ahead)
    assert found["time headway"].outcome == "INVALID"
    assert "it may have exceeded the limit, below 0.54 s" in found["time headway"].reason


def test_who_leaves_ahead_of_everybody_at_the_end_of_an_area_is_not_missed(judge):
    """A camera over 300 to 480 m: each leaves there; the EGO last."""
    cars = [rows(str(k), 310.0 + 15.0 * k + V * T, v=V) for k in range(1, 5)]
    cars = [car[car.x < 480.0] for car in (*cars, ego())]
    assert {v.outcome for v in judge(*cars).values()} == {"PASS"}


def test_who_goes_out_of_range_is_not_missed_but_who_vanishes_before_it_is(judge):
    faster = rows("1", 340.0 + 26.0 * T, v=26.0)
    ranged = faster[faster.x - 300.0 - V * T < 80.0]
    farther = rows("2", 384.0 + V * T, -1.75, V)  # in the next lane, and shows how far is seen
    assert judge(ego(), ranged, farther)["no collision"].outcome == "PASS"
    near = rows("1", 315.0 + V * T, v=V)
    assert judge(ego(), near, farther)["no collision"].outcome == "PASS"
    assert judge(ego(), near[near.t < 4.0], farther)["no collision"].outcome == "INVALID"
    assert judge(ego(), near[near.t > 4.0], farther)["no collision"].outcome == "INVALID"


def test_who_is_lost_alone_where_nobody_is_seen_farther_on_has_left_nothing(judge):
    """The EGO follows a car that brakes, and hits it in its own last sample, beyond which nobody ever is."""
    lead = braking(2.2)
    hit = T[np.argmax(lead.x - ego().x < 4.7)]
    assert judge(*(table[table.t <= hit] for table in (ego(), lead)))["no collision"].outcome == "FAIL"
    for before in (1.5, 0.9, 0.4, 0.04):
        seen = lead[lead.t <= hit - before + 1e-9]
        found = judge(ego()[ego().t <= hit], seen)["no collision"]
        assert (before, found.outcome) == (before, "INVALID")


def test_who_is_first_seen_alone_where_nobody_is_seen_before_came_from_nowhere_known(judge):
    """A slower car right behind the EGO, which overlaps it when the drive begins, and is first seen later."""
    behind = rows("1", 297.0 + 12.0 * T, v=12.0)
    assert judge(ego(), behind)["no collision"].outcome == "FAIL"
    for late in (0.3, 0.6):
        assert judge(ego(), behind[behind.t >= late])["no collision"].outcome == "INVALID"


def test_who_is_lost_with_others_at_one_moment_is_lost_by_the_sensor():
    """Three side by side; the EGO ends short of the line at which they were lost."""
    abreast = [rows(str(k), 340.0 + V * T, -5.25 + 3.5 * k, V) for k in range(3)]
    drive = pd.concat([ego()[ego().t < 5.9], *(car[car.t < 4.0] for car in abreast)])
    found = absences(ObjectIds.of(Tracks.from_frame(drive), ego="ego"))[0]
    assert [a.object for a in found] == ["0", "1", "2"]


def test_how_far_is_seen_is_not_shown_by_who_vanishes_there(judge):
    faster = rows("1", 340.0 + 26.0 * T, v=26.0)
    assert judge(ego(), faster[faster.x - 300.0 - V * T < 60.0])["no collision"].outcome == "INVALID"


def test_who_goes_on_under_another_id_is_not_missed(judge):
    ahead = rows("1", 330.0 + V * T, v=V)
    found = judge(ego(), ahead[ahead.t < 4.0], ahead[ahead.t > 4.1].assign(id="2"))
    assert {v.outcome for v in found.values()} == {"PASS"}


def test_who_goes_on_under_another_id_after_the_contact_is_missed_in_between(judge):
    car = standing()
    found = judge(ego(), car[car.t < HIT - 0.1], car[car.t > HIT + 0.7].assign(id="2"))
    assert found["no collision"].outcome == "INVALID"
    assert found["no collision"].reason.startswith("object 1 from 4.64 to 5.48 s: not seen")


def test_the_last_moment_before_the_recording_ends_counts(judge):
    car, end = standing(), HIT + 0.5
    drive = [table[table.t < end] for table in (ego(), car[car.t < HIT - 0.3])]
    assert judge(*drive)["no collision"].outcome == "INVALID"
    blank = ego()
    blank.loc[blank.t > HIT - 0.3, "v"] = np.nan
    assert judge(blank[blank.t < end], car[car.t < end])["no collision"].outcome == "INVALID"


def test_an_ego_that_has_no_whole_rows_at_its_end_passes_nothing(judge):
    me = ego()
    me.loc[me.t > 6.0, "v"] = np.nan
    found = judge(me, rows("1", 500.0 + V * T, v=V))
    assert {v.outcome for v in found.values()} == {"INVALID"}
    assert "object ego from 6.00 to 9.00 s: its rows lack v" in found["hard braking"].reason


def test_a_size_in_doubt_is_judged_by_the_largest(judge):
    """The EGO scrapes along a car whose width is wrong in its first row."""
    car, y = standing(), -5.25 + 1.6
    assert judge(ego(y), car)["no collision"].outcome == "FAIL"
    wrong = car.astype({"width": float})
    wrong.loc[wrong.index[0], "width"] = 0.3
    found = judge(ego(y), wrong)
    assert found["no collision"].outcome == "INVALID"
    assert found["no collision"].reason.startswith(
        "size in doubt: 1 (up to 4.70 x 1.90 m); with boxes that large: FAIL"
    )
    assert judge(ego(y + 3.0), wrong)["no collision"].outcome == "PASS"


def test_nobody_who_keeps_the_acceleration_is_outside_of_his_reach():
    """Random motions, integrated step by step, against the discs."""
    rng = np.random.default_rng(5)
    h, n = 1e-3, 4000
    for _ in range(40):
        angle, size = rng.uniform(0.0, 2.0 * np.pi, 8), MOST * rng.uniform(0.0, 1.0, 8) ** 0.25
        a = np.repeat(np.column_stack([size * np.cos(angle), size * np.sin(angle)]), n // 8, axis=0)
        v0 = rng.uniform(-20.0, 20.0, 2)
        v = v0 + np.concatenate([np.zeros((1, 2)), np.cumsum(a, axis=0) * h])
        x = np.concatenate([np.zeros((1, 2)), np.cumsum(0.5 * (v[1:] + v[:-1]), axis=0) * h])
        ends = np.array([0, n])
        state = np.column_stack([x[ends], np.zeros(2), v[ends]])
        t = np.arange(n + 1) * h
        reach = Reach.of(
            absence(t[ends], state),
            t[::50],
        )
        off = np.hypot(*np.moveaxis(reach.centre - x[::50, None], 2, 0))
        assert (off <= reach.radius).all()
        faster = np.hypot(*np.moveaxis(reach.velocity - v[::50, None], 2, 0))
        assert (faster <= reach.spread + 1e-9).all()


def test_the_reach_in_the_middle_is_a_sixteenth_of_what_it_would_be_free_to_end():
    state = np.array([[0.0, 0.0, 0.0, 10.0, 0.0], [60.0, 0.0, 0.0, 10.0, 0.0]])
    reach = Reach.of(
        absence(np.array([0.0, 6.0]), state),
        np.array([3.0]),
    )
    assert reach.centre[0, 2] == pytest.approx([30.0, 0.0])
    assert reach.radius[0, 2] == pytest.approx(MOST * 36.0 / 16.0 + 0.2)


def test_absences_survive_their_file():
    car = standing()
    tracks = Tracks.from_frame(pd.concat([ego(), away(3.0)(car)]))
    (one,) = absences(ObjectIds.of(tracks, without_speed(car[car.t == 5.0]), ego="ego"))[0]
    again = exactly(to_json(one), Absence)
    assert (again.object, again.start, again.end, again.why) == (one.object, one.start, one.end, one.why)
    assert np.array_equal(again.t, one.t)
    assert np.array_equal(again.state, one.state, equal_nan=True)


def test_who_brakes_unseen_and_never_comes_back_can_have_stood_there(judge):
    lead = braking(2.2)
    assert judge(ego(), lead)["no collision"].outcome == "FAIL"
    found = judge(ego(), lead[lead.t < 2.0])
    assert [found[name].outcome for name in ("no collision", "time to collision")] == ["INVALID"] * 2


def test_another_in_the_next_lane_is_not_who_vanished(judge):
    lead = braking(2.2)
    decoy = rows("7", 340.0 + V * T, -1.75, V)
    found = judge(ego(), lead[lead.t < 2.0], decoy[decoy.t > 2.9])
    assert found["no collision"].outcome == "INVALID"


def test_whose_place_is_never_known_can_have_broken_everything(judge, tmp_path):
    criteria = tmp_path / "own.toml"
    measures = {"THW": 0.9, "gap ahead": 5.0, "PMD": 1.0}
    text = "".join(
        f'[[criterion]]\nname = "{name}"\nmeasure = "{name}"\nbelow = {limit}\nsource = "test"\n'
        for name, limit in measures.items()
    )
    criteria.write_text(f'name = "own"\n{text}')
    found = judge(ego(), standing().assign(x=np.nan, y=np.nan), criteria=criteria)
    assert {name: verdict.outcome for name, verdict in found.items()} == dict.fromkeys(measures, "INVALID")


def standing_beside(y=-8.75):
    """Who stands in the next lane, where the EGO passes him."""
    return rows("1", 400.0, y)


def thrown(car):
    near = (car.t - HIT).abs() < 0.6
    return car.assign(x=car.x.mask(near, 1e7))


def frozen(car):
    """He comes into the EGO's lane from the right; his position stays as it was for 2.5 s around the contact."""
    y = -14.0 + 2.0 * np.clip(car.t - 1.5, 0.0, 4.0)
    held = (car.t > HIT - 1.5) & (car.t < HIT + 1.0)
    return car.assign(
        y=y.mask(held).ffill(), v=np.where((car.t > 1.5) & (car.t < 5.5), 2.0, 0.0), heading=np.pi / 2
    )


def jumps(car):
    """He stands in the EGO's lane, and is 3.5 m aside from one sample to the next."""
    return car.assign(y=np.where(car.t < 2.0, -5.25, -8.75))


@pytest.mark.parametrize(
    ("how", "reason"),
    [
        (thrown, "away from its positions, or these contradict each other; it may have exceeded the limit"),
        (frozen, "place in doubt: 1 (by "),
        (jumps, "place in doubt: 1 (by 3.50 m)"),
    ],
)
def test_whose_place_is_in_doubt_makes_what_he_could_break_invalid(judge, how, reason):
    found = judge(ego(), how(standing()))
    assert found["no collision"].outcome == "INVALID"
    assert reason in found["no collision"].reason
    assert found["hard braking"].outcome == "PASS"


def test_a_place_in_doubt_by_less_than_matters_changes_nothing(judge):
    far = standing_beside(-15.0)
    assert (
        judge(ego(), jumps(far).assign(y=np.where(T < 2.0, -15.0, -16.5)))["no collision"].outcome == "PASS"
    )


@pytest.mark.parametrize("there", [T < HIT - 1.5, T > HIT + 1.0])
def test_an_ego_whose_rows_end_while_others_are_seen_is_invalid(judge, there):
    found = judge(ego()[there], standing())
    assert {v.outcome for v in found.values()} == {"INVALID"}
    assert "object ego from" in found["no collision"].reason


def test_an_ego_that_leaves_where_others_leave_is_whole(judge):
    """Who is seen up to 400 m leaves there, and so do two others after it and one before."""
    others = [
        rows(f"{n}", 300.0 + V * T - gap, y, V)
        for n, gap, y in ((1, -30.0, -8.75), (2, 30.0, -5.25), (3, 50.0, -8.75))
    ]
    area = [rows_[rows_.x <= 400.0] for rows_ in (ego(), *others)]
    assert judge(*area)["no collision"].outcome == "PASS"


def test_a_range_that_one_other_shows_is_none(judge):
    """A lead that is lost 55 m ahead, while one other car is seen up to 57 m."""
    lead = rows("1", 355.0 + 1.01 * V * T, v=1.01 * V)
    other = rows("2", 357.0 + V * T, -8.75, V)
    assert judge(ego(), lead[lead.t < 2.0], other)["no collision"].outcome == "INVALID"


def test_who_he_was_before_does_not_show_a_range(judge):
    lead = rows("1", 355.0 + 1.01 * V * T, v=1.01 * V)
    seen = [
        lead[(begin <= T) & (end > T)].assign(id=n)
        for n, begin, end in (("1", 0, 1), ("2", 1, 1.5), ("3", 1.5, 2))
    ]
    assert judge(ego(), *seen)["no collision"].outcome == "INVALID"


def test_two_do_not_go_on_as_one(judge):
    """Who stands in the EGO's way, and who stands beside it, become one new object: that beside it."""
    small = {"length": 0.5, "width": 0.5, "kind": "pedestrian"}
    inside, beside = (rows(name, 400.0, y, **small) for name, y in (("1", -5.7), ("2", -6.6)))
    assert judge(ego(), inside, beside)["no collision"].outcome == "FAIL"
    new = beside.assign(id="3")
    found = judge(ego(), inside[T < 2.9], beside[T < 2.9], new[T >= 2.9])
    assert found["no collision"].outcome == "INVALID"
    assert "object 1 from 2.88" in found["no collision"].reason


def test_an_ego_with_few_samples_is_cut_off_as_others_are(judge):
    few = ego()[(np.arange(len(T)) % 24 == 0) & (T < HIT - 0.9)]
    assert judge(few, standing())["no collision"].outcome == "INVALID"


def test_an_ego_that_the_sensor_loses_is_cut_off_in_its_data(judge):
    whole = ego(), standing()
    found = judge(*whole, sd=(ego()[T < HIT - 1.0].assign(gt_id="ego"), standing().assign(gt_id="1")))
    assert found["no collision"].outcome == "INVALID"


def test_a_place_that_is_repeated_while_he_drives_is_none(judge):
    """Who walks into the EGO's way, and stays where he was from 1.8 s on, though his speed goes on."""
    walks = rows("1", 400.0, -14.0 + 1.8 * T, 1.8, length=0.5, width=0.5, kind="pedestrian").assign(
        heading=np.pi / 2
    )
    assert judge(ego(), walks)["no collision"].outcome == "FAIL"
    held = walks.assign(y=walks["y"].mask(walks["t"] > 1.8).ffill())
    assert judge(ego(), held)["no collision"].outcome == "INVALID"
    tracks = Tracks.from_frame(pd.concat([ego(), held]))
    before = tracks.valid.copy()
    assert absences(ObjectIds.of(tracks, ego="ego"))[0]
    assert np.array_equal(tracks.valid, before)  # what is looked at stays as it is


def test_jumps_add_up(judge):
    """A slower lead is 3.2 m aside after four jumps, and the EGO passes where it was."""
    lead = rows("1", 350.0 + 10.0 * T, v=10.0)
    assert judge(ego(), lead)["no collision"].outcome == "FAIL"
    aside = sum(np.where(1.0 + 0.4 * k < T, 0.8, 0.0) for k in range(4))
    found = judge(ego(), lead.assign(y=lead["y"] - aside))["no collision"]
    assert found.outcome == "INVALID"
    assert "1 (by 3.20 m)" in found.reason


@pytest.mark.parametrize("pause", [0.0, 0.4])
def test_an_object_under_two_ids_breaks_a_limit_as_one(judge, tmp_path, pause):
    """A lead 15 m ahead for the whole drive is known by another id from 4.5 s on."""
    criteria = tmp_path / "long.toml"
    criteria.write_text(
        'name = "c"\n[[criterion]]\nname = "gap"\nmeasure = "gap ahead"\nbelow = 15.0\nduration = 6.0\n'
    )
    lead = rows("1", 318.0 + V * T, v=V)
    assert judge(ego(), lead, criteria=criteria)["gap"].outcome == "FAIL"
    found = judge(ego(), lead[T < 4.5], lead.assign(id="2")[4.5 + pause < T], criteria=criteria)["gap"]
    assert found.outcome == "INVALID"
    assert "objects 1, 2 can be one" in found.reason


def seam():
    """Two pass the seam of two cameras at 470 m; at that place a slow lead is lost, and stops."""
    slow = rows("1", 450.0 + 5.0 * np.minimum(T, 4.5), v=np.where(T < 4.5, 5.0, 0.0))
    others = [
        rows(n, 470.0 + V * (T - at), -5.25 + y, V) for n, at, y in (("2", 1.5, 13.0), ("3", 3.0, 17.0))
    ]
    for car, at in zip(others, (1.5, 3.0), strict=True):
        car["id"] = np.where(at < T, car["id"] + "b", car["id"])
    return [slow[T <= 4.0], *others]


def walker(speed=1.5):
    return rows(
        "1",
        400.0,
        -5.25 + speed * (T - 4.7),
        speed,
        heading=np.pi / 2,
        length=0.5,
        width=0.5,
        kind="pedestrian",
    )


def swerving():
    """Oncoming; swerves into the EGO's lane."""
    tau = np.clip((T - 2.0) / 2.0, 0.0, 1.0)
    y, vy = 1.75 - 7.0 * tau**2 * (3.0 - 2.0 * tau), -21.0 * tau * (1.0 - tau)
    return rows("1", 490.0 - V * T, y, np.hypot(V, vy), heading=np.arctan2(vy, -V))


SCRAPED = rows("1", 360.0 + 8.0 * T, -5.25 + 2.2, 8.0, width=2.6)
ONE_OBJECT = {
    "another under two ids shows no range": lambda: [
        lead_that_is_lost()[T < 2.0],
        *under(rows("2", 357.0 + 1.02 * V * T, -1.75, 1.02 * V), ("2", 0, 3.6), ("2b", 3.6, 9.1)),
    ],
    "his own ids before pauses show no range": lambda: under(
        lead_that_is_lost(5.0), ("a", 0.0, 0.4), ("b", 1.6, 2.0), ("c", 3.2, 3.7)
    ),
    "jumps where ids change add up": lambda: under(
        aside(braking(2.2), 0.9, 1.2, 1.8, 2.3), ("1", 0, 1.2), ("2", 1.2, 1.8), ("3", 1.8, 2.3), ("4", 2.3, 9.1)
    ),
    "a jump is that of the next id as well": lambda: under(
        aside(braking(2.2), 1.97, 2.0), ("1", 0, 2.5), ("2", 2.5, 9.1)
    ),
    "so is a size": lambda: under(
        SCRAPED.assign(width=np.where(T < 4.0, 2.6, 1.9)), ("1", 0, 4.0), ("2", 4.0, 9.1)
    ),
    "rows that stay where they were are no leaving": lambda: [
        held(lead_that_is_lost(), 2.0, "x")[T < 2.6],
        *(rows(n, 357.0 + V * T, y, V) for n, y in (("2", -1.75), ("3", 1.75))),
    ],
}  # fmt: skip
CONTRADICTIONS = {
    "frozen but for 1 mm, walking": lambda: held(walker(), 1.0, "x", "y", noise=1e-3),
    "frozen but for 3 cm, walking": lambda: held(walker(), 1.0, "x", "y", noise=0.03),
    "frozen, walking slowly": lambda: held(walker(0.95), 1.0, "x", "y"),
    "frozen but for 2 cm, oncoming": lambda: held(swerving(), 1.6, "x", "y", noise=0.02),
    "frozen aside, by the heading he swerves": lambda: held(swerving(), 1.6, "y"),
    "driven on while by its speed it brakes": lambda: braking(2.2).assign(x=340.0 + V * T),
    "heading leaps": lambda: across(heading=np.where(T < 2.0, np.pi / 2, 0.0)),
    "heading flickers": lambda: across(heading=np.where(np.arange(len(T)) % 12 > 0, 0.0, np.pi / 2)),
    "turns on the spot": lambda: across(heading=np.clip(np.pi / 2 - 0.7 * (T - 1.0), 0.0, np.pi / 2)),
    "length and width exchanged": lambda: across(length=2.5, width=12.0),
}  # fmt: skip
WHOLE = {
    "brakes": lambda: braking(2.2), "is scraped": lambda: SCRAPED, "walks": walker,
    "walks slowly": lambda: walker(0.95), "swerves": swerving, "stands across": across,
    "is lost ahead": lead_that_is_lost,
}  # fmt: skip


@pytest.mark.parametrize("who", WHOLE)
def test_all_of_these_are_hit(judge, who):
    assert judge(ego(), WHOLE[who]())["no collision"].outcome == "FAIL"


@pytest.mark.parametrize("how", ONE_OBJECT)
def test_ids_that_are_one_object_are_judged_as_one(judge, how):
    assert judge(ego(), *ONE_OBJECT[how]())["no collision"].outcome == "INVALID"


def test_ids_that_change_at_a_seam_show_no_edge(judge):
    drive = [table[table.t < 8.45] for table in (ego(), *seam())]  # the EGO itself does not come past it
    assert judge(*drive)["no collision"].outcome == "INVALID"


@pytest.mark.parametrize("how", CONTRADICTIONS)
def test_whose_columns_contradict_each_other_is_in_doubt(judge, how):
    found = judge(ego(), CONTRADICTIONS[how]())["no collision"]
    assert found.outcome == "INVALID"
    assert "in doubt" in found.reason or "away from its positions" in found.reason


def test_an_ego_whose_place_is_held_while_it_drives_passes_nothing(judge):
    assert judge(held(ego(), 2.0, "x", noise=1e-3), braking(2.2))["no collision"].outcome == "INVALID"


IDS = {
    "and lost": [("1", 0.0, 1.6), ("2", 1.6, 2.1)],
    "first seen late": [("1", 1.2, 1.7), ("2", 1.7, 3.3)],
    "a new one each sample": [(str(n), when - 0.01, when + 0.01) for n, when in enumerate(T)],
}  # fmt: skip


@pytest.mark.parametrize("how", IDS)
def test_what_is_seen_under_all_ids_and_not_seen_lasts_together(judge, how):
    """9 m behind a lead for 3.3 s: 0.54 s headway are not to be kept for 3 s."""
    drive, lead = ego()[T < 3.3], rows("1", 313.7 + V * T, v=V)[T < 3.3]
    criterion = "time headway"
    assert judge(drive, lead)[criterion].outcome == "FAIL"
    assert judge(drive, *under(lead, *IDS[how]))[criterion].outcome == "INVALID"


def turning_truck():
    """Turns right onto another road at 2 m/s, 20 m beside the EGO's lane."""
    angle = np.clip(0.1 * T, 0.0, np.pi / 2)
    return rows(
        "1",
        380.0 + 20.0 * np.sin(angle),
        -40.0 - 20.0 * (1.0 - np.cos(angle)),
        2.0,
        heading=-angle,
        length=12.0,
    )


def late_speed():
    """Brakes in the next lane; a filter tells its speed 0.6 s late."""
    car = braking(2.2).assign(y=-8.75)
    return car.assign(v=np.interp(T - 0.6, T, car.v))


def walks_along(name, y):
    return rows(name, 330.0 + 1.3 * T, y, 1.3, length=0.5, width=0.5, kind="pedestrian")


HONEST = {
    "noise of 5 cm": lambda: [noisy(rows("1", 340.0 + V * T, -8.75, V))],
    "an id that changes": lambda: under(noisy(rows("1", 340.0 + V * T, -8.75, V), 0.03), ("1", 0, 4), ("2", 4, 9.1)),
    "brakes beside": lambda: [noisy(braking(2.2).assign(y=-8.75))],
    "a speed that is told late": lambda: [late_speed()],
    "a truck that turns": lambda: [turning_truck()],
    "a pedestrian who stands": lambda: [
        noisy(rows("1", 400.0, -8.75, length=0.5, width=0.5, kind="pedestrian"), 0.02, heading=2.0)
    ],
    "a car that stands, with a noisy heading": lambda: [noisy(standing_beside(), 0.02, heading=0.05)],
    "a car that reverses, with a speed above 0": lambda: [
        rows("1", 420.0 - 2.0 * T, -8.75, 2.0),
    ],
    "beside the EGO, in lists out of phase": lambda: [rows("1", 300.0 + V * T, -7.75, V).iloc[2::3]],
    "a speed that is 3 % off": lambda: [rows("1", 340.0 + V * T, -8.75, 1.03 * V)],
    "two pedestrians side by side who both change ids": lambda: [
        *under(walks_along("1", -11.0), ("1", 0, 4), ("3", 4, 9.1)),
        *under(walks_along("2", -11.7), ("2", 0, 4), ("4", 4, 9.1)),
    ],
    "leaves the range after two others": lambda: [
        car[car.x - 300.0 - V * T < 80.0]
        for car in (rows(str(n), 340.0 + 5.0 * n + 26.0 * T, y, 26.0) for n, y in ((1, -5.25), (2, -8.75), (3, -1.75)))
    ],
}  # fmt: skip


@pytest.mark.parametrize("how", HONEST)
def test_honest_tables_stay_pass(judge, how):
    found = judge(ego(), *HONEST[how]())
    assert {name: v.outcome for name, v in found.items() if v.outcome != "PASS"} == {}
