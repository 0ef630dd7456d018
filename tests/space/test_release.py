"""Release: missing data never make it better; what it says of good, bad and unknown functions."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from browsed import chromium, opened, too_faint
from hypothesis import example, given, settings
from hypothesis import strategies as st
from space.families import lasting
from space.spaces import KINDS, source, space_of

from resim.core.errors import InputError
from resim.space.build import build_space
from resim.space.calibration import reliability
from resim.space.comparison import compare_spaces, together
from resim.space.described import report
from resim.space.draws import scenario_draws
from resim.space.expected import ExposedScenarios, risk_limit, unseen_rate
from resim.space.limits import ReleaseLimits, read_limits
from resim.space.members import MEMBER_COLUMNS, DrivenTraces, SimulatedRun, TestDrive, judged_members
from resim.space.missing import hours_for_accidents, hours_for_kinds
from resim.space.model import Space
from resim.space.page import write_cover_page, write_release_page
from resim.space.release import decide, release_checks, verdict_of
from resim.space.release_case import release_case
from resim.space.release_report import ReleaseReport
from resim.space.risk import CoverReport, cluster_risks
from resim.space.settings import DEFAULT_SETTINGS, SpaceSettings
from resim.space.sources import UNKNOWN_BUILD
from resim.space.statistics.unseen import unseen_by_drive
from resim.space.traces import joined

SHIPPED = Path(__file__).parents[2] / "scenarios" / "criteria" / "release.toml"
HASHES = {"space": "", "cover": "", "limits": ""}
EVERY = np.array([0.0, 0.0005, 0.005, 0.02, 0.05, 0.2, 0.5])  # a risk in each bin
GOOD = reliability(np.repeat(EVERY, 4000), np.zeros(28000))


def limits(per_hour: float, **more: object) -> ReleaseLimits:
    told = {"name": "t", "least_seen": 0.9, "least_seen_source": "test", "least_drives": 30,
            "limit": [{"per": "hour", "accidents": per_hour, "source": "test"}]}  # fmt: skip
    return ReleaseLimits.model_validate({**told, **more})


def members(space: Space, each: int, risk: float) -> pd.DataFrame:
    """So many members that count in each cluster, of this risk, of its scenarios in turn."""
    draws = dict(tuple(space.rows.assign(draw=scenario_draws(space.rows)).groupby("cluster")["draw"]))
    rows = [
        (f"{name}:{k}", "o", draws[name].iloc[k % len(draws[name])], name, "d", 0.1, risk, False, True, "", "repeat")
        for name in sorted(draws) for k in range(each)
    ]  # fmt: skip
    frame = pd.DataFrame(rows, columns=list(MEMBER_COLUMNS))
    return frame.astype({"collided": "boolean"})


def cover(space: Space, frame: pd.DataFrame, calibration: object = GOOD) -> CoverReport:
    risks = cluster_risks(space, frame, "f-1")
    return CoverReport({}, {}, "", "b", "f-1", "", 0.7, {}, {}, 1, 0, risks, calibration, ())  # type: ignore[arg-type]


def decided(
    space: Space, frame: pd.DataFrame, asked: ReleaseLimits, calibration: object = GOOD
) -> ReleaseReport:
    return decide(space, cover(space, frame, calibration), asked, HASHES)


@pytest.fixture(scope="module")
def seen() -> Space:
    return space_of([*KINDS[:5]] * 40, hours=200.0)


def test_a_function_that_is_safe_in_all_that_is_known_is_released(seen: Space) -> None:
    found = decided(seen, members(seen, 80, 0.0), limits(0.3))
    assert found.verdict == "good"
    assert found.statement.startswith("The AD function is tested against a set of scenarios we trust")
    assert (
        "not contradicted by 28000 held-out drives, which would show one that is larger only above"
        in found.statement
    )
    assert not found.forbidding
    assert found.remaining.share.value == 1.0
    budget = found.budgets[0]
    assert budget.thin == 0.0
    assert 0.0 < budget.unseen < budget.high <= 0.3


def test_a_function_that_crashes_is_not_and_the_cluster_is_named() -> None:
    many = space_of([*KINDS[:5]] * 150, hours=750.0)
    frame = members(many, 150, 0.0)
    frame.loc[frame["cluster"] == "1.2", "risk"] = 0.5
    calibration = reliability(np.repeat([0.0, 0.5], 4000), np.repeat([0.0, 0.4], 4000))
    found = decided(many, frame, limits(0.06), calibration)
    assert found.verdict == "bad"
    assert [one.cluster for one in found.forbidding] == ["1.2"]
    assert found.forbidding[0].why == "risk"
    assert found.remaining.enough
    assert found.remaining.share.value == pytest.approx(0.8)
    assert found.remaining.share.low < 0.8 < found.remaining.share.high


@pytest.mark.parametrize(
    "what", ["no cover", "no calibration", "few members", "no members", "no hours", "too low"]
)
def test_what_is_not_known_is_not_shown(seen: Space, what: str) -> None:
    frame, calibration, space = members(seen, 80, 0.0), GOOD, seen
    if what == "no cover":
        assert decide(seen, None, limits(0.3), HASHES).verdict == "not shown"
        return
    if what == "no calibration":
        calibration = None
    if what == "few members":
        frame = members(seen, 20, 0.0)
    if what == "no members":
        frame = frame[frame["cluster"] != "1.1"]
    if what == "no hours":
        space = replace(seen, sources=tuple(replace(one, hours=np.nan) for one in seen.sources))
    if what == "too low":
        calibration = reliability(np.full(4000, 0.001), np.repeat([0.0, 1.0], 2000))
    found = decided(space, frame, limits(0.3), calibration)
    assert found.verdict == "not shown"
    assert found.statement.startswith("The function may not be released")
    assert found.notes or found.forbidding


def test_with_too_little_data_it_says_what_to_do(seen: Space) -> None:
    small = space_of([*KINDS[:5]] * 40, hours=1.0)
    found = decided(small, members(small, 5, 0.0), limits(1e-3))
    assert found.verdict == "not shown"
    assert found.plan
    assert all(one.after < one.before for one in found.plan)
    assert [one.after for one in found.plan] == sorted(one.after for one in found.plan)
    assert {one.what for one in found.plan} == {"drive", "simulate"}
    assert {one.amount for one in found.plan if one.what == "simulate"} == {
        35.0
    }  # those of which no member counts
    every = decided(small, members(small, 40, 0.0), limits(1e-3))
    assert {one.what for one in every.plan} == {"drive"}


def test_the_plan_says_how_many_drives_have_to_be_held_out(seen: Space, tmp_path: Path) -> None:
    few = reliability(np.zeros(12), np.zeros(12))
    found = decided(seen, members(seen, 40, 0.0), limits(0.3), few)
    held = [one for one in found.plan if one.what == "hold out"]
    assert {one.amount for one in held} == {8.0}
    assert held[0].after < held[0].before
    none = decided(seen, members(seen, 40, 0.0), limits(0.3), None)
    assert {one.amount for one in none.plan if one.what == "hold out"} == {20.0}
    write_release_page(found, None, tmp_path)
    assert "hold out 8 more drives with such a risk as" in (tmp_path / "release.html").read_text()
    both = decided(seen, members(seen, 35, 0.0), limits(0.3), few)
    assert any("hold out" in one.first for one in both.plan if one.what == "simulate")
    assert not any(one.what == "hold out" for one in decided(seen, members(seen, 40, 0.0), limits(0.3)).plan)


@pytest.mark.parametrize("per_hour", [0.05, 1.0, 20.0])
def test_the_hours_that_are_missing_are_those_in_which_nothing_new_comes(per_hour: float) -> None:
    few = ExposedScenarios(np.array([0, 0, 0, 1]), np.arange(4), np.arange(4), 2)
    alpha, hours = 0.05 / 3.0, 0.5
    more = hours_for_accidents(few, per_hour, alpha, hours, hours)
    assert more > 0.0

    def limit(times: float) -> float:
        count = round(4 * times)
        return unseen_rate(
            ExposedScenarios(np.zeros(count, int), np.arange(count), np.arange(count), 1),
            hours * times,
            alpha,
        )

    times = 1.0 + more / hours
    assert limit(1.1 * times + 1.0) <= per_hour < limit(0.9 * times)
    assert hours_for_accidents(few, 1e6, alpha, hours, hours) == 0.0
    assert np.isnan(hours_for_accidents(few, per_hour, alpha, np.nan, np.nan))
    assert hours_for_kinds(few, 0.05, 0.95, hours) > hours_for_kinds(few, 0.5, 0.95, hours) > 0.0


@pytest.mark.parametrize(("drives", "size"), [(60, 1), (3, 20), (10, 6)])
def test_hours_for_kinds_are_those_after_which_short_drives_without_new_kinds_have_shown_them(
    drives: int, size: int
) -> None:
    drive = np.repeat(np.arange(drives), size)
    seen = ExposedScenarios(drive * 0, np.arange(60), drive, 1)
    missing = hours_for_kinds(seen, 0.05, 0.95, 10.0)

    def high(hours: float) -> float:
        more = drives + np.arange(round(60 * hours / 10.0))
        number = np.r_[drive, more]
        return unseen_by_drive(number * 0, number, 0.9).high

    assert high(missing + 0.2) <= 0.05 < high(missing - 0.2)


def test_the_tutorial_says_how_many_hours_the_limit_that_ships_needs() -> None:
    asked, _ = read_limits(SHIPPED)
    many = ExposedScenarios(np.zeros(1_000_000, int), *[np.arange(1_000_000)] * 2, 1)
    alpha = (1.0 - asked.confidence) / 3.0
    needed = 1000.0 + hours_for_accidents(many, asked.limit[0].accidents, alpha, 1000.0, 1000.0)
    told = (Path(__file__).parents[2] / "docs" / "tutorials" / "space.md").read_text(encoding="utf-8")
    assert f"That needs {round(needed, -4):,.0f} h of driving" in told
    assert f"{1000.0 * unseen_rate(many, 1000.0, alpha):.1f} / 1,000 h" in told


def test_how_much_is_missing_is_told(seen: Space, tmp_path: Path) -> None:
    small = space_of([*KINDS[:3]] * 2, hours=0.5)
    found = decided(small, members(small, 40, 0.0), limits(1.0))
    assert [bool(one.missing_hours > 0.0) for one in found.checks] == [True, True, True, False]
    assert found.statement.count("h more are needed at least") == 3
    write_release_page(found, None, tmp_path)
    assert "hours missing, at least" in (tmp_path / "release.html").read_text()
    fits = decided(seen, members(seen, 40, 0.0), limits(1e6, least_seen=0.5))
    assert [(one.met, one.missing_hours) for one in fits.checks] == [(True, 0.0)] * 4


@cache
def some_space(seed: int) -> Space:
    kinds = np.random.default_rng(seed).choice(KINDS[:4], 30).tolist()
    return space_of(kinds, seed=seed, hours=10.0, build="b")


def near_drive(space: Space, driven: int, share: float) -> dict[str, bool]:
    """Whether a member counts, by cluster, where one drive is verified: such a share of a cluster's scenario."""
    medoid = space.rows[space.rows["medoid"]]
    own = [space.traces.take([row]) for row in space.traces.rows_of(medoid["scenario"].astype(str).tolist())]
    names = medoid["cluster"].astype(str).tolist()
    runs = [SimulatedRun(name, name, "b", "", 0.0, False) for name in names]
    there = [replace(one, names=np.array([name])) for one, name in zip(own, names, strict=True)]
    whole = own[driven % len(own)]
    shorter = lasting(whole, max(int(share * len(whole.lane)), 1))
    there.append(replace(shorter, names=np.array(["drive"])))
    scenario = dict(zip(names, medoid["scenario"].astype(str), strict=True)) | {"drive": ""}
    known = DrivenTraces(joined(there), dict.fromkeys(scenario, str(medoid["bucket"].iloc[0])), scenario)
    drive = TestDrive("drive", "drive", "b", "", "verified", True)
    judged = judged_members(space, runs, [drive], known, 0.7)
    return dict(zip(judged["member"], judged["counts"], strict=True))


@settings(deadline=None, max_examples=12)
@given(
    seed=st.integers(0, 10_000),
    part=st.sampled_from(
        [
            "risk",
            "collided",
            "counts",
            "calibration",
            "hours",
            "slots",
            "prediction",
            "outcome",
            "lanes",
            "unclear",
            "length",
        ]
    ),
)
@example(seed=16, part="length")  # over its first second another kind of drive is near
def test_missing_data_never_make_it_better(seed: int, part: str) -> None:
    rng = np.random.default_rng(seed)
    space = some_space(seed % 3)
    space = replace(space, rows=space.rows.assign(collided=pd.array(rng.random(30) < 0.1, dtype="boolean")))
    frame = members(space, int(rng.integers(5, 80)), 0.0)
    frame["risk"] = rng.beta(0.1, 2.0, len(frame))
    frame["counts"] = rng.random(len(frame)) < 0.8
    asked = limits(float(10.0 ** rng.uniform(-0.5, 2.5)), least_seen=0.3)
    lost = rng.random(len(frame)) < rng.random()
    held = np.repeat(EVERY[rng.random(len(EVERY)) < 0.8], 4000)
    collided = (rng.random(len(held)) < held).astype(float)
    well = reliability(held, collided)
    worse, calibration, poorer = frame.copy(), well, space
    if part == "risk":
        worse.loc[lost, "risk"] = np.nan
    elif part == "collided":
        worse.loc[lost, "collided"] = pd.NA
    elif part == "counts":
        worse.loc[lost, "counts"] = False
    elif part == "calibration":
        calibration = None
    elif part in ("prediction", "outcome"):
        unknown = np.where(rng.random(len(held)) < 0.01, np.nan, 0.0)
        calibration = reliability(
            held + unknown * (part == "prediction"), collided + unknown * (part == "outcome")
        )
    elif part == "length":
        whole, shorter = (
            frame["cluster"].map(near_drive(space, seed, share)) for share in (1.0, rng.random())
        )
        frame["counts"], worse["counts"] = frame["counts"] & whole, worse["counts"] & shorter
    elif part == "lanes":
        off = np.repeat(rng.random(30) < 0.3, space.traces.scenes)
        poorer = replace(space, traces=replace(space.traces, lane=np.where(off, -1, space.traces.lane)))
    elif part == "unclear":
        hit = space.rows["collided"].mask(rng.random(30) < 0.3, pd.NA)
        poorer = replace(space, rows=space.rows.assign(collided=hit))
    else:
        lost_of = {"hours": {"hours": np.nan}, "slots": {"left_out": 3}}[part]
        poorer = replace(space, sources=tuple(replace(one, **lost_of) for one in space.sources))
    one, two = (
        release_case(s, replace(cover(s, f, c), clusters=cluster_risks(s, f, "b")), asked)
        for s, f, c in ((space, frame, well), (poorer, worse, calibration))
    )
    checks = [release_checks(case, {per: case.accidents(per) for per in case.driven}) for case in (one, two)]
    before, after = (
        verdict_of(c, case.believed, case.unknown) for c, case in zip(checks, (one, two), strict=True)
    )
    assert all(a.met or not b.met for a, b in zip(*checks, strict=True))
    assert after != "good" or before == "good"
    assert two.accidents("hour").high >= one.accidents("hour").high - 1e-12
    assert all(b.high >= a.high - 1e-12 for a, b in zip(one.risk, two.risk, strict=True))


@pytest.mark.parametrize("lost", ["risk", "counts"])
def test_a_risk_that_rises_as_data_are_lost_is_believed_no_more(seen: Space, lost: str) -> None:
    """The mean moves from a bin without held-out drives into one with them."""
    frame = members(seen, 5000, 0.0)
    mine = frame.index[frame["cluster"] == "1.2"]
    frame.loc[mine, "risk"] = np.where(np.arange(5000) < 2000, 0.012, 0.0)
    benign = reliability(np.repeat([0.0, 0.02], 4000), np.zeros(8000))
    assert decided(seen, frame, limits(0.3), benign).verdict == "not shown"
    if lost == "risk":
        frame.loc[mine[:60], "risk"] = np.nan
    else:
        frame.loc[mine[2000:], "counts"] = False
    assert decided(seen, frame, limits(0.3), benign).verdict == "not shown"
    assert decided(seen, frame, limits(0.3)).verdict == "good"


def test_scenarios_without_slots_are_no_drives() -> None:
    few = space_of([*KINDS[:3]] * 9 + [KINDS[0], KINDS[1]], hours=29.0)
    lost = replace(few, sources=tuple(replace(one, left_out=3) for one in few.sources))
    for space in (few, lost):
        drives = decided(space, members(space, 30, 0.0), limits(1e6, least_seen=0.1)).checks[-2]
        assert (drives.value, drives.met) == (29.0, False)


def test_where_nothing_is_known_no_interval_is_told(seen: Space) -> None:
    known = decided(seen, members(seen, 5, 0.0), limits(0.3)).budgets[0].known
    assert np.isnan([known.value, known.low, known.high]).all()


def test_risk_is_believed_where_held_out_drives_have_such_a_risk(seen: Space) -> None:
    frame = members(seen, 80, 0.0)
    frame.loc[frame["cluster"] == "1.2", "risk"] = 0.005
    benign = reliability(np.zeros(4000), np.zeros(4000))
    assert benign.verdict == "calibrated"
    found = decided(seen, frame, limits(0.22), benign)
    assert found.verdict == "not shown"
    assert [one.cluster for one in found.forbidding] == ["1.2"]
    assert "not calibrated" in found.forbidding[0].why
    assert decided(seen, frame, limits(0.22), GOOD).verdict == "good"


def test_scenarios_that_nobody_simulated_may_be_accidents(seen: Space) -> None:
    """Else the harmless ones alone would be simulated."""
    frame = members(seen, 40, 0.0)
    assert decided(seen, frame, limits(0.22)).verdict == "good"
    some = frame[frame["cluster"] != "1.3"]
    harmless = pd.concat([some, frame[frame["cluster"] == "1.3"].iloc[:35]])
    found = decided(seen, harmless, limits(0.22))
    assert found.verdict == "not shown"
    one = next(one for one in cluster_risks(seen, harmless, "f-1") if one.cluster == "1.3")
    assert (one.missing, one.drives, len(one.draws)) == (5, 35, 40)
    benign = decided(seen, harmless, limits(0.22), reliability(np.zeros(4000), np.zeros(4000)))
    told = next(c.why for c in benign.forbidding if c.cluster == "1.3")
    assert told.startswith(
        "its risk is not calibrated: 5 scenarios of it were not simulated; 100 more drives with such"
    )
    rows = seen.rows[seen.rows["cluster"] == "1.3"]["scenario"].astype(str).tolist()
    held = cluster_risks(seen, harmless, "f-1", set(rows[35:]))  # those calibrate
    assert next(one for one in held if one.cluster == "1.3").missing == 0


def test_recordings_that_are_no_scenarios_make_nothing_better(seen: Space) -> None:
    """Harmless ones would dilute the risk, and nobody knows how often they come."""
    frame = members(seen, 40, 0.02)
    beside = members(seen, 80, 0.0)
    beside["draw"] = [f"elsewhere {k}" for k in range(len(beside))]
    alone, both = (cluster_risks(seen, one, "f-1")[0] for one in (frame, pd.concat([frame, beside])))
    assert (alone.drives, both.drives, both.not_counted) == (40, 40, 80)
    assert both.why == {"its recording is no scenario of the space": 80}
    assert risk_limit(both, 0.01, 30, GOOD).high >= risk_limit(alone, 0.01, 30, GOOD).high
    dangerous = cluster_risks(seen, pd.concat([frame, beside.assign(risk=0.5)]), "f-1")[0]
    assert risk_limit(dangerous, 0.01, 30, GOOD).high > 0.4


def test_what_happened_in_no_scenario_is_not_released(seen: Space) -> None:
    frame = members(seen, 80, 0.0)
    for changed in ({"accidents": {"b": 1}}, {"failed": ("r7",)}, {"left_out": 3}):
        other = replace(seen, sources=tuple(replace(one, **changed) for one in seen.sources))
        found = decided(other, frame, limits(0.3))
        assert found.verdict == "not shown"
        assert any(
            words in found.statement for words in ("in no scenario", "could not be mined", "have no slots")
        )
    off = replace(seen, traces=replace(seen.traces, lane=np.full_like(seen.traces.lane, -1)))
    found = decided(off, frame, limits(0.3))  # without a lane all slots are empty: all would be of one kind
    assert found.verdict == "not shown"
    assert "the EGO is on no lane" in found.statement
    left_out = replace(cover(seen, frame), accidents=1)
    found = decide(seen, left_out, limits(0.3), HASHES)
    assert found.verdict == "not shown"
    assert "collide or break off and are not in the space" in found.statement
    of_another = replace(seen, sources=tuple(replace(one, accidents={"c": 1}) for one in seen.sources))
    assert decided(of_another, frame, limits(0.3)).verdict == "good"


def test_kinds_that_each_come_in_one_drive_alone_are_not_all_that_there_is() -> None:
    """Each comes four times, and none once: as if all were seen, and the next drive has others."""
    alone = build_space([source(f"s{k}", [KINDS[k]] * 4, k, 20.0, each=4) for k in range(10)])
    mixed = build_space(
        [source(f"s{k}", [KINDS[(k + j) % 10] for j in range(4)], k, 20.0, each=4) for k in range(10)]
    )
    found = [decided(one, members(one, 9, 0.0), limits(0.3)).checks[0] for one in (alone, mixed)]
    assert [(one.value, one.low) for one in found] == [(0.0, 0.0), (1.0, pytest.approx(0.686, abs=0.01))]


def test_hours_of_others_do_not_dilute_what_this_build_meets(seen: Space) -> None:
    def driven(**hours: float) -> Space:
        return replace(seen, sources=tuple(replace(one, driven_by=hours) for one in seen.sources))

    frame = members(seen, 80, 0.0)
    covered = replace(cover(seen, frame), build="b")
    found = {
        name: decide(driven(**hours), covered, limits(0.3), HASHES)
        for name, hours in (
            ("own", {"b": 200.0}),
            ("both", {"b": 20.0, "": 180.0}),
            ("people's", {"": 200.0}),
        )
    }
    assert [one.verdict for one in found.values()] == ["good", "not shown", "good"]
    assert "180 of 200 h were driven by others than this build" in found["both"].statement
    assert [any("rates are of others' drives" in note for note in one.notes) for one in found.values()] == [
        False, False, True,
    ]  # fmt: skip


def test_an_accident_of_a_build_without_a_hash_may_be_of_any(seen: Space) -> None:
    build = "f-1"
    frame = members(seen, 80, 0.0)
    name = str(seen.rows["scenario"].iloc[0])
    hit = replace(seen, rows=seen.rows.assign(build=UNKNOWN_BUILD, collided=seen.rows["scenario"] == name))
    plain, worse = ({one.cluster: one for one in cluster_risks(one, frame, build)} for one in (seen, hit))
    cluster = str(seen.rows["cluster"].iloc[0])
    assert plain[cluster].measured == worse[cluster].measured == 0
    high = [risk_limit(one[cluster], 0.01, 30, GOOD).high for one in (plain, worse)]
    assert high[1] > high[0]
    outside = replace(seen, sources=tuple(replace(one, accidents={UNKNOWN_BUILD: 1}) for one in seen.sources))
    found = decided(outside, frame, limits(0.3))
    assert found.verdict == "not shown"
    assert "1 collisions or ends of test drives of this build, or of one without a hash" in found.statement


def test_nothing_is_released_whose_rates_are_of_too_few_drives(tmp_path: Path) -> None:
    drives = [space_of([KINDS[0]] * count, hours=100.0) for count in (29, 30)]
    few, enough = (
        decided(one, members(one, 40, 0.0), limits(1e6, least_seen=0.01, least_drives=1)) for one in drives
    )
    assert (few.verdict, few.remaining.enough, enough.verdict) == ("not shown", False, "good")
    assert (
        "released: drives in which scenarios come: 29 (3.45 h more are needed at least), asked for 30."
        in few.statement
    )
    write_release_page(few, None, tmp_path)
    page = (tmp_path / "release.html").read_text(encoding="utf-8")
    assert "29 to 29" not in page
    assert np.isnan(few.checks[-2].low)
    assert any(note.startswith("all is of 29 drives: ") for note in report(drives[0], {}).notes)
    assert not any(note.startswith("all is of") for note in report(drives[1], {}).notes)


def test_nothing_is_released_where_few_drives_have_most_of_the_time(tmp_path: Path) -> None:
    """One of 30 is as long as 970 others: 1000 h squared by 1000 h would be one drive."""
    like = space_of([KINDS[0]] * 30, hours=30.0)
    [one] = like.sources
    lengths = {name: (970.0, 970.0) if k == 0 else told for k, (name, told) in enumerate(one.lengths.items())}
    apart = replace(like, sources=(replace(one, lengths=lengths, hours=999.0),))
    alike, found = (
        decided(space, members(space, 40, 0.0), limits(1e6, least_seen=0.01, least_drives=1))
        for space in (like, apart)
    )
    assert (alike.verdict, found.verdict, found.remaining.enough) == ("good", "not shown", False)
    assert "drives of like length that they are worth: 1.061 (" in found.statement
    unknown = {name: (hours, np.nan) for name, (hours, _) in one.lengths.items()}
    lost = replace(like, sources=(replace(one, lengths=unknown),))
    checks = decided(lost, members(lost, 40, 0.0), limits(1e6, least_seen=0.01, least_drives=1)).checks
    assert (checks[-1].met, bool(np.isnan(checks[-1].value))) == (False, True)
    assert any(note.startswith("few drives have most of the time, so") for note in report(apart, {}).notes)
    assert not any(note.startswith("few drives") for note in report(like, {}).notes)


def test_beside_what_happened_in_no_scenario_no_limit_is_met(seen: Space, tmp_path: Path) -> None:
    frame = members(seen, 80, 0.0)
    assert [one.met for one in decided(seen, frame, limits(0.3)).checks] == [True] * 4
    other = replace(seen, sources=tuple(replace(one, accidents={"b": 50}) for one in seen.sources))
    found = decided(other, frame, limits(0.3))
    check = found.checks[1]
    assert (check.name, check.met, check.exceeded) == ("accidents by hour", False, False)
    assert np.isnan([check.high, found.budgets[0].high, found.remaining.high]).all()
    assert "accidents by hour: not known, asked for 0.3" in found.statement
    write_release_page(found, None, tmp_path)
    told = (tmp_path / "release.html").read_text(encoding="utf-8")
    assert "accidents an hour: not known" in told
    assert "at most –" not in told


def test_a_later_half_that_brings_more_than_the_first_tells_is_not_released() -> None:
    space = space_of([*[*KINDS[:5]] * 20, *[*KINDS[5:10]] * 20], hours=200.0)
    found = decided(space, members(space, 5000, 0.0), limits(0.3))
    assert found.verdict == "not shown"
    assert "are of new kinds, where the first half tells of at most" in found.statement


def test_no_odd_is_enough_where_too_few_kinds_were_seen() -> None:
    space = space_of([*KINDS[:5]] * 2, hours=1000.0)
    found = decided(space, members(space, 5000, 0.0), limits(0.3))
    assert (found.verdict, found.checks[0].met, found.remaining.enough) == ("not shown", False, False)


def test_a_release_says_by_which_settings_there_are_kinds(seen: Space) -> None:
    wide = space_of([*KINDS], hours=200.0, settings=SpaceSettings(threshold=12.0))
    told = [decided(one, members(one, 9, 0.0), limits(0.3)).notes[0] for one in (seen, wide)]
    assert told[0] == (
        "kinds are by road, complete linkage and the threshold 0.7; members count up to 0.7 from a verified drive"
    )
    assert "threshold 12.0" in told[1]


def test_variations_of_one_recording_dilute_no_bin() -> None:
    predicted, hit = np.full(20, 0.005), np.arange(20) < 10
    names = [f"r{k}" for k in range(20)]
    assert reliability(predicted, hit.astype(float), names).verdict == "too low"
    more, harmless = np.full(10020, 0.005), np.concatenate([hit, np.zeros(10000)]).astype(float)
    assert reliability(more, harmless, [*names, *["r19"] * 10000]).verdict == "too low"


def test_scenarios_of_unknown_kind_are_no_kind_that_was_seen(seen: Space) -> None:
    lane = np.where(np.arange(len(seen.traces.lane)) < seen.traces.first[40], -1, seen.traces.lane)
    off = replace(seen, traces=replace(seen.traces, lane=lane))
    without = replace(seen, sources=tuple(replace(one, left_out=40) for one in seen.sources))
    whole, *others = (
        decided(one, members(seen, 9, 0.0), limits(0.3)).checks[0] for one in (seen, off, without)
    )
    assert (whole.value, whole.met) == (1.0, True)
    assert [one.value for one in others] == [pytest.approx(160 / 200), pytest.approx(200 / 240)]
    assert not any(one.met for one in others)


def test_the_plan_leaves_out_nothing_that_the_limit_holds(seen: Space) -> None:
    lane = np.where(np.arange(len(seen.traces.lane)) < seen.traces.first[40], -1, seen.traces.lane)
    off = replace(seen, traces=replace(seen.traces, lane=lane))
    one, other = (decided(space, members(seen, 9, 0.0), limits(0.3)) for space in (seen, off))
    assert {plan.before for plan in one.plan} == {one.budgets[0].high}
    (before,) = {plan.before for plan in other.plan}
    assert before > one.budgets[0].high
    assert not any("in no scenario" in plan.first for plan in one.plan)
    assert all("in no scenario" in plan.first for plan in other.plan)


def test_what_is_in_no_scenario_is_left_in_any_odd(seen: Space) -> None:
    other = replace(seen, sources=tuple(replace(one, accidents={"b": 50}) for one in seen.sources))
    frame = members(seen, 80, 0.0)
    assert decided(seen, frame, limits(0.3)).remaining.enough
    assert not decided(other, frame, limits(0.3)).remaining.enough


def test_the_share_that_is_left_is_of_occasions() -> None:
    alone, four = (build_space([source("s", [*KINDS[:5]] * 40, 1, 200.0, together=n)]) for n in (1, 4))
    one, other = (
        decided(space, members(space, 5, 0.0), limits(3.0)).remaining.share for space in (alone, four)
    )
    assert one.value == other.value
    assert other.high - other.low > 1.5 * (one.high - one.low)


def test_risk_that_is_not_calibrated_is_not_printed(seen: Space, tmp_path: Path) -> None:
    frame, told = members(seen, 40, 0.0123), report(seen, {})
    frame.loc[frame["cluster"] == "1.2", "risk"] = 0.271  # of such a risk nobody held a drive out
    low_alone = reliability(np.repeat([0.0, 0.0123], 4000), np.zeros(8000))
    for calibration, shown in ((None, set()), (low_alone, {"0.0123"}), (GOOD, {"0.0123", "0.271"})):
        write_cover_page(seen, told, cover(seen, frame, calibration), tmp_path)
        clusters = (tmp_path / "cover.html").read_text().split("<h2>Clusters</h2>")[1].split("<h2>")[0]
        assert {risk for risk in ("0.0123", "0.271") if f">{risk} (" in clusters} == shown
        assert clusters.count("not shown: not calibrated") == {0: 5, 1: 1, 2: 0}[len(shown)]
        assert "a kilometre (95 %)" in clusters
        worst = (tmp_path / "cover.html").read_text().split("<h2>Worst members</h2>")[1].split("<h2>")[0]
        assert ("0.271" in worst) == bool(shown)


def test_the_limits_that_ship_have_sources() -> None:
    found, digest = read_limits(SHIPPED)
    assert {one.per for one in found.limit} == {"hour", "kilometre"}
    assert all(len(one.source) > 20 for one in found.limit)
    assert len(digest) == 64


def test_two_sets_of_drives_of_one_population_are_not_shown_to_be_apart() -> None:
    """Each drive has kinds of its own: few drives are apart, whatever they are of."""
    rng, apart = np.random.default_rng(3), 0
    for k in range(6):
        two = []
        for name in ("one", "other"):
            drives = [
                source(f"{name}{d}", rng.choice(KINDS[:6], 20, p=rng.dirichlet(np.full(6, 0.5))).tolist(),
                       100 * k + 10 * len(two) + d, each=20) for d in range(3)
            ]  # fmt: skip
            two.append(build_space(drives))
        found = compare_spaces(together(*two), ("", ""), ("", ""))
        assert found.apart.value > 0.1
        apart += found.apart.low > 0.0
    assert apart == 0


def test_two_spaces_beside_each_other() -> None:
    people = build_space([source("people", [*KINDS[:6]] * 40, 1)])
    robots = build_space([source("robots", [*KINDS[3:9]] * 40, 2)])
    found = compare_spaces(together(people, robots), ("people", "robots"), ("", ""))
    assert (found.only_one, found.only_other) == (3, 3)
    assert found.only_one_share.value == pytest.approx(0.5)
    assert found.apart.value == pytest.approx(0.5)
    assert 0.3 < found.apart.low < 0.5 < found.apart.high
    assert sum(kind.one for kind in found.kinds) == 240
    alike = compare_spaces(
        together(people, build_space([source("p2", [*KINDS[:6]] * 40, 3)])), ("a", "b"), ("", "")
    )
    assert alike.apart.value == pytest.approx(0.0)
    assert alike.apart.high > 0.0


@given(st.lists(st.tuples(st.sampled_from([0.0, 0.0005, 0.005, 0.05, 0.5]), st.integers(1, 60), st.floats(0.0, 0.9)),
                min_size=1, max_size=5), st.integers(0, 2**32 - 1))  # fmt: skip
@example([(0.0, 60, 0.0), (0.05, 5, 0.0)], 0)
@settings(deadline=None)
def test_predictions_that_are_lost_calibrate_nothing(bins: list[tuple[float, int, float]], seed: int) -> None:
    """Nor do those of a bin of few drives, which goes with them."""
    rng = np.random.default_rng(seed)
    risk = np.concatenate([np.full(count, value) for value, count, _ in bins])
    hit = np.concatenate([(rng.random(count) < share).astype(float) for _, count, share in bins])
    for lost in (*(risk == value for value, _, _ in bins), rng.random(len(risk)) < 0.2):
        if lost.any() and reliability(np.where(lost, np.nan, risk), hit).verdict == "calibrated":
            assert reliability(risk, hit).verdict == "calibrated"


def placed(kinds: list[str], seed: int, **where: object) -> Space:
    """A space of another place or build."""
    how = where.pop("how", DEFAULT_SETTINGS)
    one = source(f"s{seed}", kinds, seed)
    return build_space([replace(one, rows=one.rows.assign(**where))], how)  # type: ignore[arg-type]


def test_two_towns_are_compared_where_buckets_do_not_hold_the_road() -> None:
    north, south = (
        {"map": f"{name}-1", "road": name, "lanes": n} for name, n in (("north", 2), ("south", 3))
    )
    with pytest.raises(InputError, match=r"\(south-1\) are none of the other space's \(north-1\).*bucket = "):
        together(placed([*KINDS[:3]], 1, **north), placed([*KINDS[:3]], 2, **south))
    by_vehicles = SpaceSettings(bucket="vehicles")
    one = placed([*KINDS[:6]] * 40, 1, how=by_vehicles, **north)
    other = placed([*KINDS[:6]] * 20 + [*KINDS[6:8]] * 20, 2, how=by_vehicles, **south)
    found = compare_spaces(together(one, other), ("north", "south"), ("", ""))
    assert (found.only_one, found.only_other) == (0, 2)
    assert found.only_other_share.low < 0.25 < found.only_other_share.high
    assert 0.0 < found.apart.low < 0.25 < found.apart.high
    # by lanes no kind of the one can be one of the other, and that is what was asked for
    by_lanes = SpaceSettings(bucket="lanes")
    one, other = (placed([*KINDS[:6]], k, how=by_lanes, **where) for k, where in enumerate((north, south)))
    assert compare_spaces(together(one, other), ("", ""), ("", "")).apart.value == 1.0
    # of one map in both and one in the first alone it is told
    both = source("both", [*KINDS[:6]], 3)
    both.rows["map"] = ["m-1", "n-1"] * 3
    found = compare_spaces(together(build_space([both]), placed([*KINDS[:6]], 4)), ("", ""), ("", ""))
    assert "3 of 6 scenarios of the first space are on maps that the other does not have" in " ".join(
        found.notes
    )


def test_before_and_after_a_build() -> None:
    """The new build drives up to others: of a kind that it makes more often, and of one that it no longer meets."""
    before = placed([*KINDS[:4]] * 100, 1, build="a" * 64)
    after = placed([*KINDS[:2]] * 100 + [KINDS[2]] * 200, 2, build="b" * 64)
    found = compare_spaces(together(before, after), ("before", "after"), ("", ""))
    assert found.notes[:2] == (
        "the first space: 400 scenarios driven by build aaaaaaaaaaaa",
        "the second space: 400 scenarios driven by build bbbbbbbbbbbb",
    )  # fmt: skip
    assert (found.only_one, found.only_other) == (1, 0)
    gone, more, *others = found.kinds
    assert {round(gone.difference.value, 9), round(more.difference.value, 9)} == {0.25, -0.25}
    assert all(one.difference.low < 0.0 < one.difference.high for one in others)
    lost = gone if gone.other == 0 else more
    assert lost.difference.low > 0.0
    assert found.apart.low > 0.0
    same = compare_spaces(together(before, placed([*KINDS[:4]] * 100, 3, build="b" * 64)), ("", ""), ("", ""))
    assert same.apart.low == 0.0
    assert all(one.difference.low < 0.0 < one.difference.high for one in same.kinds)


@pytest.mark.parametrize("width", [400, 1280])
def test_the_page_of_a_release_is_read_on_a_phone_and_a_desk(tmp_path: Path, width: int) -> None:
    space = space_of([*KINDS[:5]] * 2, hours=1.0)
    held = reliability(np.array([0.0, 0.05]), np.array([0.0, np.nan]))
    covered = cover(space, members(space, 1, 0.0), held)
    write_release_page(decide(space, covered, limits(8e-6), HASHES), covered, tmp_path)
    with chromium() as browser, opened(browser, tmp_path / "release.html", width=width) as page:
        assert page.evaluate("() => document.documentElement.scrollWidth") <= width
        assert not too_faint(page)
        rows = page.evaluate("() => [...document.querySelectorAll('tbody tr')].map(r => r.offsetHeight)")
        assert max(rows) <= 120, rows
        words = page.inner_text("body")
    assert "members count in 1 drive, at least 30 are needed" in words
    assert "2 held-out drives: not shown. Without a prediction or an outcome: 1." in words
