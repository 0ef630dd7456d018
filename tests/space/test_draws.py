"""Members of one draw of what traffic does are no evidence of each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from space.families import drawn, lasting
from space.spaces import KINDS, space_of

from resim.core.intervals import exact
from resim.space.calibration import reliability
from resim.space.draws import recording_draws, scenario_draws
from resim.space.expected import risk_limit
from resim.space.members import MEMBER_COLUMNS, DrivenTraces, SimulatedRun, TestDrive, judged_members
from resim.space.model import Space
from resim.space.risk import ClusterRisk, cluster_risks
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


def test_windows_that_overlap_and_what_sees_the_same_are_one_draw(space: Space) -> None:
    rows = space.rows.assign(occasion=np.arange(len(space.rows)))
    names = rows["scenario"].astype(str).tolist()
    assert scenario_draws(rows).tolist() == names
    longer = rows.assign(
        end=rows["start"] + np.where(np.arange(len(rows)) < 2, 12.0, 8.0)
    )  # they begin 10 s apart
    assert scenario_draws(longer).tolist() == [names[0]] * 3 + names[3:]
    others = longer.assign(ego=[str(k) for k in range(len(rows))])
    assert scenario_draws(others).tolist() == names
    seen = rows.assign(occasion=np.r_[7, np.arange(1, len(rows))])
    assert scenario_draws(seen)[7] == names[0]
    assert not len(scenario_draws(rows.iloc[:0]))


@settings(deadline=None, max_examples=60)
@given(
    st.lists(
        st.tuples(st.integers(0, 2), st.integers(0, 30), st.integers(1, 9), st.integers(0, 12)), max_size=14
    )
)
def test_draws_are_those_of_a_plain_loop(windows: list[tuple[int, int, int, int]]) -> None:
    rows = pd.DataFrame(
        {"scenario": [f"s{k}" for k in range(len(windows))], "source": "a", "recording": "r",
         "ego": [str(ego) for ego, *_ in windows], "start": [float(start) for _, start, *_ in windows],
         "end": [float(start + lasts) for _, start, lasts, _ in windows], "occasion": [w[3] for w in windows]}
    )  # fmt: skip
    label = list(range(len(windows)))
    for _ in windows:
        for i, (ego, start, lasts, sees) in enumerate(windows):
            for j, (other, begin, length, seen) in enumerate(windows):
                if sees == seen or (ego == other and start < begin + length and begin < start + lasts):
                    label[i] = label[j] = min(label[i], label[j])
    assert scenario_draws(rows).tolist() == [f"s{k}" for k in label]


def test_seeds_and_variations_of_one_recording_are_one_scenario() -> None:
    bare = space_of([KINDS[0]] * 40)
    runs = [SimulatedRun(str(k), "run", "b", "", float(k == 3), k == 3, same=str(k)) for k in range(40)]
    found = first_cluster(bare, runs, of_one_kind(["run"], {"run": "one_0"}))
    assert (found.counted, found.scenarios) == (40, 1)
    assert found.risk.value == pytest.approx(1 / 40)
    assert (found.risk.low, found.risk.high) == pytest.approx(tuple(float(x) for x in exact(1 / 40, 1.0)))
    keys = [f"r{k}" for k in range(40)]
    apart = [replace(run, recording=key) for run, key in zip(runs, keys, strict=True)]
    scenarios = {key: f"one_{k}" for k, key in enumerate(keys)}
    assert first_cluster(bare, apart, of_one_kind(keys, scenarios)).scenarios == 40


def test_a_run_of_a_test_drive_is_no_further_scenario_beside_it(space: Space) -> None:
    name = str(space.rows["scenario"].iloc[0])
    run = SimulatedRun("1", "run", "b", "", 0.25, False)
    alone = first_cluster(space, [], of_one_kind(["run"]))
    as_scenario = first_cluster(space, [run], of_one_kind(["run"], {"run": name}))
    of_drive = replace(space, sources=tuple(replace(one, recordings={"one": "run"}) for one in space.sources))
    as_drive = first_cluster(of_drive, [run], of_one_kind(["run"]))
    as_part = first_cluster(
        replace(of_drive, sources=tuple(replace(one, recordings={"one": "whole"}) for one in space.sources)),
        [run], of_one_kind(["run"], drive={"run": "whole"}),
    )  # fmt: skip
    other = first_cluster(space, [run], of_one_kind(["run"]))
    assert [one.scenarios for one in (alone, as_scenario, as_drive, as_part, other)] == [4] * 5
    assert [one.counted for one in (alone, as_scenario, as_drive, as_part, other)] == [0, 1, 1, 1, 0]
    assert {one.draws[0].risk for one in (as_scenario, as_drive, as_part)} == {0.25}


def test_what_collided_on_the_road_is_an_accident_whatever_its_runs_did(space: Space) -> None:
    name = str(space.rows["scenario"].iloc[0])
    hit = replace(space, rows=space.rows.assign(collided=space.rows["scenario"] == name))
    runs = [SimulatedRun(str(k), "run", "b", "", 0.0, False, same=str(k)) for k in range(9)]
    assert first_cluster(hit, runs, of_one_kind(["run"], {"run": name})).draws[0].risk == 1.0


def test_recordings_beside_the_space_are_one_with_their_mates_in_it(space: Space) -> None:
    name = str(space.rows["scenario"].iloc[4])
    found = recording_draws(
        space, {"a": name, "b": "", "c": "", "d": ""}, {}, {}, {"a": "a", "b": "a", "c": "c", "d": "c"}
    )
    assert found == {"a": name, "b": name, "c": "c", "d": "c"}


@settings(deadline=None, max_examples=60)
@given(st.lists(st.tuples(st.integers(0, 3), st.sampled_from([0.0, 0.1, 0.5, 1.0, np.nan]), st.booleans()), min_size=1),
       st.data())  # fmt: skip
def test_a_member_that_no_longer_counts_or_is_known_makes_no_limit_smaller(
    space: Space, told: list[tuple[int, float, bool]], data: st.DataObject
) -> None:
    rows = [(str(k), "o", str(draw), "1.1", "d", 0.1, risk, False, counts, "", "") for k, (draw, risk, counts) in
            enumerate(told)]  # fmt: skip
    frame = pd.DataFrame(rows, columns=list(MEMBER_COLUMNS)).astype({"collided": "boolean", "risk": float})
    k, column, value = data.draw(
        st.tuples(st.integers(0, len(told) - 1), *[st.just(x) for x in ("counts", False)])
        | st.tuples(st.integers(0, len(told) - 1), *[st.just(x) for x in ("risk", np.nan)])
    )
    worse = frame.copy()
    worse.loc[k, column] = value

    def limit(members: pd.DataFrame) -> float:
        one = cluster_risks(space, members, "nobody")[0]
        assert all(draw.least <= draw.most for draw in one.draws)
        assert all(
            draw.least - 1e-12 <= draw.risk <= draw.most + 1e-12 for draw in one.draws[: one.scenarios]
        )
        return risk_limit(one, 0.01, 1, BELIEVED).high

    assert limit(worse) >= limit(frame) - 1e-12
