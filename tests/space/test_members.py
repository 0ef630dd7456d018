"""Which simulated drives count, and the risk of clusters by them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from space.families import drawn, lasting
from space.spaces import KINDS, space_of

from resim.core.errors import InputError
from resim.jobs.space import _test_drives
from resim.jobs.space_drives import driven_traces
from resim.jobs.space_members import (
    Simulated,
    SpaceReading,
    _of_verification,
    _runs,
    accidents,
    one_build,
)
from resim.jobs.space_recordings import RecordingReader
from resim.recordings.content import content_hash
from resim.simulation.reactive.settings import ReactiveSettings, traffic_of
from resim.space.build import cluster_buckets
from resim.space.held_out import calibrated, held_out_calibration, mined_whole
from resim.space.members import (
    MEMBER_COLUMNS,
    DrivenTraces,
    SimulatedRun,
    TestDrive,
    clusters_of,
    judged_members,
    not_mined,
)
from resim.space.model import Space
from resim.space.risk import ClusterRisk, cluster_risks, cover_notes
from resim.space.traces import from_frame, joined
from resim.verification.entries import FailedRecording
from resim.verification.tolerance import Tolerances

BUCKET = "m-1, road 1 +, 3 lanes, 4 vehicles"
DRIVE = TestDrive("drive", "drive", "b", "p", "verified", True)
RUN = SimulatedRun("sweep:1", "run", "b", "p", 0.01, False)


@pytest.fixture(scope="module")
def space() -> Space:
    return space_of([*KINDS[:4]] * 6)


def known(run: str = KINDS[0], drive: str = KINDS[0], scenario: str = "") -> DrivenTraces:
    rng = np.random.default_rng(5)
    traces = joined([drawn(run, "run", rng, 0.5), drawn(drive, "drive", rng, 0.5)])
    return DrivenTraces(traces, {"run": BUCKET, "drive": BUCKET}, {"run": scenario, "drive": ""})


def test_a_run_near_a_verified_test_drive_counts(space: Space) -> None:
    found = judged_members(space, [RUN], [DRIVE], known(), 0.7).iloc[0]
    assert found["counts"]
    assert found["why"] == ""
    assert found["cluster"] == space.rows["cluster"].iloc[0]
    assert found["drive"] == "drive"
    assert found["drive_distance"] < 0.7


@pytest.mark.parametrize(
    ("drives", "run", "traces", "why"),
    [
        ([], RUN, known(), "no drive was verified with this build and perception"),
        ([replace(DRIVE, build="other")], RUN, known(), "no drive was verified with this build"),
        ([replace(DRIVE, perception="")], RUN, known(), "no drive was verified with this build and perception"),
        ([replace(DRIVE, own=False)], RUN, known(), "people's drives are no test drives"),
        ([replace(DRIVE, verdict="undecided")], RUN, known(), "no test drive of this build is verified"),
        ([DRIVE, replace(DRIVE, verdict="not verified")], RUN, known(), "no test drive of this build is verified"),
        ([DRIVE], RUN, known(drive=KINDS[3]), "the nearest verified test drive is"),
        ([DRIVE], replace(RUN, changed="perception.latency.speed is swept"), known(), "it is not what was verified"),
        ([DRIVE], replace(RUN, trust="outside"), known(), "its variation lies outside"),
        ([DRIVE], replace(RUN, trust="unknown"), known(), "it is unknown whether its variation"),
        ([DRIVE], replace(RUN, varied=True), known(), "its recording, which is not verified itself"),
        ([DRIVE], replace(RUN, recording="elsewhere"), known(), "its slots are not known"),
        ([DRIVE], RUN, known(run="jam", drive="jam"), "is in no cluster"),
    ],
)  # fmt: skip
def test_others_do_not_and_say_why(
    space: Space, drives: list[TestDrive], run: SimulatedRun, traces: DrivenTraces, why: str
) -> None:
    found = judged_members(space, [run], drives, traces, 0.7).iloc[0]
    assert not found["counts"]
    assert why in found["why"]


def test_a_held_out_folder_contradicts_a_drive_and_verifies_none(space: Space) -> None:
    given = Simulated((RUN,), (DRIVE,), {}, "f", "b", "p", "")
    failed = replace(given, drives=(replace(DRIVE, verdict="not verified"),))
    of_others = replace(given, drives=(replace(DRIVE, recording="run"),))
    for sweeps, held, counts in (
        ([given], [], True), ([given], [of_others], True), ([given], [failed], False),
        ([replace(given, drives=())], [given], False),
    ):  # fmt: skip
        found = judged_members(space, [RUN], _test_drives(sweeps, held), known(), 0.7)
        assert found["counts"].tolist() == [counts]


def test_variations_of_the_drive_that_is_verified_count(space: Space) -> None:
    """Ranges were found there: near another drive that is verified they say nothing."""
    run = replace(RUN, recording="drive", varied=True)
    assert judged_members(space, [run], [DRIVE], known(), 0.7).iloc[0]["counts"]
    contradicted = [DRIVE, replace(DRIVE, verdict="not verified"), replace(DRIVE, recording="run")]
    assert not judged_members(space, [run], contradicted, known(), 0.7).iloc[0]["counts"]


def test_the_medoid_of_its_cluster_may_be_near_the_drive_in_its_place(space: Space) -> None:
    rows = space.rows[space.rows["cluster"] == "1.1"]
    medoid = space.traces.take(space.traces.rows_of(rows["scenario"][rows["medoid"]].astype(str).tolist()))
    name = str(rows["scenario"].iloc[0])
    # as simulated it is elsewhere; the space says what it is
    far = lasting(drawn(KINDS[3], "run", np.random.default_rng(0)), int(medoid.scenes[0]))
    drive = replace(medoid, names=np.array(["drive"]))
    traces = DrivenTraces(joined([far, drive]), {"run": BUCKET, "drive": BUCKET}, {"run": name, "drive": ""})
    assert clusters_of(space, traces)["run"] == "1.1"
    assert judged_members(space, [RUN], [DRIVE], traces, 0.1).iloc[0]["counts"]


def test_a_medoid_that_leaves_the_lanes_is_near_nobody(space: Space) -> None:
    """Its empty slots are no free road, so a drive on a free road does not speak for its cluster."""
    rows = space.rows[space.rows["cluster"] == "1.1"]
    (row,) = space.traces.rows_of(rows["scenario"][rows["medoid"]].astype(str).tolist())
    drive = replace(space.traces.take([row]), names=np.array(["drive"]))
    run = lasting(drawn(KINDS[3], "run", np.random.default_rng(0)), int(drive.scenes[0]))
    name = str(rows["scenario"].iloc[0])
    known_to_all = DrivenTraces(
        joined([run, drive]), {"run": BUCKET, "drive": BUCKET}, {"run": name, "drive": ""}
    )
    lane = space.traces.lane.copy()
    lane[space.traces.first[row]] = -1
    off = replace(space, traces=replace(space.traces, lane=lane))
    counts = [
        judged_members(one, [RUN], [DRIVE], known_to_all, 0.1).iloc[0]["counts"] for one in (space, off)
    ]
    assert counts == [True, False]


@pytest.mark.parametrize(("seconds", "counts"), [(1.0, False), (4.0, False), (7.9, True), (20.0, True)])
def test_a_drive_legitimises_no_more_than_it_lasted_for(space: Space, seconds: float, counts: bool) -> None:
    """Over its first second a cut-out is as near to following as can be."""
    rng = np.random.default_rng(3)
    run, drive = (lasting(drawn(KINDS[0], name, rng, 0.1), 40) for name in ("run", "drive"))
    cut_out = DrivenTraces(
        joined([run, lasting(drive, round(5.0 * seconds))]), {"run": BUCKET, "drive": BUCKET}, {"run": "", "drive": ""}
    )  # fmt: skip
    found = judged_members(space, [RUN], [DRIVE], cut_out, 0.7).iloc[0]
    assert found["counts"] == counts
    assert counts or "time that it did not last for counts as far as can be" in found["why"]
    # a medoid that is as short as the drive is near to it, and the run lasts longer
    of_short = with_medoid(space, round(5.0 * seconds))
    assert judged_members(of_short, [RUN], [DRIVE], cut_out, 0.7).iloc[0]["counts"] == counts


def with_medoid(space: Space, scenes: int) -> Space:
    """The space where the medoid of 1.1 lasts for so many scenes."""
    name = str(space.rows["scenario"][space.rows["medoid"] & (space.rows["cluster"] == "1.1")].iloc[0])
    each = [space.traces.take([k]) for k in range(len(space.traces))]
    return replace(
        space, traces=joined([lasting(one, scenes) if one.names[0] == name else one for one in each])
    )


@settings(deadline=None, max_examples=40)
@given(
    scenes=st.lists(st.integers(1, 60), min_size=4, max_size=4), kinds=st.tuples(*[st.sampled_from(KINDS[:4])] * 2)
)  # fmt: skip
def test_what_is_shorter_legitimises_nothing_more(
    space: Space, scenes: list[int], kinds: tuple[str, str]
) -> None:
    """A drive or a medoid without its end says less, of whatever it is."""
    run, drive, less, medoid = scenes
    rng = np.random.default_rng(7)
    tracks = lasting(drawn(kinds[0], "run", rng, 0.1), run), drawn(kinds[1], "drive", rng, 0.1)
    cluster = {"run": str(space.rows["scenario"].iloc[0]), "drive": ""}

    def apart(lasts: int, of_medoid: int) -> float:
        there = DrivenTraces(
            joined([tracks[0], lasting(tracks[1], lasts)]), {"run": BUCKET, "drive": BUCKET}, cluster
        )
        return float(
            judged_members(with_medoid(space, of_medoid), [RUN], [DRIVE], there, 0.7)["drive_distance"].iloc[
                0
            ]
        )

    assert apart(min(drive, less), 40) >= apart(drive, 40) - 1e-12
    if run >= medoid:
        assert apart(drive, min(medoid, less)) >= apart(drive, medoid) - 1e-12


def test_a_medoid_of_a_second_makes_no_run_near(space: Space) -> None:
    """It is near to whatever begins as it does, on both sides."""
    rng = np.random.default_rng(3)
    follows = lasting(drawn(KINDS[0], "drive", rng, 0.1), 40)
    goes_on = lasting(drawn(KINDS[3], "run", rng, 0.1), 40)
    cluster = {"run": str(space.rows["scenario"].iloc[0]), "drive": ""}
    there = DrivenTraces(joined([goes_on, follows]), {"run": BUCKET, "drive": BUCKET}, cluster)
    counts = [
        judged_members(with_medoid(space, scenes), [RUN], [DRIVE], there, 0.7)["counts"].iloc[0]
        for scenes in (40, 5)
    ]
    assert counts == [True, False]


@pytest.mark.parametrize(("seconds", "cluster"), [(1.0, ""), (7.8, "1.1")])
def test_who_lasts_less_than_all_of_a_cluster_is_not_of_it(
    space: Space, seconds: float, cluster: str
) -> None:
    """A second of a scenario is harmless, and says nothing of its end."""
    drive = drawn(KINDS[0], "drive", np.random.default_rng(3), 0.1)
    run = lasting(drawn(KINDS[0], "run", np.random.default_rng(3), 0.1), round(5.0 * seconds))
    there = DrivenTraces(joined([run, drive]), {"run": BUCKET, "drive": BUCKET}, {"run": "", "drive": ""})
    assert clusters_of(space, there)["run"] == cluster
    assert judged_members(space, [RUN], [DRIVE], there, 0.7)["counts"].iloc[0] == bool(cluster)


def test_who_is_on_no_lane_is_near_nobody(space: Space) -> None:
    """Its slots are empty, as on a free road."""
    free = replace(space.traces, offset=np.full_like(space.traces.offset, np.nan))
    of_free = cluster_buckets(replace(space, traces=replace(free, speed=free.offset)))
    empty = known()
    nobody = np.full_like(empty.traces.offset, np.nan)
    on_road = replace(empty, traces=replace(empty.traces, offset=nobody, speed=nobody))
    assert judged_members(of_free, [RUN], [DRIVE], on_road, 0.7).iloc[0]["counts"]
    for name, why in (("run", "its EGO leaves the lanes"), ("drive", "in all verified test drives")):
        lane = on_road.traces.lane.copy()
        lane[on_road.traces.first[on_road.traces.rows_of([name])[0]]] = -1
        off = replace(on_road, traces=replace(on_road.traces, lane=lane))
        found = judged_members(of_free, [RUN], [DRIVE], off, 0.7).iloc[0]
        assert not found["counts"]
        assert why in found["why"]
        assert clusters_of(of_free, off).get("run", "") == ("" if name == "run" else "1.1")


def risks_of(one: ClusterRisk) -> list[tuple[float, float, float]]:
    return [(draw.risk, draw.surely, draw.possibly) for draw in one.draws]


def test_risk_is_over_what_was_driven_and_what_counts(space: Space) -> None:
    own = replace(space, rows=space.rows.assign(build="f-1"))  # its hash
    runs = [RUN, replace(RUN, name="2", risk=0.5), replace(RUN, name="3", risk=np.nan),
            replace(RUN, name="4", trust="outside"),
            replace(RUN, name="5", collided=True, risk=0.2, repeat="again")]  # fmt: skip
    members = judged_members(own, runs, [DRIVE], known(scenario="one_0"), 0.7)
    found = {one.cluster: one for one in cluster_risks(own, members, "f-1")}
    one = found["1.1"]
    assert (one.measured, one.counted, one.not_counted, one.unknown, one.collided) == (6, 4, 1, 1, 1)
    of_run = (0.01 + 0.5 + 1.0 + 1.0) / 4  # all of one scenario
    least = (0.01 + 0.5 + 0.0 + 1.0 + 0.01) / 5  # what is unknown was no accident, and what is outside counts
    assert np.allclose(risks_of(one), [(of_run, least, of_run), *[(0.0, 0.0, 0.0)] * 5])
    assert one.risk.value == pytest.approx(of_run / 6)
    assert one.worst[0].member in ("3", "5")
    assert risks_of(found["1.2"]) == [(0.0, 0.0, 0.0)] * 6
    of_people = {one.cluster: one for one in cluster_risks(space, members, "f-1")}
    assert of_people["1.1"].measured == 0
    assert (of_people["1.2"].drives, of_people["1.2"].missing) == (0, 6)
    assert any("do not count" in note for note in cover_notes(members, [DRIVE]))


def test_a_drive_of_which_nobody_says_how_it_ended_counts_as_an_accident(space: Space) -> None:
    told = space.rows.assign(build="f-1")
    none = judged_members(space, [], [], known(), 0.7)
    collided = told["collided"].astype("boolean")
    risk = [
        {
            one.cluster: one
            for one in cluster_risks(replace(space, rows=told.assign(collided=hit)), none, "f-1")
        }["1.1"]
        for hit in (collided, collided.mask(told["scenario"] == told["scenario"].iloc[0], pd.NA))
    ]
    assert [risks_of(one)[0] for one in risk] == [(0.0, 0.0, 0.0), (1.0, 0.0, 1.0)]
    assert [one.drives for one in risk] == [6, 6]
    assert [(one.unknown, one.measured_collided) for one in risk] == [(0, 0), (1, 1)]


def test_a_drive_that_leaves_the_lanes_is_no_member(space: Space) -> None:
    """Without a lane its slots are empty: of which kind it is nobody says."""
    own = replace(space, rows=space.rows.assign(build="f-1"))
    lane = own.traces.lane.copy()
    lane[own.traces.first[0]] = -1
    off = replace(own, traces=replace(own.traces, lane=lane))
    none = judged_members(space, [], [], known(), 0.7)
    measured = [{r.cluster: r.measured for r in cluster_risks(one, none, "f-1")}["1.1"] for one in (own, off)]
    assert measured == [6, 5]


def test_held_out_drives_calibrate_what_clusters_predict(space: Space) -> None:
    there = known(scenario="one_0")
    members = judged_members(space, [replace(RUN, name=str(k)) for k in range(50)], [DRIVE], there, 0.7)
    risks, cluster = cluster_risks(space, members, "f-1"), clusters_of(space, known())
    cluster |= {f"r{k}": cluster["run"] for k in range(40)}
    held = [replace(RUN, name=f"h{k}", recording=f"r{k % 40}") for k in range(200)]
    assert calibrated(risks, held, cluster).verdict == "calibrated"
    assert calibrated(risks, [replace(one, collided=True) for one in held], cluster).verdict == "too low"
    assert calibrated(risks, held[:5], cluster).verdict == "not shown"
    few = calibrated(risks, [replace(one, recording=f"r{k % 19}") for k, one in enumerate(held)], cluster)
    assert (few.verdict, few.bins[0].drives, few.bins[0].recordings) == ("not shown", 200, 19)
    strange = calibrated(risks, [replace(one, recording="elsewhere") for one in held], {})
    assert (strange.unknown, strange.verdict) == (200, "not shown")  # nobody says what was predicted of them
    swept = calibrated(
        risks, [replace(one, changed="perception.latency.speed is swept") for one in held], cluster
    )
    assert (swept.unknown, swept.verdict) == (200, "not shown")
    outside = calibrated(risks, [replace(one, trust="outside") for one in held], cluster)
    assert (outside.unknown, outside.verdict) == (200, "not shown")


def test_a_drive_that_is_held_out_does_not_predict_itself(space: Space) -> None:
    """All that is known of two kinds are the test drives that are held out, of which a third collides."""
    own = space_of([*KINDS[:2]] * 60, build="f-1")
    own = replace(own, rows=own.rows.assign(collided=np.arange(120) % 3 == 0))
    names = own.rows["scenario"].astype(str).tolist()
    traces = replace(own.traces, names=np.array([f"key of {name}" for name in names]))
    keys = traces.names.tolist()
    scenarios = DrivenTraces(traces, dict.fromkeys(keys, BUCKET), dict(zip(keys, names, strict=True)))
    held = [SimulatedRun(key, key, "f-1", "", 0.0, bool(hit))
            for key, hit in zip(keys, own.rows["collided"], strict=True)]  # fmt: skip
    members = judged_members(own, [], [], scenarios, 0.7)
    assert (
        calibrated(cluster_risks(own, members, "f-1"), held, clusters_of(own, scenarios)).verdict
        == "calibrated"
    )
    found = held_out_calibration(own, members, "f-1", held, scenarios)
    assert (found.verdict, found.unknown) == ("not shown", 120)
    # half of them held out, the others predict it
    half = held_out_calibration(own, members, "f-1", held[:60], scenarios)
    assert (half.verdict, half.unknown, half.drives) == ("calibrated", 0, 60)
    # recordings of which the space was mined: which of its scenarios are of them is not known
    mined = replace(
        own, sources=tuple(replace(one, recordings={key: key for key in keys[:50]}) for one in own.sources)
    )
    others = replace(scenarios, scenario=dict.fromkeys(keys, ""))
    found = held_out_calibration(mined, members, "f-1", held[:60], others)
    assert (found.verdict, found.unknown) == ("not shown", 50)
    of_parts = replace(others, drive=dict.fromkeys(keys[:50], "whole"))  # cut out of a drive that was mined
    whole = replace(own, sources=tuple(replace(one, recordings={"whole": "whole"}) for one in own.sources))
    assert held_out_calibration(whole, members, "f-1", held[:60], of_parts).unknown == 50
    assert "50 held-out drives are of recordings that the space was mined of" in next(
        mined_whole(mined, held, others)
    )


def test_a_prediction_that_rises_as_harmless_members_are_lost_is_not_calibrated() -> None:
    own = space_of([KINDS[0]] * 40)
    names = own.rows["scenario"].astype(str).tolist()
    rows = [
        (name, name, name, "1.1", "d", 0.1, 0.3 * (k % 2), False, True, "", "")
        for k, name in enumerate(names)
    ]
    frame = pd.DataFrame(rows, columns=list(MEMBER_COLUMNS)).astype({"collided": "boolean"})
    held = [SimulatedRun(str(k), f"h{k}", "b", "", 0.0, k % 3 == 0) for k in range(120)]
    cluster = {run.recording: "1.1" for run in held}
    assert calibrated(cluster_risks(own, frame, "b"), held, cluster).verdict == "too low"
    for lost in (frame.assign(counts=frame["risk"] > 0.0), frame[frame["risk"] > 0.0]):
        risks = cluster_risks(own, lost, "b")
        assert risks[0].risk.value == pytest.approx(0.3)
        assert calibrated(risks, held, cluster).verdict == "not shown"


def test_a_cluster_that_always_collides_is_not_hidden_by_one_of_the_same_risk() -> None:
    own = space_of([*KINDS[:2]] * 20)
    clusters = own.rows["cluster"].astype(str).tolist()
    rows = [
        (name, name, name, cluster, "d", 0.1, 0.5, False, True, "", "")
        for name, cluster in zip(own.rows["scenario"].astype(str), clusters, strict=True)
    ]
    frame = pd.DataFrame(rows, columns=list(MEMBER_COLUMNS)).astype({"collided": "boolean"})
    cluster = {f"h{k}": clusters[k % 2] for k in range(60)}
    risks = cluster_risks(own, frame, "b")
    for hit, told in (([True, True, False, False] * 15, "calibrated"), ([True, False] * 30, "too low")):
        held = [SimulatedRun(str(k), f"h{k}", "b", "", 0.0, hit[k]) for k in range(60)]
        assert calibrated(risks, held, cluster).verdict == told


def test_scenarios_of_a_drive_that_is_held_out_do_not_predict_it() -> None:
    """They share its weather and its traffic."""
    own = space_of([*KINDS[:2]] * 60, build="f-1")
    names = own.rows["scenario"].astype(str).tolist()
    traces = replace(own.traces, names=np.array([f"key of {name}" for name in names]))
    keys = traces.names.tolist()
    scenarios = DrivenTraces(traces, dict.fromkeys(keys, BUCKET), dict(zip(keys, names, strict=True)))
    held = [SimulatedRun(key, key, "f-1", "", 0.0, False) for key in keys[:60]]
    members = judged_members(own, [], [], scenarios, 0.7)
    assert held_out_calibration(own, members, "f-1", held, scenarios).unknown == 0
    pairs = replace(own, rows=own.rows.assign(drive=[f"r{k % 60}" for k in range(120)]))
    assert held_out_calibration(pairs, members, "f-1", held, scenarios).unknown == 60


def test_members_of_a_recording_that_is_held_out_do_not_predict_it() -> None:
    """Other seeds and variations of the same recordings end as these do: that is no calibration."""
    space = space_of([KINDS[0]] * 40)
    rng = np.random.default_rng(5)
    keys = [*(f"r{k}" for k in range(40)), "drive"]
    traces = joined([lasting(drawn(KINDS[0], key, rng, 0.5), 40) for key in keys])
    there = DrivenTraces(
        traces, dict.fromkeys(keys, BUCKET), {key: key.replace("r", "one_") for key in keys[:-1]}
    )

    def runs(recordings: range, seeds: range) -> list[SimulatedRun]:
        return [
            SimulatedRun(f"r{k}:{seed}", f"r{k}", "b", "p", float(k % 20 == 3), k % 20 == 3, same=f"r{k} {seed}")
            for k in recordings for seed in seeds
        ]  # fmt: skip

    members = judged_members(space, runs(range(20), range(10)), [DRIVE], there, 0.7)
    assert members["counts"].all()
    found = held_out_calibration(space, members, "b", runs(range(20), range(10, 20)), there)
    assert (found.verdict, found.unknown) == ("not shown", 200)
    others = held_out_calibration(space, members, "b", runs(range(20, 40), range(10)), there)
    assert (others.verdict, others.unknown) == ("calibrated", 0)


def test_what_was_cut_out_of_one_drive_is_one_draw() -> None:
    """20 windows of one harmless moment calibrate nothing, and none of them predicts another."""
    space = space_of([KINDS[0]] * 40)
    rng = np.random.default_rng(5)
    keys = [*(f"r{k}" for k in range(40)), "drive"]
    traces = joined([lasting(drawn(KINDS[0], key, rng, 0.5), 40) for key in keys])
    apart = DrivenTraces(
        traces, dict.fromkeys(keys, BUCKET), {key: key.replace("r", "one_") for key in keys[:-1]}
    )
    runs = [SimulatedRun(key, key, "b", "p", 0.0, False, same=key) for key in keys[:-1]]
    members = judged_members(space, runs[:20], [DRIVE], apart, 0.7)
    assert held_out_calibration(space, members, "b", runs[20:], apart).verdict == "calibrated"
    one = replace(apart, drive=dict.fromkeys(keys[20:40], "r20"))
    found = held_out_calibration(space, members, "b", runs[20:], one)
    assert (found.verdict, found.bins[0].recordings) == ("not shown", 1)
    of_space = replace(space, rows=space.rows.assign(drive=[f"r{min(k, 20)}" for k in range(40)]))
    found = held_out_calibration(
        of_space, members, "b", runs[20:], apart
    )  # vehicles that saw the same traffic
    assert (found.verdict, found.bins[0].recordings) == ("not shown", 1)
    beside = replace(apart, drive={f"r{k}": f"r{k % 20}" for k in range(40)})
    found = held_out_calibration(space, members, "b", runs[20:], beside)
    assert (found.verdict, found.unknown) == ("not shown", 20)


def test_a_run_that_is_there_again_is_no_further_evidence(space: Space) -> None:
    runs = [replace(RUN, name=name, same="run 1") for name in ("a", "b", "c")]
    found = judged_members(space, runs, [DRIVE], known(), 0.7)
    assert found["counts"].tolist() == [True, False, False]
    assert found["why"].tolist()[1:] == ["it is the same run as a"] * 2


def test_what_a_verification_ran_is_told_as_it_ended() -> None:
    """Of runs that left the road, or may have hit somebody unseen, nobody says that they did not collide."""
    seeds = [
        SimpleNamespace(seed=k, end=end, failure=failure)
        for k, (end, failure) in enumerate(
            [("duration", None), ("collision", None), ("off_road", None), ("duration", "raised")]
        )
    ]
    risk = SimpleNamespace(each=lambda: {"rGT+M": (0.1, 1.0, 0.1, 0.1), "rGT": (0.2,)})
    entry = SimpleNamespace(name="d", way="rGT+M", risk=risk, seeds=seeds, verdict="verified")
    run = replace(RUN, collided=False)
    found = list(_runs(Path("v"), entry, run))  # type: ignore[arg-type]
    assert [one.collided for one in found] == [False, True, None, None]
    assert len({one.same for one in found}) == 4
    unseen = list(_runs(Path("v"), entry, replace(run, collided=None)))  # type: ignore[arg-type]
    assert [one.collided for one in unseen] == [None, True, None, None]
    for collided in (True, False, None):  # as the drive did, of which it is shown that it is as the run
        entry.way, entry.verdict = "rGT", "verified"
        (one,) = _runs(Path("v"), entry, replace(run, collided=collided))  # type: ignore[arg-type]
        assert one.collided is collided
        entry.verdict = "not verified"
        (one,) = _runs(Path("v"), entry, replace(run, collided=collided))  # type: ignore[arg-type]
        assert one.collided is None


def test_an_accident_of_a_test_drive_that_was_not_mined_is_told(space: Space) -> None:
    assert not_mined(space, [], known()) == 0
    assert not_mined(space, ["drive", "drive", "run"], known()) == 2
    assert not_mined(space, ["run"], known(scenario="one_0")) == 0
    mined = replace(
        space, sources=tuple(replace(one, recordings={"drive": "drive"}) for one in space.sources)
    )
    assert not_mined(mined, ["drive"], known()) == 0


def write_drive(folder: Path, lead: float, driven_by: str) -> None:
    """A recording of 3 s behind somebody who stands so many m ahead."""
    rows = [
        f"{0.1 * k:.1f},{name},{x + v * 0.1 * k},-5.25,0,{v},4.5,1.8,car"
        for k in range(31) for name, x, v in (("ego", 300.0, 10.0), ("1", 300.0 + lead, 0.0))
    ]  # fmt: skip
    (folder / "gt.csv").write_text("\n".join(["t,id,x,y,heading,v,length,width,kind", *rows]) + "\n")
    road = Path("networks/proving_ground.xodr").resolve()
    (folder / "recording.toml").write_text(
        f'name = "d"\nmap = "{road}"\nego = "ego"\nbuild = "b-1"\nbuild_hash = "{driven_by}"\n'
    )


def verified_with() -> SimpleNamespace:
    """What a verification without a perception model was made with."""
    build = SimpleNamespace(hash="b", label="b-1", path="b.toml")
    return SimpleNamespace(
        against=None,
        build=build,
        perception=None,
        vehicle="single-track",
        traffic=None,
        settings=(),
        accept=(),
        tolerances=Tolerances(),
        agreement=0.9,
        criteria=SimpleNamespace(path="c.toml", hash="c"),
    )


def test_a_recording_that_could_not_be_verified_is_not_left_out(tmp_path: Path) -> None:
    """It may hold an accident: of it nobody says how it ends."""
    write_drive(tmp_path, 20.0, "b")
    inputs = verified_with()
    how = SpaceReading(tmp_path / "space", RecordingReader())
    failed = FailedRecording("d", ".", content_hash(tmp_path), "error", "process died", True)
    report = SimpleNamespace(inputs=inputs, recordings=[failed])
    found = _of_verification(tmp_path, report, how)  # type: ignore[arg-type]
    assert [(one.collided, np.isnan(one.risk)) for one in found.runs] == [(None, True)]
    assert "--vehicle single-track" in found.runs[0].repeat
    assert accidents([found]) == set(found.recordings)
    report.recordings = [replace(failed, hash=None)]
    with pytest.raises(InputError, match="could not be read"):
        _of_verification(tmp_path, report, how)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("traffic", "told"),
    [
        (None, ""),
        (ReactiveSettings(), "--traffic reactive"),
        (ReactiveSettings(calibrated=False), "--traffic traffic.toml"),
    ],
)
def test_the_command_that_repeats_a_member_is_told_all(
    tmp_path: Path, traffic: ReactiveSettings | None, told: str
) -> None:
    (tmp_path / "drive").mkdir()
    write_drive(tmp_path / "drive", 60.0, "b")
    file = SimpleNamespace(hash="b", label="b-1", path="../b.toml")
    inputs = SimpleNamespace(
        against=None, build=file, perception=SimpleNamespace(hash="p", path="m.json"), vehicle="single-track",
        traffic=traffic, settings=("latency.speed=0.4",), accept=("GAP",), tolerances=Tolerances(), agreement=0.9,
        criteria=SimpleNamespace(path="c.toml", hash="c"),
    )  # fmt: skip
    entry = FailedRecording("d", "../drive", content_hash(tmp_path / "drive"), "error", "process died", True)
    how = SpaceReading(tmp_path / "space", RecordingReader())
    found = _of_verification(tmp_path / "verified", SimpleNamespace(inputs=inputs, recordings=[entry]), how)  # type: ignore[arg-type]
    command = found.runs[0].repeat.split(" --")
    assert command[:3] == ["resim run ../drive", "build ../b.toml", "out ../repeated"]
    expected = {
        "vehicle single-track",
        "perception ../verified/m.json",
        "seeds 1",
        "set latency.speed=0.4",
        "accept GAP",
    }
    assert set(command[3:]) == expected | ({told.removeprefix("--")} if told else set())
    inputs.settings = ()  # another model than with a parameter that takes the place of the file's
    other = _of_verification(tmp_path / "verified", SimpleNamespace(inputs=inputs, recordings=[entry]), how)  # type: ignore[arg-type]
    assert (other.perception, found.perception != "p") == ("p", True)
    assert bool(found.traffic) == told.endswith(".toml")
    if found.traffic:
        (tmp_path / "traffic.toml").write_text(found.traffic)
        assert traffic_of(str(tmp_path / "traffic.toml")) == traffic


def test_collisions_in_no_cluster_are_told(space: Space) -> None:
    runs = [replace(RUN, name=str(k), collided=hit) for k, hit in enumerate((True, None, False))]
    members = judged_members(space, runs, [DRIVE], known(run="jam", drive="jam"), 0.7)
    notes = [note for note in cover_notes(members, [DRIVE]) if "of no cluster collide" in note]
    assert [note.split(":")[0] for note in notes] == ["2 simulated members of no cluster collide, or may"]


def test_verifications_by_other_tolerances_are_not_put_together(tmp_path: Path) -> None:
    """Within wide enough tolerances everything is verified."""
    write_drive(tmp_path, 60.0, "b")
    entry = FailedRecording("d", ".", content_hash(tmp_path), "error", "process died", True)
    how = SpaceReading(tmp_path / "space", RecordingReader())
    wide = Tolerances.model_validate({"pipeline": {"ego": {"d": 100.0}}})
    found = []
    for tolerances in (Tolerances(), wide):
        inputs = SimpleNamespace(**{**vars(verified_with()), "tolerances": tolerances})
        found.append(_of_verification(tmp_path, SimpleNamespace(inputs=inputs, recordings=[entry]), how))  # type: ignore[arg-type]
    one, other = found
    assert one.judged.startswith(
        "drives are verified by c.toml (c) with an agreement of 0.9, where their EGO differs"
    )
    assert one.judged.endswith("reaction 0.2 s")
    assert "at most d 100 m, reaction 0.2 s, by tolerances that are not the usual ones" in other.judged
    swept = replace(one, judged="")
    assert one_build([(tmp_path, one), (tmp_path / "s", swept), (tmp_path, one)]) is one
    with pytest.raises(InputError, match="Verify all with the same criteria and tolerances"):
        one_build([(tmp_path, one), (tmp_path / "s", swept), (tmp_path / "wide", other)])


def test_a_recording_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_drive(tmp_path, 60.0, "b")
    reader, key = RecordingReader(), content_hash(tmp_path)
    first = reader.read(tmp_path, key)
    monkeypatch.setattr("resim.jobs.space_recordings.read_recording", None)
    assert reader.read(tmp_path / ".." / tmp_path.name, key) is first
    with pytest.raises(InputError, match="its content has the hash"):
        reader.read(tmp_path, "another")


def test_copies_under_other_names_are_one_drive(tmp_path: Path) -> None:
    names = ("a", "b", "c")
    for name, lead in zip(names, (60.0, 60.0, 61.0), strict=True):
        (tmp_path / name).mkdir()
        write_drive(tmp_path / name, lead, "b")
    told = tmp_path / "b" / "recording.toml"
    told.write_text(told.read_text().replace('name = "d"', 'name = "another"'))
    reader = RecordingReader()
    hashes = [content_hash(tmp_path / name) for name in names]
    keys = [reader.read(tmp_path / name, key).key for name, key in zip(names, hashes, strict=True)]
    assert len(set(hashes)) == 3
    assert keys[0] == keys[1] != keys[2]
    told.write_text(told.read_text().replace('ego = "ego"', 'ego = "1"'))
    assert reader.read(tmp_path / "b", content_hash(tmp_path / "b")).key not in keys  # around somebody else
    told.write_text(told.read_text().replace('ego = "1"', 'ego = "ego"'))
    inputs = verified_with()
    entries = [
        FailedRecording(name, name, key, "error", "process died", True)
        for name, key in zip(names, hashes, strict=True)
    ]
    how = SpaceReading(tmp_path / "space", reader)
    found = _of_verification(tmp_path, SimpleNamespace(inputs=inputs, recordings=entries), how)  # type: ignore[arg-type]
    assert len({run.same for run in found.runs}) == len(found.recordings) == 2


def test_a_copy_of_a_scenario_is_that_scenario(space: Space, tmp_path: Path) -> None:
    """Else a copy that is held out would be predicted by what its original did."""
    for name in ("own", "copy"):
        (tmp_path / name).mkdir()
        write_drive(tmp_path / name, 60.0, "b")
    told = tmp_path / "copy" / "recording.toml"
    told.write_text(told.read_text().replace('name = "d"', 'name = "another"'))
    rows = space.rows.assign(
        folder=[str(tmp_path / "own"), str(tmp_path / "lost"), *[""] * (len(space.rows) - 2)]
    )
    name = str(rows["scenario"].iloc[0])
    for folder in (tmp_path / "own", tmp_path / "copy"):
        drive = RecordingReader().read(folder, content_hash(folder))
        there = Simulated((), (), {drive.key: drive}, "", "b", "", "")
        assert driven_traces(replace(space, rows=rows), [there]).scenario == {drive.key: name}


def test_a_drive_in_another_file_is_the_same_draw(space: Space, tmp_path: Path) -> None:
    """As CSV with fewer digits: held out, it would calibrate what it predicts itself."""
    read = {}
    for name, more in (("own", 0.0), ("digits", 4e-4), ("other", 0.5)):
        (tmp_path / name).mkdir()
        write_drive(tmp_path / name, 60.0 + more, "b")
        read[name] = RecordingReader().read(tmp_path / name, content_hash(tmp_path / name))
    there = Simulated((), (), {one.key: one for one in read.values()}, "", "b", "", "")
    found = driven_traces(space, [there])
    own, digits, other = (found.drive[one.key] for one in read.values())
    assert own == digits != other
    first = from_frame(read["own"].slots)
    rows = pd.concat([space.rows.iloc[:1].assign(scenario="it"), space.rows], ignore_index=True)
    with_it = replace(space, rows=rows, traces=joined([replace(first, names=np.array(["it"])), space.traces]))
    assert [driven_traces(with_it, [there]).scenario[one.key] for one in read.values()] == ["it", "it", ""]


@pytest.mark.parametrize(
    ("lead", "driven_by", "told"), [(20.0, "b", {"k"}), (20.0, "c", set()), (60.0, "b", set())]
)
def test_recordings_in_which_the_build_collides_are_its_accidents(
    tmp_path: Path, lead: float, driven_by: str, told: set[str]
) -> None:
    write_drive(tmp_path, lead, driven_by)
    drive = RecordingReader().read(tmp_path, content_hash(tmp_path))
    assert accidents([Simulated((), (), {"k": drive}, "b-1", "b", "", "")]) == told
