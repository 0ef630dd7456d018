from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from resim.core.errors import ResimError
from resim.core.geometry import wrap_angle
from resim.road.opendrive import RoadNetwork
from resim.road.sumo import SumoNet
from resim.scenario.scenario import Scenario, ScenarioObject
from resim.simulation.between import pose_between, shares
from resim.simulation.case import Case, SimulatedDrive
from resim.simulation.function.interface import Build, Perceived
from resim.simulation.perception import (
    IdealPerception,
    OneRun,
    Perception,
    PerceptionBatch,
    World,
    worlds_of,
)
from resim.simulation.sumo.engine import Sumo
from resim.simulation.vehicles.kinematic import Kinematic
from resim.simulation.vehicles.single_track import SingleTrack

ROOT = Path(__file__).parents[2]
Drive = Callable[..., SimulatedDrive]
Make = Callable[..., Build]
Member = Callable[..., ScenarioObject]
Builds = Callable[[str], Build]
Described = Callable[..., Scenario]


def bytes_of(run: SimulatedDrive) -> tuple[bytes, ...]:
    truth = run.truth
    columns = (truth.t, truth.x, truth.y, truth.heading, truth.v, truth.a, truth.yaw_rate, run.commands)
    plans = [plan for _, plan in run.plans]
    return tuple(np.ascontiguousarray(c).tobytes() for c in (*columns, *plans))


def test_objects_are_where_their_traces_put_them(
    drive: Drive, function: Make, member: Member, network: RoadNetwork
) -> None:
    objects = [
        member("changes lane", 320.0, 22.0, [0.0, 0.08, 0.0]),
        member("stands", 400.0, 0.0, lane=-3),
        member("stops", 380.0, [15.0, 8.0, 2.0, 0.0], lane=-1, t=0.7),
        member("reverses", 450.0, [-1.0, -2.0, -2.5], lane=-3),
        member("turns", 500.0, [5.0, 5.0, 5.0], [0.0, 1.4, 3.0], lane=-3),
        member("off the road", 420.0, 10.0, 0.5, lane=-3, t=-40.0),
        member("comes and goes", 340.0, 20.0, lane=-1, start=1.0, end=2.5),
        member("comes between steps", 300.0, 20.0, lane=-3, start=1.013, end=2.007),
        member("overlaps another", 400.5, 0.5, 0.3, lane=-3),
        member("ego", 250.0, 18.0, lane=-1),
        member("a b;ü/<x>", 230.0, 30.0, lane=-3, length=18.0, width=2.5),
        member("against the lane", 600.0, 12.0, math.pi, lane=-3),
    ]
    ego = member("the ego", 300.0, 20.0)
    run = drive(function(), ego, *objects)
    assert run.control_error <= 1e-6
    assert (run.end, run.failure) == ("duration", "")
    assert run.truth.ids.tolist() == ["the ego", *(o.id for o in objects)]
    np.testing.assert_allclose(run.truth.t, 0.04 * np.arange(101), atol=1e-12)
    wanted = Scenario("m", 4.0, ego, tuple(objects)).tracks(network, run.truth.t)
    np.testing.assert_array_equal(run.truth.valid[1:], wanted.valid[1:])
    there = wanted.valid[1:]
    for name in ("x", "y", "v", "heading"):
        off = getattr(run.truth, name)[1:] - getattr(wanted, name)[1:]
        off = wrap_angle(off) if name == "heading" else off
        assert np.abs(off[there]).max() <= 1e-6, name
    assert run.truth.valid[7].sum() == 38
    assert np.isnan(run.truth.x[7, 0])
    assert (run.truth.length[11], run.truth.width[11]) == (18.0, 2.5)


@pytest.mark.parametrize("name", ["cut_in_brake", "rear_end", "overtake"])
@pytest.mark.parametrize("basis", ["GT", "SD"])
def test_replay_gives_the_scenario_back(
    described: Described, network: RoadNetwork, net: SumoNet, build: Builds, name: str, basis: str
) -> None:
    scenario = described(name, basis)
    run = Case(scenario, network, build("replay"), Sumo(), stop_at_collision=False).drive()
    wanted = scenario.tracks(network, run.truth.t)
    assert run.end == "duration"
    assert run.control_error <= 1e-6
    assert run.truth.t[-1] > scenario.duration - 0.04
    for column in ("x", "y", "v", "a", "yaw_rate"):
        assert np.nanmax(np.abs(getattr(run.truth, column) - getattr(wanted, column))) < 1e-6, column
    assert np.nanmax(np.abs(wrap_angle(run.truth.heading - wanted.heading))) < 1e-6
    assert np.isnan(run.commands).all()


@pytest.mark.parametrize("model", [None, SingleTrack()])
def test_follow_trace_shows_what_the_vehicle_model_costs(
    described: Described, network: RoadNetwork, net: SumoNet, build: Builds, model: SingleTrack | None
) -> None:
    scenario = described("cut_in_brake")
    run = Case(scenario, network, build("follow_trace"), Sumo(), vehicle=model or Kinematic()).drive()
    wanted = scenario.tracks(network, run.truth.t)
    off = np.hypot(run.truth.x - wanted.x, run.truth.y - wanted.y)[0]
    assert 0.0 < off.mean() < 0.05
    assert off.max() < 0.2


@pytest.mark.parametrize("name", ["idm", "highway_pilot", "constant_velocity"])
@pytest.mark.parametrize("model", [None, SingleTrack()])
def test_the_ego_starts_where_it_was_measured(
    described: Described,
    network: RoadNetwork,
    net: SumoNet,
    build: Builds,
    name: str,
    model: SingleTrack | None,
) -> None:
    scenario = described("cut_in_brake")
    run = Case(scenario, network, build(name), Sumo(), vehicle=model or Kinematic()).drive()
    start = scenario.tracks(network, [scenario.ego.spawn_time])
    assert math.hypot(run.truth.x[0, 0] - start.x[0, 0], run.truth.y[0, 0] - start.y[0, 0]) < 1e-3
    assert abs(run.truth.v[0, 0] - start.v[0, 0]) < 1e-3
    assert abs(run.truth.heading[0, 0] - start.heading[0, 0]) < 1e-3
    assert abs(run.truth.a[0, 1] - start.a[0, 0]) < 0.5  # the model has settled: it goes on from there


def test_the_lead_in_joins_the_start_without_a_jump(drive: Drive, function: Make, member: Member) -> None:
    body = "e = perceived.ego\nself.calls.append((perceived.t, e.x, e.y, e.v, e.heading, *perceived.x_ego))\n"
    body += "import json, pathlib\npathlib.Path(self.out).write_text(json.dumps(self.calls))\nreturn Command(0.0, 0.0)"
    out = ROOT / "none"
    function_ = function(body, parameters='out = "OUT"')
    out = function_.path.with_name("calls.json")
    function_.path.write_text(function_.path.read_text().replace("OUT", str(out)))
    from resim.simulation.function.interface import load_build

    ego = member("e", 300.0, [20.0, 18.0, 17.0], [0.05, 0.02, 0.0])
    run = drive(load_build(function_.path), ego, member("1", 340.0, [30.0, 20.0, 10.0], [-0.08, 0.0, 0.05]))
    calls = np.array(json.loads(out.read_text()))
    t, x, y, v, heading, ahead = calls.T
    np.testing.assert_allclose(t, 0.04 * np.arange(-75, 101), atol=1e-9)
    zero = int(np.argmin(np.abs(t)))
    np.testing.assert_allclose((x[zero], y[zero]), (run.truth.x[0, 0], run.truth.y[0, 0]), atol=1e-9)
    way = np.hypot(np.diff(x), np.diff(y))
    assert (way <= 1.5 * 0.04 * np.maximum(v[1:], v[:-1])).all()
    assert (way >= 0.5 * 0.04 * np.minimum(v[1:], v[:-1])).all()
    assert np.abs(np.diff(v)).max() < 9.0 * 0.04
    assert np.abs(np.diff(heading)).max() < 0.01
    assert np.abs(np.diff(ahead)).max() < 1.5 * 0.04 * 40.0


def test_the_lead_in_follows_the_lane_of_a_lane_changer(
    described: Described, network: RoadNetwork, member: Member
) -> None:
    from resim.simulation.guide import guide

    ego = member("e", 300.0, 20.0, 0.05)
    plan = guide(Scenario("m", 4.0, ego, ()), network, step=0.04, lead_in=3.0)
    assert plan.begin == 75
    assert plan.heading[0, 0] == pytest.approx(0.0, abs=1e-9)
    assert plan.heading[0, 75] == pytest.approx(0.05)
    assert (np.diff(plan.heading[0, :76]) >= -1e-12).all()


ORACLE = "needs_truth = True"


def test_the_function_sees_objects_in_its_own_frame(drive: Drive, function: Make, member: Member) -> None:
    run = drive(
        function("return Placement(EgoState(50.0 + perceived.t, 60.0, math.pi / 2, 3.0))", members=ORACLE),
        member("e", 50.0, 3.0, end=0.4), member("1", 100.0, 10.0, end=0.4), stop_at_collision=False,
    )  # fmt: skip
    seen = run.perceived[1]
    assert seen.t == pytest.approx(0.04)
    assert (seen.ego.x, seen.ego.y, seen.ego.heading) == (50.0, 60.0, math.pi / 2)
    # the object is at (100.4, -5.25): 50.4 m to the east and 65.25 m to the south of an EGO that looks north
    np.testing.assert_allclose((seen.x_ego[0], seen.y_ego[0]), (-65.25, -50.4), atol=1e-6)
    assert seen.heading_ego[0] == pytest.approx(-math.pi / 2)
    assert seen.v[0] == pytest.approx(10.0)
    assert (seen.ids.tolist(), seen.kind.tolist()) == (["1"], ["car"])
    assert (seen.length[0], seen.width[0]) == (4.7, 1.9)
    x, y = seen.map_positions()
    np.testing.assert_allclose((x[0], y[0]), (100.4, -5.25), atol=1e-6)


def test_perceived_headings_are_wrapped(drive: Drive, function: Make, member: Member) -> None:
    run = drive(function(), member("e", 300.0, 20.0, 0.1, end=0.4), member("1", 400.0, 10.0, -3.1, end=0.4))
    assert run.perceived[0].heading_ego[0] == pytest.approx(2.0 * math.pi - 3.2)


def test_nothing_is_seen_on_an_empty_road(drive: Drive, build: Builds, member: Member) -> None:
    for name in ("idm", "highway_pilot"):
        run = drive(build(name), member("e", 300.0, 20.0))
        assert run.end == "duration"
        assert run.perceived[0].x_ego.shape == (0,)


def test_perceived_lists_and_commands_belong_to_the_scenario(
    drive: Drive, build: Builds, member: Member
) -> None:
    run = drive(build("highway_pilot"), member("e", 300.0, 20.0), member("1", 340.0, 15.0))
    assert [p.t for p in run.perceived] == run.truth.t.tolist()
    assert run.commands.shape == (101, 2)
    assert np.isfinite(run.commands[:-1]).all()
    assert len(run.plans) == 101
    assert run.plans[0][0] == pytest.approx(0.0)
    assert run.plans[0][1].shape[1] == 4
    assert run.commands[:-1, 0].min() < -0.5


@pytest.mark.parametrize("lead_in", [3.0, 0.52])
def test_a_function_with_a_cycle_of_its_own_is_held_in_between(
    drive: Drive, function: Make, member: Member, lead_in: float
) -> None:
    own = function("return Command(perceived.t, 0.0)", top="cycle_time = 0.2")
    run = drive(own, member("e", 300.0, 20.0), lead_in=lead_in)
    np.testing.assert_allclose([p.t for p in run.perceived], 0.2 * np.arange(21), atol=1e-9)
    np.testing.assert_allclose(run.commands[:10, 0], [0.0] * 5 + [0.2] * 5, atol=1e-9)


@pytest.mark.parametrize("cycle", ["0.03", "0.1", "0.0401", "0.001"])
def test_a_cycle_that_is_no_multiple_of_the_step_is_refused(
    drive: Drive, function: Make, member: Member, cycle: str
) -> None:
    with pytest.raises(
        ResimError, match=rf"build\.toml: cycle_time {cycle} s is not a multiple of the step, 0.04"
    ):
        drive(function(top=f"cycle_time = {cycle}"), member("e", 300.0))


@pytest.mark.parametrize("step", [1.0 / 30.0, 0.0005, 0.0, -0.04])
def test_a_step_of_no_whole_milliseconds_is_refused(
    drive: Drive, function: Make, member: Member, step: float
) -> None:
    with pytest.raises(ResimError, match="whole milliseconds"):
        drive(function(), member("e", 300.0), step=step)


@pytest.mark.parametrize("step", [0.01, 0.1, 0.035])
def test_other_steps_end_with_the_scenario_too(
    drive: Drive, function: Make, member: Member, step: float
) -> None:
    run = drive(function(), member("e", 300.0, 20.0), step=step)
    assert run.end == "duration"
    assert 4.0 - step < run.truth.t[-1] <= 4.0 + 1e-9
    assert run.truth.x[0, -1] == pytest.approx(300.0 + 20.0 * run.truth.t[-1], abs=0.01)


@pytest.mark.parametrize("lead_in", [0.0, 0.04, 7.0])
def test_the_lead_in_may_have_any_length(drive: Drive, build: Builds, member: Member, lead_in: float) -> None:
    run = drive(build("highway_pilot"), member("e", 300.0, 20.0), member("1", 350.0), lead_in=lead_in)
    assert run.end == "duration"
    assert run.truth.t[0] == 0.0
    assert run.truth.x[0, 0] == pytest.approx(300.0, abs=1e-6)


def test_scenarios_need_not_start_at_zero(drive: Drive, build: Builds, member: Member) -> None:
    run = drive(
        build("replay"),
        member("e", 300.0, 20.0, start=100.0, end=104.0),
        member("1", 350.0, start=101.0, end=103.0),
    )
    assert run.truth.t[0] == 100.0
    assert run.truth.t[-1] == pytest.approx(104.0)
    np.testing.assert_allclose(run.truth.x[0], 300.0 + 20.0 * (run.truth.t - 100.0), atol=1e-6)
    assert run.truth.valid[1].sum() == 51


def test_a_collision_is_recorded_and_ends_the_run(drive: Drive, build: Builds, member: Member) -> None:
    ego, slow = member("e", 300.0, 20.0), member("slow", 334.7, 10.0)
    run = drive(build("constant_velocity"), ego, slow, member("aside", 330.0, 20.0, lane=-1))
    assert run.end == "collision"
    (hit,) = run.collisions
    assert hit.id == "slow"
    assert hit.t == pytest.approx(3.0, abs=0.081)  # 30 m between the bumpers at 10 m/s
    assert run.truth.t[-1] == hit.t
    assert len(run.commands) == len(run.truth.t) == len(run.perceived)
    gap = run.truth.x[1] - run.truth.x[0] - 4.7
    assert (gap[:-1] > 0.0).all()
    assert gap[-1] <= 0.0


def test_a_collision_need_not_end_the_run(drive: Drive, build: Builds, member: Member) -> None:
    ego, slow = member("e", 300.0, 20.0), member("slow", 334.7, 10.0)
    others = member("slower", 330.0, 4.0), member("aside", 330.0, 20.0, lane=-1)
    run = drive(build("constant_velocity"), ego, slow, *others, stop_at_collision=False)
    assert run.end == "duration"
    assert [c.id for c in run.collisions] == ["slower", "slow"]
    assert run.truth.t[-1] == pytest.approx(4.0)


def test_a_collision_long_after_another_is_found_once_each(
    drive: Drive, build: Builds, member: Member
) -> None:
    ego = member("e", 300.0, 20.0, end=12.0)
    objects = [member(f"{k}", 300.0 + 30.0 * k, 0.0, end=12.0) for k in range(1, 8)]
    run = drive(build("constant_velocity"), ego, *objects, stop_at_collision=False)
    assert [c.id for c in run.collisions] == [f"{k}" for k in range(1, 8)]
    np.testing.assert_allclose(
        [c.t for c in run.collisions], (30.0 * np.arange(1, 8) - 4.7) / 20.0, atol=0.08
    )


def test_overlaps_of_others_and_before_the_start_are_no_collision(
    drive: Drive, build: Builds, member: Member
) -> None:
    fast = member("fast", 310.0, 40.0)  # its lead-in drives through the EGO's
    run = drive(
        build("constant_velocity"), member("e", 300.0, 20.0), fast, member("1", 400.0), member("2", 401.0)
    )
    assert (run.end, run.collisions) == ("duration", ())


def test_leaving_the_road_ends_the_run(drive: Drive, function: Make, member: Member) -> None:
    run = drive(function("return Command(0.0, -0.02)"), member("e", 300.0, 20.0, lane=-3, end=8.0))
    assert run.end == "off_road"
    assert 0.5 < run.truth.t[-1] < 4.0
    # the way out: over the shoulder (lane -3, 2.5 m) or the strip of 2 m about the record (y = -8.25)
    assert run.truth.y[0, -1] < -10.25
    assert (run.truth.y[0, :-1] >= -10.25 - 0.1).all()


def test_the_same_input_gives_the_same_bytes_also_after_another_run(
    described: Described, network: RoadNetwork, net: SumoNet, build: Builds
) -> None:
    scenario = described("cut_in_brake")
    one = Case(scenario, network, build("highway_pilot"), Sumo(), seed=4).drive()
    Case(described("overtake"), network, build("idm"), Sumo()).drive()
    Case(scenario, network, build("highway_pilot"), Sumo(), step=0.02).drive()
    two = Case(scenario, network, build("highway_pilot"), Sumo(), seed=4).drive()
    assert bytes_of(one) == bytes_of(two)


def test_the_same_input_gives_the_same_bytes_in_a_process_of_its_own(
    described: Described, network: RoadNetwork, net: SumoNet, build: Builds
) -> None:
    program = f"""
import hashlib
from pathlib import Path
from resim.recordings import read_recording
from resim.road.opendrive import load
from resim.scenario.scenario import describe
from resim.simulation.function.interface import load_build
from resim.simulation.case import Case
from resim.simulation.sumo.engine import Sumo
import numpy as np
root = Path({str(ROOT)!r})
recording, network = read_recording(root / "scenarios/cut_in_brake"), load(root / "networks/proving_ground.xodr")
scenario = describe(recording.gt, network, ego="ego", map_name="proving_ground.xodr")
run = Case(scenario, network, load_build(root / "adfunc/builds/highway_pilot-1.0.toml"), Sumo()).drive()
t = run.truth
columns = (t.t, t.x, t.y, t.heading, t.v, t.a, t.yaw_rate, run.commands, *(p for _, p in run.plans))
print(hashlib.sha256(b"".join(np.ascontiguousarray(c).tobytes() for c in columns)).hexdigest())
"""
    import hashlib

    run = Case(described("cut_in_brake"), network, build("highway_pilot"), Sumo()).drive()
    fresh = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert fresh.stdout.split() == [hashlib.sha256(b"".join(bytes_of(run))).hexdigest()]


def test_threads_drive_one_after_the_other(
    described: Described, network: RoadNetwork, net: SumoNet, build: Builds
) -> None:
    cases = [Case(described(name), network, build("idm"), Sumo()) for name in ("cut_in_brake", "overtake")]
    alone = [bytes_of(case.drive()) for case in cases]
    with ThreadPoolExecutor(3) as pool:
        drives = list(pool.map(lambda case: bytes_of(case.drive()), 4 * cases))
    assert drives == 4 * alone


def test_a_function_that_drives_another_case_has_failed(drive: Drive, function: Make, member: Member) -> None:
    body = "from resim.simulation.sumo.session import held_session\n"
    body += "with held_session(None, 0.04): pass"
    run = drive(function(body), member("e", 300.0, 20.0))
    assert "a drive is being simulated in this thread" in run.failure


def test_runs_do_not_share_their_function(drive: Drive, function: Make, member: Member) -> None:
    body = "self.calls.append(1)\nreturn Command(0.01 * len(self.calls), 0.0)"
    own, ego = function(body), member("e", 300.0, 20.0)
    assert bytes_of(drive(own, ego)) == bytes_of(drive(own, ego))


def test_setup_says_what_the_function_may_know(
    drive: Drive, function: Make, member: Member, network: RoadNetwork
) -> None:
    check = (
        "assert setup.recorded is None\nassert setup.start.v == 20.0\nassert setup.seed == 7\n"
        "assert abs(setup.start.x - 300.0) < 1e-6\nassert abs(setup.cycle - 0.08) < 1e-12\n"
        "assert abs(setup.goal[0] - 380.0) < 1e-6\nassert (setup.length, setup.width) == (4.7, 1.9)\n"
        "assert setup.road.has_lane('1', -2, 300.0)"
    )
    run = drive(function(reset=check, top="cycle_time = 0.08"), member("e", 300.0, 20.0), seed=7)
    assert (run.failure, run.case.seed) == ("", 7)


def test_the_record_is_for_oracles_only(drive: Drive, function: Make, member: Member) -> None:
    check = "self.recorded = setup.recorded\nassert abs(self.recorded(1.0).x - 320.0) < 1e-6"
    run = drive(function(reset=check, members="needs_truth = True"), member("e", 300.0, 20.0))
    assert run.failure == ""


def test_the_settled_model_moves_on_as_the_trace_does(drive: Drive, function: Make, member: Member) -> None:
    body = "return Command(-2.0, 0.0)"
    run = drive(function(body), member("e", 300.0, [20.0, 17.8, 16.0, 14.4]))
    assert run.truth.v[0, 0] == pytest.approx(20.0, abs=1e-6)
    assert np.abs(np.diff(run.truth.v[0])).max() < 0.04 * 2.1


def test_an_object_of_one_sample_after_windowing_is_no_trouble(
    drive: Drive, function: Make, member: Member
) -> None:
    short = member("short", 340.0, 20.0, start=1.01, end=1.03)  # between two steps: never there
    run = drive(function(), member("e", 300.0, 20.0), short)
    assert not run.truth.valid[1].any()
    assert run.end == "duration"


def test_a_seed_reaches_the_perception(drive: Drive, function: Make, member: Member) -> None:
    class Noisy:
        hash = "own"

        def together(
            self, others: Sequence[Perception], rngs: Sequence[np.random.Generator]
        ) -> PerceptionBatch:
            (rng,), ideal = rngs, IdealPerception().together((), rngs)
            assert ideal is not None

            def look(world: World) -> Perceived:
                seen = ideal.perceive(worlds_of(world)).of(0)
                return replace(seen, x_ego=seen.x_ego + rng.normal(size=len(seen.x_ego)))

            return OneRun(look)

    own = function("return Command(0.1 * (float(perceived.x_ego[0]) - 30.0), 0.0)")
    members = member("e", 300.0, 20.0), member("1", 330.0, 20.0)
    one, two, three = (drive(own, *members, seed=s, perception=Noisy()) for s in (1, 1, 2))
    assert bytes_of(one) == bytes_of(two) != bytes_of(three)


def test_an_object_of_two_noisy_samples_may_be_as_fast_as_it_likes(
    drive: Drive, function: Make, member: Member
) -> None:
    ghost = member("ghost", 320.0, 130.0, lane=-1, start=1.0, end=1.08)
    run = drive(function(), member("e", 300.0, 20.0), ghost)
    assert run.control_error <= 1e-6


def test_replay_of_a_published_file_goes_as_far_as_its_trace(
    network: RoadNetwork, net: SumoNet, build: Builds, member: Member
) -> None:
    """Version 0.9 gives the trace's last time as the duration, and its traces start a little after zero."""
    scenario = Scenario("m", 4.0, member("e", 300.0, 20.0, start=0.5, end=4.0), ())
    assert Case(scenario, network, build("replay"), Sumo()).drive().end == "duration"


@pytest.mark.parametrize("step", [0.04, 0.5, 1.0])
def test_a_contact_between_two_steps_is_a_collision(
    drive: Drive, build: Builds, member: Member, step: float
) -> None:
    """At 55 m/s against each other, boxes of 4.7 m touch for 0.17 s: from 1.65 s to 1.82 s."""
    ego, other = member("e", 50.0, 25.0), member("1", 145.5, -30.0)
    run = drive(build("constant_velocity"), ego, other, step=step, lead_in=0.0)
    (hit,) = run.collisions
    assert (run.end, hit.id) == ("collision", "1")
    assert hit.t == pytest.approx(math.ceil(1.65 / step) * step, abs=step + 1e-9 if step < 0.1 else 1e-9)


def test_between_two_states_is_the_arc_that_is_driven_with_one_acceleration() -> None:
    v, a, bend, t = 10.0, -3.0, 0.05, np.array([0.0, 0.25, 1.0])
    s = v * t + 0.5 * a * t * t
    x, y, heading = np.sin(bend * s) / bend, (1.0 - np.cos(bend * s)) / bend, bend * s
    states = np.stack([x, y, heading, v + a * t])
    found = np.array(pose_between(states[:, 0], states[:, 2], 0.25))
    assert found == pytest.approx(states[:3, 1], abs=1e-12)
    assert shares(0.1) == shares(0.04) == []
    assert shares(0.3) == pytest.approx([1 / 3, 2 / 3])
