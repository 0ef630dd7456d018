"""Traffic that reacts: who is handed over, how it drives, and that nobody is where the EGO is where it was measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from resim.core.errors import InputError
from resim.recordings import read_commonroad
from resim.resimulation import ResimulationOptions, resimulate
from resim.simulation.case import SimulatedDrive
from resim.simulation.direct import Direct
from resim.simulation.function.interface import load_build
from resim.simulation.reactive.drivers import GRID, Following, TrafficDriver, fitted, followed
from resim.simulation.reactive.settings import DriverSettings, HandOverSettings, ReactiveSettings, traffic_of
from resim.simulation.sumo.engine import Sumo

Drive = Callable[..., SimulatedDrive]
Make = Callable[..., Any]
Member = Callable[..., Any]
REACTIVE = ReactiveSettings()
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
    reacts = drive(build, *behind(member), traffic=REACTIVE)
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
    found = drive(build, ego, other, traffic=REACTIVE)
    assert found.end == "duration"
    assert found.handed_over[-1].back is not None
    trace = 283.0 + 20.0 * found.truth.t
    after = found.truth.t >= found.handed_over[-1].back
    np.testing.assert_allclose(found.truth.x[1, after], trace[after], atol=1e-6)
    assert (found.truth.x[1] <= trace + 1e-6).all()


def test_the_one_behind_it_brakes_too(drive: Drive, function: Make, member: Member) -> None:
    ego, first = behind(member)
    second = member("g", 300.0 - 2 * 29.7, end=8.0)
    found = drive(function(BRAKES), ego, first, second, traffic=REACTIVE)
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
    how = ReactiveSettings(car=own, calibrated=False, hand_over=HandOverSettings(hardest=50.0, harder=0.5))
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
    assert (
        np.diff(v) / dt >= -REACTIVE.hand_over.hardest - 0.6 / dt.min() * 0.0 - 1e-6
    ).all() or found.handed_over
    np.testing.assert_allclose(np.hypot(np.diff(x), np.diff(y)), 0.5 * (v[1:] + v[:-1]) * dt, atol=0.06)
    again = drive(build, ego, other, traffic=REACTIVE)
    assert again.fingerprint() == found.fingerprint()


@pytest.mark.skipif(not NGSIM.is_dir(), reason="no recordings")
@pytest.mark.parametrize(("name", "ego"), [("USA_US101-22_1_T-1", "675"), ("USA_Lanker-1_17_T-1", "1577")])
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
        stretches.append(Following(place, speed, lead[every] - place, lead_v[every]))
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
