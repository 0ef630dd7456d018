"""Members of one draw of what traffic does are no evidence of each other."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from space.families import drawn, lasting
from space.spaces import KINDS, source, space_of

from resim.core.geometry import Floats
from resim.core.intervals import exact
from resim.space.build import build_space
from resim.space.calibration import reliability
from resim.space.coverage import SeenScenarios, coverage
from resim.space.draws import Driven, drive_lengths, drive_numbers, recording_draws, scenario_draws
from resim.space.expected import ExposedScenarios, RiskLimit, expected_accidents, risk_limit
from resim.space.members import MEMBER_COLUMNS, DrivenTraces, SimulatedRun, TestDrive, judged_members
from resim.space.model import Space
from resim.space.risk import ClusterRisk, DrawRisk, cluster_risks
from resim.space.statistics.rates import UNKNOWN, scatter, share, worth
from resim.space.statistics.unseen import unseen_by_drive
from resim.space.traces import joined

BUCKET = "m-1, road 1 +, 3 lanes, 4 vehicles"
BELIEVED = reliability(np.repeat([0.0, 0.0005, 0.005, 0.02, 0.05, 0.2, 0.5], 4000), np.zeros(28000))
DRIVE = TestDrive("drive", "drive", "b", "", "verified", True)


@pytest.fixture(scope="module")
def space() -> Space:
    return space_of([*KINDS[:3]] * 4, build="b")


def of_one_kind(
    keys: list[str], scenario: dict[str, str] | None = None, **told: dict[str, str]
) -> DrivenTraces:
    """Recordings like each other, and the drive that speaks for them."""
    rng = np.random.default_rng(5)
    every = [*keys, "drive"]
    traces = joined([lasting(drawn(KINDS[0], key, rng, 0.1), 40) for key in every])
    return DrivenTraces(
        traces, dict.fromkeys(every, BUCKET), {**dict.fromkeys(every, ""), **(scenario or {})}, **told
    )


def first_cluster(space: Space, runs: list[SimulatedRun], known: DrivenTraces) -> ClusterRisk:
    members = judged_members(space, runs, [DRIVE], known, 0.7)
    return {one.cluster: one for one in cluster_risks(space, members, "b")}["1.1"]


def test_what_was_cut_out_of_one_drive_is_one_draw(space: Space) -> None:
    rows, names = space.rows, space.rows["scenario"].astype(str).tolist()
    assert scenario_draws(rows).tolist() == names
    parts = rows.assign(drive=["a", "a", "b", *["c"] * (len(rows) - 3)])
    assert scenario_draws(parts).tolist() == [names[0]] * 2 + [names[2]] + [names[3]] * (len(rows) - 3)
    assert not len(scenario_draws(rows.iloc[:0]))


def test_seeds_and_variations_of_one_recording_are_one_scenario() -> None:
    bare = space_of([KINDS[0]] * 40)
    runs = [SimulatedRun(str(k), "run", "b", "", float(k == 3), k == 3, same=str(k)) for k in range(40)]
    found = first_cluster(bare, runs, of_one_kind(["run"], {"run": "one_0"}))
    assert (found.counted, found.drives) == (40, 1)
    assert found.risk.value == pytest.approx(1 / 40)
    assert (found.risk.low, found.risk.high) == pytest.approx(tuple(float(x) for x in exact(1 / 40, 1.0)))
    keys = [f"r{k}" for k in range(40)]
    apart = [replace(run, recording=key) for run, key in zip(runs, keys, strict=True)]
    scenarios = {key: f"one_{k}" for k, key in enumerate(keys)}
    assert first_cluster(bare, apart, of_one_kind(keys, scenarios)).drives == 40


def test_a_run_of_a_test_drive_is_no_further_drive_beside_it(space: Space) -> None:
    name = str(space.rows["scenario"].iloc[0])
    run = SimulatedRun("1", "run", "b", "", 0.25, False)
    alone = first_cluster(space, [], of_one_kind(["run"]))
    as_scenario = first_cluster(space, [run], of_one_kind(["run"], {"run": name}))
    of_drive = replace(
        space, sources=tuple(replace(one, recordings={"one/0": "run"}) for one in space.sources)
    )
    as_drive = first_cluster(of_drive, [run], of_one_kind(["run"]))
    as_part = first_cluster(
        replace(of_drive, sources=tuple(replace(one, recordings={"one/0": "whole"}) for one in space.sources)),
        [run], of_one_kind(["run"], drive={"run": "whole"}),
    )  # fmt: skip
    other = first_cluster(space, [run], of_one_kind(["run"]))
    every = (alone, as_scenario, as_drive, as_part, other)
    assert [one.drives for one in every] == [4] * 5
    assert [one.counted for one in every] == [0, 1, 1, 1, 0]
    assert [one.draws[0].risk for one in every[1:4]] == [0.25, 0.125, 0.125]  # of a scenario, or beside it
    assert sum(one.others for one in other.draws) == 1


def test_what_collided_on_the_road_is_an_accident_whatever_its_runs_did(space: Space) -> None:
    name = str(space.rows["scenario"].iloc[0])
    hit = replace(space, rows=space.rows.assign(collided=space.rows["scenario"] == name))
    runs = [SimulatedRun(str(k), "run", "b", "", 0.0, False, same=str(k)) for k in range(9)]
    assert first_cluster(hit, runs, of_one_kind(["run"], {"run": name})).draws[0].risk == 1.0


def test_recordings_beside_the_space_are_one_with_their_mates_in_it(space: Space) -> None:
    name = str(space.rows["scenario"].iloc[4])
    of_drives = {"a": "x", "b": "x", "c": "y", "d": "y"}
    found = recording_draws(space, {"a": name, "b": "", "c": "", "d": "", "e": ""}, of_drives)
    assert found == {"a": name, "b": name, "c": "y", "d": "y", "e": "e"}


def test_a_drive_weighs_as_many_scenarios_as_it_has() -> None:
    """Else one drive in the rain with ten of them would weigh as little as a dry one with one."""
    rain, dry = DrawRisk(10, 0.3, 0.3, 0.3, 0, 0.0, 0.0), DrawRisk(1, 0.0, 0.0, 0.0, 0, 0.0, 0.0)
    found = ClusterRisk("1.1", 0, 0, 19, 0, 0, 0, 0, UNKNOWN, (rain, *[dry] * 9), (), {})
    (mean,), (drives,) = found.means(largest=True)
    assert mean == pytest.approx(3.0 / 19.0)
    assert drives == pytest.approx(19.0**2 / (100.0 + 9.0))


@pytest.mark.parametrize("drives", [5, 10, 40])
def test_the_limit_holds_where_drives_differ(drives: int) -> None:
    """One drive in ten is in the rain, where three of ten scenarios are accidents; elsewhere one of a thousand is."""
    rng, held, truth = np.random.default_rng(4), 0, 0.1 * 0.3 + 0.9 * 0.001
    for _ in range(300):
        count = rng.integers(1, 60, drives)
        risk = rng.binomial(count, np.where(rng.random(drives) < 0.1, 0.3, 0.001)) / count
        draws = tuple(
            DrawRisk(int(n), float(r), float(r), float(r), 0, 0.0, 0.0)
            for n, r in zip(count, risk, strict=True)
        )
        mean = share(float((risk * count).sum() / count.sum()), 1.0)
        one = ClusterRisk("1.1", 0, 0, 0, 0, 0, 0, 0, mean, draws, (), {})
        held += truth <= risk_limit(one, 0.05, 1, BELIEVED).high
    assert held >= 0.93 * 300


@pytest.mark.parametrize("drives", [5, 30, 100])
@pytest.mark.parametrize("shape", [1.0, 3.0, 1e6])
def test_rates_hold_where_drives_differ(drives: int, shape: float) -> None:
    """How much comes in a drive differs from drive to drive: rush hour and night. 20 an hour in the mean."""
    rng, held, high = np.random.default_rng(6), 0, 0
    for _ in range(500):
        number = np.repeat(np.arange(drives), rng.poisson(20.0 * rng.gamma(shape, 1.0 / shape, drives)))
        found, _ = Driven((float(drives), 1.0), drives, np.ones((drives, 2))).rates(number)
        held += found.low <= 20.0 and not found.high < 20.0
        exposed = ExposedScenarios(number * 0, np.arange(len(number)), number, 1)
        terms = expected_accidents(exposed, [RiskLimit(np.nan, 0.0, 1.0, False)], float(drives), 0.95)
        high += terms.thin >= 20.0
    assert held >= 0.93 * 500
    assert high >= 0.93 * 500


def town_and_motorway(rng: np.random.Generator, drives: int) -> Floats:
    """h of each: one in ten is long."""
    return np.where(rng.random(drives) < 0.9, 0.3, 4.0)


LONG = {
    "town and motorway": (town_and_motorway, 0.67), "drawn": (lambda rng, n: rng.lognormal(0.0, 1.0, n), np.exp(0.5)),
    "alike": (lambda rng, n: np.ones(n), 1.0),
}  # fmt: skip


@pytest.mark.parametrize("drives", [30, 100])
@pytest.mark.parametrize("lengths", LONG)
def test_rates_hold_where_long_drives_bring_no_more(lengths: str, drives: int) -> None:
    """Six come in a drive, however long it is, and how many long ones there are is drawn, too."""
    drawn_hours, mean = LONG[lengths]
    rng, held, high, truth = np.random.default_rng(11), 0, 0, 6.0 / mean
    for _ in range(500):
        hours = drawn_hours(rng, drives)
        number = np.repeat(np.arange(drives), rng.poisson(6.0, drives))
        found, _ = Driven((hours.sum(), 1.0), drives, np.stack([hours, hours], axis=1)).rates(number)
        held += found.low <= truth <= found.high
        exposed = ExposedScenarios(number * 0, np.arange(len(number)), number, 1, hours)
        terms = expected_accidents(exposed, [RiskLimit(np.nan, 0.0, 1.0, False)], hours.sum(), 0.95)
        high += terms.thin >= truth
    assert held >= 0.93 * 500
    assert high >= 0.93 * 500


@pytest.mark.parametrize("drives", [30, 100])
@pytest.mark.parametrize("lengths", LONG)
def test_the_rate_of_new_kinds_holds_where_long_drives_bring_no_more(lengths: str, drives: int) -> None:
    """Six come in a drive, however long it is, each of a kind of its own."""
    drawn_hours, mean = LONG[lengths]
    rng, held, truth = np.random.default_rng(13), 0, 6.0 / mean
    for _ in range(150):
        hours = drawn_hours(rng, drives)
        number = np.repeat(np.arange(drives), rng.poisson(6.0, drives))
        until, nothing = np.cumsum(hours)[number], np.zeros(len(number))
        driven = Driven((hours.sum(), hours.sum()), drives, np.stack([hours, hours], axis=1))
        kind = np.arange(len(number))
        found = coverage(SeenScenarios(kind, kind, nothing, until, until, driven, number)).discovery_per_hour
        held += found.low <= truth <= found.high
    assert held >= 0.93 * 150


def test_no_scatter_falls_as_more_comes() -> None:
    rng = np.random.default_rng(12)
    for _ in range(200):
        sizes, lengths = rng.poisson(2.0, 20).astype(float), rng.lognormal(0.0, 1.5, 20)
        more = sizes + rng.poisson(1.0, 20).astype(float)
        assert scatter(more, lengths) >= scatter(sizes, lengths) >= (sizes**2).sum()
        assert scatter(sizes, np.ones(20)) == pytest.approx((sizes**2).sum())


@pytest.mark.parametrize("drives", [30, 100])
@pytest.mark.parametrize("long", [0.02, 0.05])
def test_no_upper_end_is_told_where_few_drives_have_most_of_the_time(long: float, drives: int) -> None:
    """Three come in a drive, and few are a thousand times as long as others; what is told holds."""
    rng, held, truth = np.random.default_rng(16), 0, 3.0 / (1.0 + 999.0 * long)
    for _ in range(500):
        hours = np.where(rng.random(drives) < long, 1000.0, 1.0)
        number = np.repeat(np.arange(drives), rng.poisson(3.0, drives))
        found, _ = Driven((hours.sum(), 1.0), drives, np.stack([hours, hours], axis=1)).rates(number)
        assert np.isnan(found.high) == (worth(hours) < 6.0)
        held += not found.high < truth
    assert held >= 0.955 * 500
    assert worth(np.array([1.0, 1.0, 1.0])) == 3.0
    assert np.isnan([worth(np.array([])), worth(np.zeros(2)), worth(np.array([1.0, np.nan]))]).all()


def test_lengths_of_drives_are_those_of_their_numbers() -> None:
    """Of what is one drive the longest, and those without a scenario behind them."""
    one = source("one", [KINDS[0]] * 4, 0)
    empty = replace(one.recordings[0], name="empty", hours=7.0, kilometres=70.0)
    hours = [0.1, 0.2, 0.3, 0.4]
    told = [replace(r, hours=h, kilometres=9.0 * h) for r, h in zip(one.recordings, hours, strict=True)]
    told[3] = replace(told[3], traffic="same")
    told[1] = replace(told[1], traffic="same a")
    space = build_space([replace(one, recordings=(*told, empty))])
    assert drive_numbers(space.rows).tolist() == [0, 1, 2, 1]
    assert drive_lengths(space)[:, 0].tolist() == [0.1, 0.4, 0.3, 7.0]
    assert drive_lengths(space)[:, 1] == pytest.approx([0.9, 3.6, 2.7, 70.0])
    assert drive_lengths(space).sum(axis=0) == pytest.approx(space.driven)


@pytest.mark.parametrize("drives", [5, 10, 30, 100])
def test_rates_hold_where_few_drives_have_most_of_what_comes(drives: int) -> None:
    """One in ten has 200 an hour; nothing is said of the upper end where it would not hold."""
    rng, held = np.random.default_rng(9), 0
    for _ in range(500):
        each = np.where(rng.random(drives) < 0.1, 200.0, 2.0)
        number = np.repeat(np.arange(drives), rng.poisson(each))
        found, _ = Driven((float(drives), 1.0), drives, np.ones((drives, 2))).rates(number)
        held += found.low <= 0.1 * 200.0 + 0.9 * 2.0 and not found.high < 0.1 * 200.0 + 0.9 * 2.0
        assert np.isnan(found.high) == (drives < 30)
    assert held >= 0.93 * 500


@pytest.mark.parametrize("drives", [5, 30, 100])
@pytest.mark.parametrize("kinds_each", [3, 60])
def test_the_unseen_share_holds_where_drives_have_kinds_of_their_own(drives: int, kinds_each: int) -> None:
    """The next drive has a few of 60 kinds, and each of them often."""
    rng, held = np.random.default_rng(7), 0
    rates = 1.0 / np.arange(1, 61)
    order = np.array([rng.choice(60, kinds_each, replace=False, p=rates / rates.sum()) for _ in range(4000)])
    for _ in range(500):
        rows = rng.integers(0, len(order), drives)
        kind = order[rows][:, rng.integers(0, kinds_each, 20)]
        truth = float((~np.isin(order, kind)).mean())
        found = unseen_by_drive(kind.ravel(), np.repeat(np.arange(drives), 20))
        held += found.low <= truth <= found.high
    assert held >= 0.93 * 500


@pytest.mark.parametrize("drives", [10, 20, 60, 200])
def test_the_unseen_share_holds_where_a_rare_drive_is_all_new(drives: int) -> None:
    """One in twenty is in the rain, with kinds of its own; all others have the same few."""
    rng, held = np.random.default_rng(8), 0
    for _ in range(500):
        rain = rng.random(drives) < 0.05
        kind = np.where(rain[:, None], 10, 0) + rng.integers(0, 4, (drives, 20))
        truth = (0.0 if rain.any() else 0.05) + (0.95 if rain.all() else 0.0)
        found = unseen_by_drive(kind.ravel(), np.repeat(np.arange(drives), 20))
        held += found.low <= truth <= found.high
    assert held >= 0.93 * 500


def test_a_scenario_whose_kind_is_lost_makes_the_unseen_share_no_smaller() -> None:
    """In one drive all is new: of what is alone most is of it, and what is alone elsewhere must not dilute that."""
    rng = np.random.default_rng(15)
    for _ in range(300):
        drive = np.repeat(np.arange(40), rng.integers(1, 8, 40))
        kind = np.where(drive == 0, 1000 + np.arange(len(drive)), rng.integers(0, 5, len(drive)))
        lost = kind.copy()
        lost[rng.integers(len(drive))] = 5000
        assert unseen_by_drive(lost, drive).high >= unseen_by_drive(kind, drive).high - 1e-12


@settings(deadline=None, max_examples=50)
@given(st.lists(st.tuples(st.integers(0, 7), st.sampled_from([0.0, 0.1, 0.5, 1.0, np.nan]), st.booleans()), min_size=1),
       st.data())  # fmt: skip
def test_a_member_that_no_longer_counts_or_is_known_makes_no_limit_smaller(
    told: list[tuple[int, float, bool]], data: st.DataObject
) -> None:
    rows = [(str(k), f"one_{n}", f"one_{n - n % 2}", "1.1", "d", 0.1, risk, False, counts, "", "") for k,
            (n, risk, counts) in enumerate(told)]  # fmt: skip
    frame = pd.DataFrame(rows, columns=list(MEMBER_COLUMNS)).astype({"collided": "boolean", "risk": float})
    k, change = data.draw(
        st.tuples(st.integers(0, len(told) - 1), st.sampled_from(["counts", "risk", "lost"]))
    )
    worse = frame.copy()
    if change == "lost":  # every run of its scenario
        worse = worse[worse["origin"] != worse.loc[k, "origin"]]
    else:
        worse.loc[k, change] = {"counts": False, "risk": np.nan}[change]

    def limit(members: pd.DataFrame) -> float:
        (one,) = cluster_risks(of_pairs(), members, "nobody")
        assert all(draw.least <= draw.most and draw.surely <= draw.possibly for draw in one.draws)
        assert sum(draw.counting + draw.others for draw in one.draws) >= 8
        return risk_limit(one, 0.01, 1, BELIEVED).high

    assert limit(worse) >= limit(frame) - 1e-12


@cache
def of_pairs() -> Space:
    """Eight scenarios of one kind, two in a drive."""
    return build_space([source("one", [KINDS[0]] * 8, 3, each=2)])
