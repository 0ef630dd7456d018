from __future__ import annotations

import numpy as np
import pytest
from conftest import ROOT

from resim.core.errors import InputError
from resim.metrics.criteria import judge, overall, read_criteria
from resim.metrics.criteria_file import Criterion
from resim.metrics.measures import MeasureValues, State

T = np.arange(50) * 0.1


def measure(value, state=None, *, bad="low"):
    value = np.asarray(value, dtype=float)
    state = np.where(np.isnan(value), State.NO_CONFLICT, State.VALUE) if state is None else state
    return MeasureValues("TTC", "s", value, np.asarray(state, dtype=np.uint8), bad)


def two(**change):
    """TTC of two objects: the first far away, the second at 1 s from 2.0 to 2.5 s, else none."""
    value = np.full((50, 2), np.nan)
    value[:, 0] = 3.0
    value[20:26, 1] = 1.0
    return judge(
        Criterion(name="ttc", measure="TTC", **{"below": 1.5, **change}), measure(value), T, ["far", "near"]
    )


def test_a_limit_that_is_broken_fails_with_value_time_and_object():
    found = two()
    assert (found.outcome, found.value, found.t, found.object) == ("FAIL", 1.0, pytest.approx(2.0), "near")
    assert (found.limit, found.unit) == (1.5, "s")
    assert found.reason == "below 1.5 s for 0.6 s"


@pytest.mark.parametrize(
    ("change", "outcome"),
    [({"duration": 0.5}, "FAIL"), ({"duration": 1.0}, "PASS"), ({"below": 0.9}, "PASS"), ({"end": 1.9}, "PASS"),
     ({"start": 2.6}, "PASS"), ({"start": 2.2, "duration": 0.35}, "FAIL"), ({"start": 9.0}, "INVALID")],
)  # fmt: skip
def test_duration_and_part_of_the_drive(change, outcome):
    assert two(**change).outcome == outcome


@pytest.mark.parametrize(
    ("duration", "outcome", "reason"),
    [
        (0.6, "FAIL", "below 1.5 s for 0.6 s"),
        (0.65, "FAIL", "below 1.5 s for up to 0.7 s"),  # kept at 1.9 and 2.6 s: up to 0.7 s between
        (0.69, "FAIL", "below 1.5 s for up to 0.7 s"),
        (0.7, "PASS", "below 1.5 s for 0.6 s only"),
    ],
)
def test_what_can_have_lasted_for_the_duration_fails(duration, outcome, reason):
    found = two(duration=duration)
    assert (found.outcome, found.reason) == (outcome, reason)


@pytest.mark.parametrize(
    ("change", "outcome", "reason"),
    [
        ({"duration": 4.9}, "FAIL", "below 1.5 s for 4.9 s"),
        (
            {"duration": 4.91},
            "INVALID",
            "below 1.5 s for 4.9 s; the drive has less than 4.91 s in this part",
        ),
        ({"start": 1.05, "end": 2.05, "duration": 1.0}, "FAIL", "below 1.5 s for 1.0 s"),
        (
            {"start": 1.0, "end": 2.0, "duration": 1.05},
            "INVALID",
            "below 1.5 s for 1.0 s; the drive has less than 1.05 s in this part",
        ),
    ],
)
def test_a_drive_breaks_no_limit_for_longer_than_it_lasts(change, outcome, reason):
    value = np.ones((50, 1))  # broken throughout: 4.9 s
    found = judge(Criterion(name="ttc", measure="TTC", below=1.5, **change), measure(value), T, ["a"])
    assert (found.outcome, found.reason) == (outcome, reason)


def test_beyond_counts_in_either_direction():
    value = np.zeros(50)
    value[10:15] = -4.0
    sway = MeasureValues("lateral acceleration", "m/s²", value, np.zeros(50, dtype=np.uint8), "both")
    found = judge(
        Criterion(name="sway", measure="lateral acceleration", beyond=3.0, duration=0.5), sway, T, []
    )
    assert (found.outcome, found.value, found.object) == ("FAIL", -4.0, "")
    assert found.reason == "beyond 3 m/s² for 0.5 s"
    one_way = Criterion(name="sway", measure="lateral acceleration", above=3.0)
    assert judge(one_way, sway, T, []).outcome == "PASS"


def test_a_failure_names_who_broke_the_limit_for_long_not_who_was_worst_for_a_moment():
    value = np.full((50, 2), 3.0)
    value[5, 0], value[20:30, 1] = 0.1, 1.2
    found = judge(
        Criterion(name="ttc", measure="TTC", below=1.5, duration=0.5), measure(value), T, ["a", "b"]
    )
    assert (found.outcome, found.object, found.value) == ("FAIL", "b", 1.2)
    brief = judge(
        Criterion(name="ttc", measure="TTC", below=1.0, duration=0.5), measure(value), T, ["a", "b"]
    )
    assert (brief.outcome, brief.value, brief.reason) == ("PASS", 0.1, "below 1 s for 0.1 s only")


def test_without_objects_there_is_no_conflict():
    none = np.empty((50, 0))
    found = judge(Criterion(name="ttc", measure="TTC", below=1.5), measure(none), T, [], none.astype(bool))
    assert (found.outcome, found.value, found.reason) == ("PASS", None, "no object")


def test_one_sample_can_fail():
    found = judge(Criterion(name="ttc", measure="TTC", below=1.5), measure([[1.0]]), T[:1], ["a"])
    assert (found.outcome, found.t) == ("FAIL", 0.0)


def test_what_was_not_computed_is_never_pass():
    value, state = np.full((50, 1), 3.0), np.zeros((50, 1))
    value[7], state[7] = np.nan, State.NOT_COMPUTED
    criterion = Criterion(name="ttc", measure="TTC", below=1.5)
    assert judge(criterion, measure(value, state), T, ["a"]).outcome == "INVALID"
    gone = state != State.NOT_COMPUTED
    assert judge(criterion, measure(value, state), T, ["a"], gone).outcome == "PASS"  # it was not there
    value[9] = 1.0
    assert judge(criterion, measure(value, state), T, ["a"]).outcome == "FAIL"


@pytest.mark.parametrize("start", [4.0, 4.041, 4.099])
def test_a_part_that_begins_between_two_scenes_has_the_one_before(start):
    """A contact between the scenes at 4.0 and 4.1 s stands at 4.0 s, and can lie in the part."""
    value = np.zeros((50, 1))
    value[40] = 1.0
    hit = measure(value, bad="high")
    assert judge(Criterion(name="hit", measure="x", above=0.5, start=start), hit, T, ["a"]).outcome == "FAIL"
    assert judge(Criterion(name="hit", measure="x", above=0.5, start=4.1), hit, T, ["a"]).outcome == "PASS"


def test_not_defined_anywhere_is_invalid_and_no_conflict_passes():
    criterion = Criterion(name="ttc", measure="TTC", below=1.5)
    nothing = np.full((50, 1), np.nan)
    undefined = np.full((50, 1), State.NOT_DEFINED)
    assert judge(criterion, measure(nothing, undefined), T, ["a"]).outcome == "INVALID"
    free = judge(criterion, measure(nothing), T, ["a"])
    assert (free.outcome, free.value, free.reason) == ("PASS", None, "no conflict")


def test_the_whole_verdict():
    good, bad = two(duration=1.0), two()
    lost = two(start=9.0)
    assert [overall(v) for v in ({"a": good}, {"a": good, "b": bad}, {"a": good, "c": lost})] == [
        "PASS",
        "FAIL",
        "INVALID",
    ]
    assert overall({"b": bad, "c": lost}) == "FAIL"


def test_what_ships_is_sound_and_says_where_its_limits_come_from():
    criteria = read_criteria(ROOT / "scenarios" / "criteria" / "highway.toml")
    assert criteria.name == "highway"
    assert all(len(c.source) > 20 for c in criteria.criteria)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("name = 'x'", "criterion: is missing"),
        ("name = 'x'\n[[criterion]]\nname = 'a'\nmeasure = 'TTC'", "expected one of below, above and beyond"),
        ("name = 'x'\n[[criterion]]\nname = 'a'\nmeasure = 'TTX'\nbelow = 1", "there is no measure 'TTX'"),
        ("name = 'x'\n[[criterion]]\nname = 'a'\nmeasure = 'TTC'\nbelow = 1\nfoo = 2", "foo"),
        ("name = 'x'\n" + 2 * "[[criterion]]\nname = 'a'\nmeasure = 'TTC'\nbelow = 1\n", "is a duplicate"),
        ("name = ", "is not TOML"),
        (
            "name = 'x'\n[[criterion]]\nname = 'a'\nmeasure = 'TTC'\nbelow = true",
            "below: expected a valid number",
        ),
        (
            "name = 'x'\n[[criterion]]\nname = 'a'\nmeasure = 'TTC'\nbelow = '1'",
            "below: expected a valid number",
        ),
    ],
)
def test_files_that_mean_nothing_are_refused(tmp_path, text, says):
    path = tmp_path / "criteria.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=says) as e:
        read_criteria(path)
    assert str(path) in str(e.value)
