"""What is not whole ends in INVALID with a reason, or in a clear error: never in a pass, never in a number."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import ROOT

from resim.core.errors import ResimError
from resim.metrics.assessment import assess
from resim.metrics.assessment_report import drive_assessment
from resim.metrics.criteria import Criteria, read_criteria
from resim.metrics.criteria_file import Criterion
from resim.metrics.drive import drive
from resim.metrics.measures.collision import contacts
from resim.metrics.measures.inputs import MeasureInputs
from resim.metrics.risk import accident_risk

HIGHWAY = read_criteria(ROOT / "scenarios" / "criteria" / "highway.toml")
OF_OBJECTS = ("accident risk", "time to collision", "time headway", "no collision", "distance")


@pytest.fixture
def overtaking(described, network):
    """Everybody's tracks in the overtaking, five seconds of it, and the EGO's id."""
    scenario = described("overtake")
    t = np.round(scenario.ego.spawn_time + np.arange(0.0, 5.0, 0.1), 9)
    return scenario.tracks(network, t), scenario.ego.id


def judged(network, tracks, ego):
    return assess(MeasureInputs(drive(tracks, ego=ego), network), HIGHWAY)


def other(tracks, ego):
    return next(n for n in range(len(tracks)) if tracks.ids[n] != ego)


def test_all_is_well_as_it_is(overtaking, network):
    assert judged(network, *overtaking).verdict == "PASS"


@pytest.mark.parametrize("column", ["a", "yaw_rate"])
def test_an_unknown_value_of_an_object_that_is_there_is_invalid(overtaking, network, column):
    tracks, ego = overtaking
    values = getattr(tracks, column).copy()
    values[other(tracks, ego), 7] = np.nan
    found = judged(network, replace(tracks, **{column: values}), ego)
    assert found.verdict == "INVALID"
    verdict = found.verdicts["accident risk"]
    assert (verdict.outcome, verdict.reason) == ("INVALID", "not computed in 1 of 50 scenes")
    who = found.verdicts["time to collision"].reason
    assert who == f"not computed in 1 of 50 scenes (objects {tracks.ids[other(tracks, ego)]})"
    assert np.isnan(found.risk.r_ind[7])
    assert np.isfinite(np.delete(found.risk.r_ind, 7)).all()
    assert drive_assessment(found).risk.r_ind[7] is None


@pytest.mark.parametrize("size", ["length", "width"])
@pytest.mark.parametrize("whose", ["object", "ego"])
@pytest.mark.parametrize("value", [0.0, np.nan])
def test_a_box_without_size_is_invalid(overtaking, network, size, whose, value):
    tracks, ego = overtaking
    sizes = getattr(tracks, size).copy()
    sizes[tracks.index(ego) if whose == "ego" else other(tracks, ego)] = value
    found = judged(network, replace(tracks, **{size: sizes}), ego)
    assert found.verdict == "INVALID"
    for name in OF_OBJECTS:
        assert found.verdicts[name].outcome == "INVALID", name
        assert found.verdicts[name].reason.startswith("not computed in 50 of 50")
    assert np.isnan(found.risk.r_ind).all()


def test_one_sample_is_a_scene(overtaking, network):
    tracks, ego = overtaking
    found = judged(network, tracks.window(tracks.t[3] - 1e-6, tracks.t[3] + 1e-6), ego)
    assert found.verdicts["accident risk"].outcome == "PASS"
    assert found.verdicts["speed limit"].outcome == "PASS"
    assert len(found.drive.t) == 1


def test_an_object_of_one_sample_counts_where_it_is(overtaking, network):
    tracks, ego = overtaking
    n = other(tracks, ego)
    valid = tracks.valid.copy()
    valid[n] = False
    valid[n, 20] = True
    blank = {
        c: np.where(valid, getattr(tracks, c), np.nan) for c in ("x", "y", "heading", "v", "a", "yaw_rate")
    }
    found = judged(network, replace(tracks, valid=valid, **blank), ego)
    k = found.drive.ids.index(str(tracks.ids[n]))
    assert np.flatnonzero(found.drive.present[:, k]).tolist() == [20]
    assert np.flatnonzero(np.isfinite(found.risk.r_to[:, k])).tolist() == [20]
    assert found.verdict == "PASS"


def test_who_never_meets_is_no_conflict_and_passes(overtaking, network):
    tracks, ego = overtaking
    alone = tracks.select([ego])
    far = replace(tracks, x=tracks.x + np.where(tracks.ids == ego, 0.0, 1e5)[:, None])
    for some, why in ((alone, "no object"), (far, "no conflict within the look-ahead: not below 4 s")):
        found = judged(network, some, ego)
        verdict = found.verdicts["time to collision"]
        assert (verdict.outcome, verdict.value, verdict.reason) == ("PASS", None, why)
        assert (found.risk.r_ind == 0.0).all()
        assert found.verdict == "PASS"


def test_a_collision_between_two_scenes_or_after_the_last_is_none_the_less_one(overtaking, network):
    tracks, ego = overtaking
    made = drive(tracks, ego=ego)
    fine = tracks.at(np.round(np.arange(tracks.t[0], tracks.t[-1], 0.01), 9))
    n, row, at = (
        other(tracks, ego),
        tracks.index(ego),
        int(np.flatnonzero(np.isclose(fine.t - fine.t[0], 2.05))[0]),
    )
    fine.x[n, at], fine.y[n, at] = fine.x[row, at], fine.y[row, at]
    hits = tuple(contacts(fine, ego))
    assert hits == ((float(fine.t[at]), str(tracks.ids[n])),)
    late = ((float(made.t[-1]) + 0.03, "who has no track"),)
    for some, scene in ((hits, 20), (late, 49)):
        found = assess(MeasureInputs(made, network, hits=some), HIGHWAY)
        verdict = found.verdicts["no collision"]
        assert (verdict.outcome, verdict.t, verdict.object) == ("FAIL", made.t[scene], some[0][1])
        worst = next(w for w in found.worst() if w.name == "collision")
        assert (worst.t, worst.object) == (made.t[scene], some[0][1])


def test_a_flaw_of_the_drive_is_never_a_pass(overtaking, network):
    tracks, ego = overtaking
    found = assess(MeasureInputs(drive(tracks, ego=ego), network), HIGHWAY, flaw="the function failed")
    assert (found.verdict, drive_assessment(found).flaw) == ("INVALID", "the function failed")
    assert "the function failed" in found.notes()


def test_a_duration_that_the_drive_does_not_last_is_invalid_where_the_limit_is_broken(overtaking, network):
    tracks, ego = overtaking
    long = Criterion(name="long", measure="speed over limit", above=-100.0, duration=1000.0)
    kept = Criterion(name="kept", measure="speed over limit", above=100.0, duration=1000.0)
    found = assess(MeasureInputs(drive(tracks, ego=ego), network), Criteria("long", (long, kept)))
    assert found.verdicts["long"].outcome == "INVALID"
    assert found.verdicts["long"].reason.endswith("the drive has less than 1000 s in this part")
    assert found.verdicts["kept"].outcome == "PASS"


def test_a_missing_ego_is_a_clear_error(overtaking):
    tracks, ego = overtaking
    with pytest.raises(ResimError, match="no object 'ego'"):
        drive(tracks.without(ego), ego=ego)
    gone = np.where(tracks.ids == ego, False, True)[:, None] & tracks.valid
    blank = {
        c: np.where(gone, getattr(tracks, c), np.nan) for c in ("x", "y", "heading", "v", "a", "yaw_rate")
    }
    with pytest.raises(ResimError, match="EGO 'ego' has no sample"):
        drive(replace(tracks, valid=gone, **blank), ego=ego)


def test_a_part_without_scenes_is_invalid(overtaking, network):
    tracks, ego = overtaking
    late = Criteria("late", (Criterion(name="late", measure="TTC", below=1.0, start=60.0),))
    found = assess(MeasureInputs(drive(tracks, ego=ego), network), late)
    assert (found.verdict, found.verdicts["late"].reason) == (
        "INVALID",
        "the drive has no scene in this part",
    )


def test_the_kernel_gives_no_number_for_what_is_not_there(overtaking):
    tracks, ego = overtaking
    scenes = drive(tracks, ego=ego).scenes
    scenes.size[:, 0] = 0.0
    found = accident_risk(scenes)
    assert np.isnan(found.r_to[:, 0]).all()
    assert np.isfinite(found.r_ind).all()
