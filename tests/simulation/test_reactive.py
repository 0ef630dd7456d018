"""Traffic that reacts: which objects are handed over, how they drive; none while the EGO is where it was measured."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import duckdb
import numpy as np
import pandas as pd
import pytest
from conftest import ROOT
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from resim.core.errors import InputError
from resim.metrics.criteria import read_criteria
from resim.recordings import read_commonroad, read_recording
from resim.resimulation import AssessmentOptions, ResimulationOptions, assess_resimulation, resimulate
from resim.resimulation.notes import handed_over
from resim.road.opendrive import RoadNetwork
from resim.scenario.scenario import Scenario
from resim.simulation.case import HandedOver, SimulatedDrive
from resim.simulation.direct import Direct
from resim.simulation.function.interface import load_build
from resim.simulation.guide import Guide
from resim.simulation.reactive.drivers import GRID, Following, TrafficDriver, fitted, followed
from resim.simulation.reactive.people import followings, traffic_driver
from resim.simulation.reactive.settings import (
    DriverSettings,
    HandOverSettings,
    LaneChangeSettings,
    ReactiveSettings,
    traffic_of,
)
from resim.simulation.reactive.ways import Boxed, Way
from resim.simulation.sumo.engine import Sumo
from resim.simulation.traffic import staged

Drive = Callable[..., SimulatedDrive]
Make = Callable[..., Any]
Member = Callable[..., Any]
REACTIVE = ReactiveSettings()
FOLLOWS = ReactiveSettings(lane_change=LaneChangeSettings(possible=False))
NGSIM = ROOT.parent / "shared" / "data" / "ngsim"
BRAKES = "return Command(-4.0 if perceived.t > 0.5 and perceived.ego.v > 0.1 else 0.0, 0.0)"


def behind(member: Member, gap: float = 25.0, **how: Any) -> tuple[Any, Any]:
    return member("ego", 300.0, end=8.0), member("f", 300.0 - gap - 4.7, end=8.0, **how)


def gaps(drive: SimulatedDrive, n: int = 1) -> np.ndarray:
    return drive.truth.x[0] - drive.truth.x[n] - 4.7


def test_a_follower_brakes_for_an_ego_that_brakes_otherwise_than_measured(
    drive: Drive, function: Make, member: Member
) -> None:
    build = function(BRAKES)
    hit = drive(build, *behind(member))
    assert hit.end == "collision"
    assert hit.handed_over == ()
    reacts = drive(build, *behind(member), traffic=FOLLOWS)
    assert reacts.end == "duration"
    assert gaps(reacts).min() > 1.0
    (one,) = reacts.handed_over
    assert one.id == "f"
    assert 0.5 < one.t < 3.0
    assert one.back is None
    assert "its driver wants -" in one.why
    assert "ego" in one.why
    still = 300.0 - 25.0 - 4.7 + 20.0 * reacts.truth.t
    assert one.farthest == pytest.approx((still - reacts.truth.x[1]).max(), abs=1e-6)


def test_who_drives_as_measured_hands_nobody_over(drive: Drive, function: Make, member: Member) -> None:
    """To the byte: whether by the trace or by a function that does the same."""
    own = load_build(ROOT / "adfunc" / "builds" / "replay-1.0.toml")
    for gap in (1.0, 8.0, 25.0):  # however close it was measured
        one, two = (drive(own, *behind(member, gap), traffic=t) for t in (None, REACTIVE))
        assert two.handed_over == ()
        for column in ("x", "y", "heading", "v"):
            assert getattr(one.truth, column).tobytes() == getattr(two.truth, column).tobytes()


def test_who_has_caught_up_is_back_on_its_trace(drive: Drive, function: Make, member: Member) -> None:
    body = "return Command(-2.0 if 0.5 < perceived.t < 1.5 else 2.0 if 2.0 < perceived.t < 5.0 else 0.0, 0.0)"
    build = function(body)
    ego, other = member("ego", 300.0, end=26.0), member("f", 283.0, end=26.0)
    found = drive(build, ego, other, traffic=FOLLOWS)
    assert found.end == "duration"
    assert found.handed_over[-1].back is not None
    trace = 283.0 + 20.0 * found.truth.t
    after = found.truth.t >= found.handed_over[-1].back
    np.testing.assert_allclose(found.truth.x[1, after], trace[after], atol=1e-6)
    assert (found.truth.x[1] <= trace + 1e-6).all()


def test_the_one_behind_it_brakes_too(drive: Drive, function: Make, member: Member) -> None:
    ego, first = behind(member)
    second = member("g", 300.0 - 2 * 29.7, end=8.0)
    found = drive(function(BRAKES), ego, first, second, traffic=FOLLOWS)
    assert [one.id for one in found.handed_over] == ["f", "g"]
    assert (found.truth.x[1] - found.truth.x[2] - 4.7).min() > 0.5


@pytest.mark.parametrize(
    "other",
    [
        {"kind": "pedestrian"},  # nobody drives them
        {"lane": -1},  # beside, not behind
        {"v": [-0.5, -1.0, -1.0]},  # who reverses
    ],
)
def test_who_stays_on_its_trace(drive: Drive, function: Make, member: Member, other: dict[str, Any]) -> None:
    kind = other.pop("kind", "car")
    ego, one = behind(member, **other)
    found = drive(function(BRAKES), ego, replace(one, kind=kind), traffic=REACTIVE)
    assert found.handed_over == ()


def test_a_driver_drives_as_the_equation_says(drive: Drive, function: Make, member: Member) -> None:
    """Against an integration of Treiber's equation by SciPy, from where it was handed over."""
    own = DriverSettings(time_gap=1.3, standstill=2.5, acceleration=1.1, deceleration=1.7, reaction=0.0)
    how = ReactiveSettings(
        car=own, calibrated=False, hand_over=HandOverSettings(hardest=50.0, harder=0.5),
        lane_change=LaneChangeSettings(possible=False),
    )  # fmt: skip
    found = drive(function(BRAKES), *behind(member), traffic=how, step=0.01)
    t, x, v, ego, ego_v = (
        found.truth.t,
        found.truth.x[1],
        found.truth.v[1],
        found.truth.x[0],
        found.truth.v[0],
    )
    begin = int(np.flatnonzero(t >= found.handed_over[0].t)[0])

    def equation(now: float, state: np.ndarray) -> list[float]:
        s, speed = state
        gap, closing = np.interp(now, t, ego) - s - 4.7, speed - np.interp(now, t, ego_v)
        wish = 2.5 + max(0.0, speed * 1.3 + speed * closing / (2.0 * np.sqrt(1.1 * 1.7)))
        a = 1.1 * (1.0 - (speed / 22.0) ** 4 - (wish / gap) ** 2)
        return [speed, a if speed > 0.0 or a > 0.0 else 0.0]

    solved = solve_ivp(equation, (t[begin], t[-1]), [x[begin], v[begin]], t_eval=t[begin:], max_step=0.01)
    moving = solved.y[1] > 0.3
    np.testing.assert_allclose(x[begin:][moving], solved.y[0][moving], atol=0.1)
    np.testing.assert_allclose(v[begin:][moving], solved.y[1][moving], atol=0.1)


@given(
    st.lists(st.floats(-7.0, 3.0), min_size=4, max_size=4), st.floats(3.0, 60.0), st.floats(0.0, 0.8)
)  # fmt: skip
@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@pytest.mark.slow
def test_whatever_the_ego_does_drivers_move_as_vehicles_do(
    drive: Drive, function: Make, member: Member, commands: list[float], gap: float, off: float
) -> None:
    build = function(f"return Command({commands!r}[min(int(max(perceived.t, 0.0) // 2), 3)], 0.0)")
    ego, other = behind(member, gap, t=off)
    found = drive(build, ego, other, traffic=REACTIVE)
    t, x, y, v = found.truth.t, found.truth.x[1], found.truth.y[1], found.truth.v[1]
    dt = np.diff(t)
    assert np.isfinite(x).all()
    assert (x <= 300.0 - gap - 4.7 + 20.0 * t + 1e-6).all()
    assert (v >= 0.0).all()
    assert (np.diff(v) / dt >= -REACTIVE.hand_over.hardest - 1e-6).all()
    assert all(one.hardest <= REACTIVE.hand_over.hardest + 1e-6 for one in found.handed_over)
    np.testing.assert_allclose(np.hypot(np.diff(x), np.diff(y)), 0.5 * (v[1:] + v[:-1]) * dt, atol=0.06)
    again = drive(build, ego, other, traffic=REACTIVE)
    assert again.fingerprint() == found.fingerprint()


@pytest.mark.skipif(not NGSIM.is_dir(), reason="no recordings")
@pytest.mark.parametrize(("name", "ego"), [
    pytest.param("USA_US101-22_1_T-1", "675", marks=pytest.mark.slow),
    pytest.param("USA_Lanker-1_17_T-1", "11430", marks=pytest.mark.slow),
])  # fmt: skip
def test_both_engines_give_the_same_and_replay_hands_nobody_over(name: str, ego: str) -> None:
    recording = read_commonroad(NGSIM / f"{name}.xml", map=NGSIM / f"{name}.xodr", ego=ego)

    def run(build: str, engine: Any, traffic: ReactiveSettings | None) -> SimulatedDrive:
        options = ResimulationOptions(bases=("GT",), traffic=traffic, engine=engine)
        return resimulate(
            recording, load_build(ROOT / "adfunc" / "builds" / f"{build}.toml"), options
        ).drives["rGT"]

    one, other = (run("highway_pilot-1.2", engine, REACTIVE) for engine in (Direct(), Sumo()))
    assert one.fingerprint() == other.fingerprint()
    assert one.handed_over
    replayed, before = (run("replay-1.0", Direct(), traffic) for traffic in (REACTIVE, None))
    assert replayed.handed_over == ()
    same = {k: v for k, v in before.fingerprint().items() if k != "case"}
    assert {k: v for k, v in replayed.fingerprint().items() if k != "case"} == same


def test_a_driver_is_found_again_in_what_it_drove() -> None:
    """Followed with known values by an integration of its own; the grid's nearest are found."""
    rng = np.random.default_rng(2)
    true = TrafficDriver(33.0, 1.5, 2.0, 1.4, 2.0, 0.0)
    stretches = []
    for _ in range(3):
        t = np.arange(0.0, 30.0, 0.01)
        lead_v = np.clip(20.0 + np.cumsum(rng.normal(0.0, 0.12, len(t))), 5.0, 30.0)
        lead = 40.0 + np.cumsum(lead_v) * 0.01
        s, v, own = 0.0, 20.0, []
        for k in range(len(t)):
            own.append((s, v))
            gap, closing = lead[k] - s, v - lead_v[k]
            wish = 2.0 + max(0.0, v * 1.5 + v * closing / (2.0 * np.sqrt(1.4 * 2.0)))
            v = max(v + 0.01 * 1.4 * (1.0 - (v / 33.0) ** 4 - (wish / gap) ** 2), 0.0)
            s += v * 0.01
        place, speed = np.array(own)[:: round(GRID / 0.01)].T
        every = slice(None, None, round(GRID / 0.01))
        stretches.append(Following(place, speed, lead[every] - place, lead_v[every], GRID))
    start = replace(true, time_gap=1.0, acceleration=0.9, reaction=0.4)
    found = fitted(start, stretches)
    assert (found.time_gap, found.acceleration) == (1.5, 1.4)
    assert found.fitted == pytest.approx(90.0, abs=1.0)
    off = [np.abs(followed(found, one) - one.gap).mean() for one in stretches]
    assert max(off) < 1.0
    assert fitted(start, [stretches[0].part(slice(0, 8))]) == start  # too little to say


def test_files_that_say_otherwise_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "traffic.toml"
    file.write_text(
        "calibrated = false\n[hand_over]\nharder = 2.0\n[truck]\ntime_gap = 2.5\n", encoding="utf-8"
    )
    read = traffic_of(str(file))
    assert read is not None
    assert (read.calibrated, read.hand_over.harder, read.truck.time_gap) == (False, 2.0, 2.5)
    file.write_text("[hand_over]\nharder = -1.0\nsofter = 1.0\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"hand_over.*harder"):
        traffic_of(str(file))
    with pytest.raises(InputError, match="no way for traffic to move"):
        traffic_of("ractive")


def plan_of(x: np.ndarray, y: np.ndarray, dt: float = 0.1) -> Guide:
    """One object on a way, as a guide has it in row 0."""
    dx, dy = np.gradient(x, dt), np.gradient(y, dt)
    rows = [c[None] for c in (x, y, np.arctan2(dy, dx), np.hypot(dx, dy), np.zeros(len(x)), np.zeros(len(x)))]
    return Guide(dt * np.arange(len(x)), *rows, np.ones((1, len(x)), dtype=bool), 0)


def standing(x: float, y: float, heading: float = 0.0) -> Boxed:
    one = (np.array([value]) for value in (heading, 0.0, 4.7, 1.9, np.nan))
    return Boxed(np.array([x + 1j * y]), *one)


def test_gaps_are_along_the_way_however_it_bends() -> None:
    """A quarter of a circle of 50 m: the gap is the arc, less half a length each."""
    angle = np.linspace(0.0, 0.5 * np.pi, 120)
    way = Way(plan_of(50.0 * np.sin(angle), 50.0 * (1.0 - np.cos(angle))), 0, 4.7, 1.9)
    for arc in (0.4, 0.8, 1.3):
        found = way.others(0.0, standing(50.0 * np.sin(arc), 50.0 * (1.0 - np.cos(arc)), arc))
        assert found.ahead.tolist() == [True]
        assert found.gap[0] == pytest.approx(50.0 * arc - 4.7, abs=0.3)
        beside = way.others(0.0, standing(53.5 * np.sin(arc), 50.0 - 53.5 * np.cos(arc), arc))
        assert beside.ahead.tolist() == [False]


def test_who_stands_where_a_way_crosses_itself_is_met_at_the_first_time() -> None:
    straight, turn = np.linspace(0.0, 40.0, 80), np.linspace(0.0, 1.5 * np.pi, 200)[1:]
    loop = 40.0 + 20.0 * np.sin(turn), 20.0 * (1.0 - np.cos(turn))
    down = np.linspace(20.0, -30.0, 100)[1:]
    x = np.concatenate([straight, loop[0], np.full(99, 20.0)])
    y = np.concatenate([np.zeros(80), loop[1], down])
    way = Way(plan_of(x, y), 0, 4.7, 1.9)
    found = way.others(6.0, standing(20.0, 0.2, 0.3))
    assert found.ahead.tolist() == [True]
    assert found.gap[0] == pytest.approx(14.0 - 4.7, abs=0.6)


def test_who_is_beyond_the_last_place_is_on_the_way_straight_on() -> None:
    way = Way(plan_of(np.linspace(0.0, 40.0, 40), np.zeros(40)), 0, 4.7, 1.9)
    assert way.others(30.0, standing(60.0, 0.0)).gap[0] == pytest.approx(30.0 - 4.7, abs=0.1)
    assert not way.others(30.0, standing(60.0, 3.5)).ahead.any()
    assert not way.others(30.0, standing(20.0, 0.0)).ahead.any()


def test_who_creeps_back_and_forth_comes_no_further() -> None:
    t = np.arange(0.0, 60.0, 0.1)
    x = 0.1 * np.sin(0.4 * t)
    plan = plan_of(x, np.zeros(len(t)))
    way = Way(replace(plan, heading=np.zeros((1, len(t))), v=np.gradient(x, 0.1)[None]), 0, 4.7, 1.9)
    assert way.s[way.count - 1] < 0.11


def test_the_curvature_of_a_way_is_that_of_its_bend() -> None:
    angle = np.linspace(0.0, 0.5 * np.pi, 100)
    x = np.concatenate([np.linspace(-50.0, 0.0, 100), 12.0 * np.sin(angle)[1:], np.full(60, 12.0)])
    y = np.concatenate([np.zeros(100), 12.0 * (1.0 - np.cos(angle))[1:], 12.0 + np.linspace(1.0, 90.0, 60)])
    way = Way(plan_of(x, y), 0, 4.7, 1.9)
    assert way.bend(59.0) == pytest.approx(1.0 / 12.0, rel=0.1)
    assert abs(way.bend(20.0)) < 1e-3


@pytest.mark.parametrize("step", [0.02, 0.05, 0.1])
def test_drivers_are_calibrated_alike_at_any_step(member: Member, network: RoadNetwork, step: float) -> None:
    speeds = 20.0 + 3.0 * np.sin(np.linspace(0.0, 8.0, 40))
    leader = member("ego", 330.0, speeds, end=24.0)
    follower = member("f", 300.0, np.roll(speeds, 2), end=24.0)
    scenario = Scenario("proving_ground.xodr", 24.0, leader, (follower,))
    stage = staged(scenario, network, step, 0.0)
    (one,) = followings(stage, 1)
    assert one.time == pytest.approx(24.0, abs=0.5)
    found = traffic_driver(stage, REACTIVE, 1)
    fine = traffic_driver(staged(scenario, network, 0.04, 0.0), REACTIVE, 1)
    assert found is not None
    assert fine is not None
    assert found.fitted == pytest.approx(24.0, abs=0.5)
    assert abs(found.time_gap - fine.time_gap) <= 0.3


def test_of_many_who_were_handed_over_the_hardest_are_told() -> None:
    found = [HandedOver(f"o{k}", float(k), "why", None, 1.0, float(k % 7)) for k in range(20)]
    told = handed_over(found)
    assert [name in told for name in ("o6 at", "o13 at", "o5 at", "o0 at")] == [True, True, True, False]
    assert told.index("o5 at") < told.index("o6 at") < told.index("o13 at")
    assert "20 traffic objects" in told
    assert told.endswith("and 17 times more, braking no harder")


@pytest.mark.parametrize("clock", [0.0, 1.0, 1_732_500_000.0])
def test_who_left_its_trace_and_whose_recording_ends_is_not_gone_for_the_verdict(
    tmp_path: Path, clock: float
) -> None:
    """The EGO changes in front of a faster car; it brakes where that car's recording ends, with it at its bumper."""
    size = {"kind": "car", "heading": 0.0, "length": 4.7, "width": 1.9}
    rows = [
        {"t": clock + t, "id": name, "x": at + v * t, "y": y, "v": v, **size}
        for t in np.arange(0.0, 20.01, 0.04).round(2).tolist()
        for name, at, v, y, end in (("ego", 300.0, 20.0, -5.25, 20.0), ("on", 265.0, 28.0, -1.75, 16.0))
        if t <= end
    ]
    pd.DataFrame(rows).to_csv(tmp_path / "gt.csv", index=False)
    road = ROOT / "networks" / "proving_ground.xodr"
    (tmp_path / "recording.toml").write_text(f'name = "d"\nmap = "{road}"\nego = "ego"\n', encoding="utf-8")
    bend = f"0.004 if {clock + 1.0} < p.t < {clock + 2.2} else -0.004 if {clock + 2.2} < p.t < {clock + 3.4} else 0.0"
    cut_in = f"return Command(-8.0 if p.t > {clock + 16.5} and p.ego.v > 0.2 else 0.0, {bend})"
    keeps = "return Command(0.0, 0.0)"
    recording, verdicts = read_recording(tmp_path), {}
    criteria = read_criteria(ROOT / "scenarios" / "criteria" / "highway.toml")
    for name, answer in (("cut_in", cut_in), ("keeps", keeps)):
        head, _, _ = BRAKING.partition("        return")
        (tmp_path / f"{name}.py").write_text(
            f"{head}        {answer}\n\n    def close(self):\n        pass\n"
        )
        build = tmp_path / f"{name}.toml"
        build.write_text(f'name = "b"\nversion = "1"\nfactory = "{name}:Brakes"\n', encoding="utf-8")
        options = ResimulationOptions(bases=("GT",), traffic=REACTIVE, engine=Direct())
        result = resimulate(recording, load_build(build), options)
        found = assess_resimulation(result, AssessmentOptions(criteria=criteria))
        verdicts[name] = found.blocks["rGT"].verdicts["no collision"]
    assert verdicts["cut_in"].outcome == "INVALID"
    assert "off its trace, whose recording ends here" in verdicts["cut_in"].reason
    assert verdicts["keeps"].outcome == "PASS"


BRAKING = """
from resim.simulation.function.interface import Command

class Brakes:
    def __init__(self, hard=4.0):
        self.hard = hard

    def reset(self, setup):
        pass

    def step(self, p):
        return Command(-self.hard if p.t > 0.5 and p.ego.v > 0.1 else 0.0, 0.0)

    def close(self):
        pass
"""
SWEEP = """
name = "braking"
criteria = "{criteria}"
build = ["brakes.toml"]
plan = "grid"
seeds = 1
engine = "direct"
traffic = "{traffic}"

[[recording]]
folder = "drive"

[[parameter]]
name = "function.hard"
values = [3.0, 4.0]
"""


@pytest.mark.slow
def test_a_sweep_judges_the_traffic_that_drove(tmp_path: Path) -> None:
    """An EGO that brakes is hit from behind on traces, and not by traffic that reacts, in every run and its KPIs."""
    size = {"kind": "car", "y": -5.25, "heading": 0.0, "v": 20.0, "length": 4.7, "width": 1.9}
    times = np.arange(0.0, 6.01, 0.04).round(2).tolist()
    rows = [
        {"t": t, "id": name, "x": at + 20.0 * t, **size}
        for t in times
        for name, at in (("ego", 230.0), ("f", 200.0))
    ]
    drive = tmp_path / "drive"
    drive.mkdir()
    pd.DataFrame(rows).to_csv(drive / "gt.csv", index=False)
    road = ROOT / "networks" / "proving_ground.xodr"
    (drive / "recording.toml").write_text(f'name = "drive"\nmap = "{road}"\nego = "ego"\n', encoding="utf-8")
    (tmp_path / "brakes.py").write_text(BRAKING, encoding="utf-8")
    build = 'name = "b"\nversion = "1"\nfactory = "brakes:Brakes"\n'
    (tmp_path / "brakes.toml").write_text(build, encoding="utf-8")
    found = {}
    for traffic in ("traces", "reactive"):
        file, out = tmp_path / f"{traffic}.toml", tmp_path / f"out_{traffic}"
        criteria = ROOT / "scenarios" / "criteria" / "highway.toml"
        file.write_text(SWEEP.format(criteria=criteria, traffic=traffic), encoding="utf-8")
        order = [sys.executable, "-m", "resim", "sweep", str(file), "--out", str(out), "--workers", "1"]
        done = subprocess.run(order, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        found[traffic] = duckdb.sql(f"select * from '{out}/runs/*.parquet'").df()
        order = [sys.executable, "-m", "resim", "sweep", "report", str(out)]
        told = subprocess.run(order, capture_output=True, text=True, check=False).stdout
        note = "note: traffic reacts: in 2 of 2 runs objects were handed over to drivers"
        assert (note in " ".join(told.split())) is (traffic == "reactive"), told
    assert found["traces"]["collision"].all()
    assert not found["reactive"]["collision"].any()
    assert (found["reactive"]["handed_over"] == 1).all()
    assert "handed_over" not in found["traces"]
    assert found["reactive"]["risk"].max() < found["traces"]["risk"].max()
