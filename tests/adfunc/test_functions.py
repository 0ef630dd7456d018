from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numba import njit

from adfunc.constant_velocity import ConstantVelocity
from adfunc.highway_pilot import HighwayPilot, quintic
from adfunc.highway_pilot_mirrored import MirroredHighwayPilot
from adfunc.idm import Idm
from adfunc.lane_keeping import Lanes, in_corridor
from resim.driving.kernel import time_to_collision
from resim.recordings.settings import SETTINGS, read_settings
from resim.road.opendrive import RoadNetwork
from resim.simulation.function.batch import batch_of_one
from resim.simulation.function.interface import (
    AdFunction,
    Command,
    EgoState,
    Perceived,
    Setup,
    load_build,
)
from resim.simulation.vehicles.kinematic import Kinematic

RIGHT, LEFT = -5.25, -1.75  # y of lanes -2 and -1 of road 1, along +x
ROOT = Path(__file__).parents[2]


class World:
    """The EGO with a kinematic model, and cars at constant speed and acceleration: name -> x, y, v, a."""

    def __init__(self, network: RoadNetwork, function: AdFunction, v: float = 25.0, *, y: float = RIGHT,
                 cars: dict[str, tuple[float, float, float, float]] | None = None) -> None:  # fmt: skip
        self.cars, self.function, self.model = cars or {}, function, Kinematic()
        self.state = self.model.settle(EgoState(300.0, y, 0.0, v))
        self.t, self.commands = 0.0, list[Command]()
        function.reset(Setup(network, self.state, (900.0, y), 4.7, 1.9, 0.04, 0))

    def perceived(self) -> Perceived:
        cars = np.array(list(self.cars.values())).reshape(-1, 4)
        c, s = math.cos(self.state.heading), math.sin(self.state.heading)
        dx, dy, n = cars[:, 0] - self.state.x, cars[:, 1] - self.state.y, len(cars)
        return Perceived(
            self.t, self.state.ego, np.array(list(self.cars), dtype=str), np.array(["car"] * n, dtype=str),
            c * dx + s * dy, c * dy - s * dx, np.full(n, -self.state.heading), cars[:, 2], np.full(n, 4.7),
            np.full(n, 1.9),
        )  # fmt: skip

    def run(self, seconds: float) -> World:
        for _ in range(round(seconds / 0.04)):
            answer = self.function.step(self.perceived())
            assert isinstance(answer, Command)
            assert math.isfinite(answer.acceleration + answer.curvature)
            self.commands.append(answer)
            self.state = self.model.step(self.state, answer.acceleration, answer.curvature, 0.04)
            self.t += 0.04
            for name, (x, y, v, a) in self.cars.items():
                moved = max(v + a * 0.04, 0.0)
                self.cars[name] = (x + 0.02 * (v + moved), y, moved, a)
        return self

    def gap(self, name: str) -> float:
        return self.cars[name][0] - self.state.x - 4.7


@pytest.mark.parametrize("make", [ConstantVelocity, Idm, HighwayPilot])
def test_on_an_empty_road_every_function_keeps_lane_and_speed(
    network: RoadNetwork, make: Callable[[], AdFunction]
) -> None:
    world = World(network, make()).run(8.0)
    assert world.state.y == pytest.approx(RIGHT, abs=0.05)
    assert abs(world.state.heading) < 1e-3
    assert 24.0 < world.state.v < 40.0


@pytest.mark.parametrize("make", [ConstantVelocity, Idm, HighwayPilot])
def test_every_function_comes_back_to_the_middle_of_its_lane(
    network: RoadNetwork, make: Callable[[], AdFunction]
) -> None:
    world = World(network, make(), y=RIGHT + 0.8).run(8.0)
    assert world.state.y == pytest.approx(RIGHT, abs=0.1)


@pytest.mark.parametrize("make", [Idm, HighwayPilot])
def test_functions_follow_a_slower_car_without_touching_it(
    network: RoadNetwork, make: Callable[[], AdFunction]
) -> None:
    world = World(network, make(), cars={"1": (380.0, RIGHT, 20.0, 0.0)}).run(30.0)
    assert world.state.v == pytest.approx(20.0, abs=0.5)
    assert 10.0 < world.gap("1") < 60.0


@pytest.mark.parametrize("make", [Idm, HighwayPilot])
def test_functions_stop_behind_a_car_that_stops(network: RoadNetwork, make: Callable[[], AdFunction]) -> None:
    world = World(
        network, make(), 15.0, cars={"1": (350.0, RIGHT, 15.0, -2.0), "2": (301.0, LEFT, 15.0, -2.0)}
    )
    smallest = min(world.run(0.2).gap("1") for _ in range(100))
    assert smallest > 0.5
    assert world.state.v < 0.5


def test_idm_is_its_equation_in_equilibrium(network: RoadNetwork) -> None:
    """(s0 + v T) / s = sqrt(1 - (v / v0)^4) where nothing accelerates (Treiber 2000)."""
    world = World(network, Idm(desired_speed=30.0), 20.0, cars={"1": (340.0, RIGHT, 20.0, 0.0)}).run(40.0)
    expected = (2.0 + 20.0 * 1.2) / math.sqrt(1.0 - (20.0 / 30.0) ** 4)
    assert world.gap("1") == pytest.approx(expected, abs=0.5)


def test_constant_velocity_is_blind(network: RoadNetwork) -> None:
    world = World(network, ConstantVelocity(), cars={"1": (330.0, RIGHT, 5.0, 0.0)}).run(3.0)
    assert world.state.v == pytest.approx(25.0, abs=0.05)
    assert world.gap("1") < 0.0


def test_the_pilot_evades_a_threat_with_room_and_comes_to_the_next_lane(network: RoadNetwork) -> None:
    world = World(network, HighwayPilot(), cars={"1": (360.0, RIGHT, 10.0, 0.0)}).run(6.0)
    assert world.state.y == pytest.approx(LEFT, abs=0.3)
    assert abs(world.state.y - RIGHT) > 3.0


def test_the_pilot_brakes_where_the_next_lane_is_taken(network: RoadNetwork) -> None:
    cars = {"1": (360.0, RIGHT, 10.0, 0.0), "2": (298.0, LEFT, 25.0, 0.0)}
    world = World(network, HighwayPilot(), cars=cars)
    smallest = min(world.run(0.2).gap("1") for _ in range(50))
    assert world.state.y == pytest.approx(RIGHT, abs=0.3)
    assert smallest > 0.0
    assert min(c.acceleration for c in world.commands) < -2.4


def test_the_pilot_brakes_where_there_is_no_time_to_swerve(network: RoadNetwork) -> None:
    world = World(network, HighwayPilot(), cars={"1": (322.0, RIGHT, 10.0, 0.0)})
    smallest = min(world.run(0.2).gap("1") for _ in range(40))
    assert world.state.y == pytest.approx(RIGHT, abs=0.3)
    assert smallest > 0.0
    assert min(c.acceleration for c in world.commands) < -5.0


def test_the_pilot_decides_at_its_threshold(network: RoadNetwork) -> None:
    """Left over after the swerve: gap - closing * swerve_time against swerve_gap."""
    closing, pilot = 12.0, HighwayPilot()
    threshold = pilot.swerve_gap + closing * pilot.swerve_time
    ends = {}
    for more in (-1.5, 1.5):
        cars = {"1": (300.0 + 4.7 + threshold + more, RIGHT, 25.0 - closing, 0.0)}
        ends[more] = World(network, HighwayPilot(), cars=cars).run(4.0).state.y
    assert ends[-1.5] == pytest.approx(RIGHT, abs=0.3)
    assert ends[1.5] == pytest.approx(LEFT, abs=0.3)


def test_the_pilots_plan_stops_without_going_backwards(network: RoadNetwork) -> None:
    world = World(network, HighwayPilot()).run(0.1)
    for v, a in np.random.default_rng(3).uniform((0.1, -8.0), (25.0, -0.1), (500, 2)).tolist():
        plan = world.function.plan(0.0, np.array([v]), np.array([a]))[0]  # type: ignore[attr-defined]
        assert (plan[:, 3] >= 0.0).all()
        assert (np.diff(plan[:, 1]) >= 0.0).all()
        assert plan[-1, 3] == pytest.approx(max(v + 3.0 * a, 0.0))


def test_the_pilots_plan_begins_where_it_is(network: RoadNetwork) -> None:
    world = World(network, HighwayPilot()).run(1.0)
    plan = world.function.step(world.perceived()).plan  # type: ignore[union-attr]
    assert plan is not None
    np.testing.assert_allclose(plan[0], [world.t, world.state.x, world.state.y, world.state.v], atol=0.01)
    assert (np.diff(plan[:, 0]) > 0.0).all()
    assert plan[-1, 0] == pytest.approx(world.t + 3.0)


def test_the_mirrored_pilot_evades_into_the_lane_that_is_taken(network: RoadNetwork) -> None:
    cars = {"1": (360.0, RIGHT, 10.0, 0.0), "2": (298.0, LEFT, 25.0, 0.0)}
    world = World(network, MirroredHighwayPilot(), cars=cars).run(6.0)
    assert world.state.y == pytest.approx(LEFT, abs=0.3)


def test_where_both_sides_are_free_the_mirrored_pilot_drives_like_the_other(network: RoadNetwork) -> None:
    cars = {"1": (360.0, RIGHT, 10.0, 0.0)}
    right, wrong = (
        World(network, make(), cars=dict(cars)).run(6.0) for make in (HighwayPilot, MirroredHighwayPilot)
    )
    assert (wrong.state.x, wrong.state.y) == (right.state.x, right.state.y)


def test_builds_of_one_function_differ_in_their_hash_and_the_recorded_one_is_that_of_the_drives() -> None:
    builds = ROOT / "adfunc" / "builds"
    hashes = {v: load_build(builds / f"highway_pilot-{v}.toml").hash for v in ("1.0", "1.1", "1.2")}
    assert len(set(hashes.values())) == 3
    drives = [ROOT / "scenarios" / "cut_in_brake", *(ROOT / "scenarios" / "neighbours").iterdir()]
    assert {read_settings(drive / SETTINGS).build_hash for drive in drives} == {hashes["1.0"]}


@njit
def in_compiled_code(gap, closing, lead_a):
    return time_to_collision(gap, closing, lead_a)


def test_time_to_collision_is_that_of_constant_motion() -> None:
    assert in_compiled_code(20.0, 5.0, 0.0) == 4.0
    assert in_compiled_code(20.0, -1.0, 0.0) == math.inf
    for closing in (-3.0, 0.0, 6.0):
        t = in_compiled_code(20.0, closing, -4.0)
        assert closing * t + 0.5 * 4.0 * t * t == pytest.approx(20.0)


def test_the_quintic_rests_at_both_ends_and_its_derivatives_are_its_own() -> None:
    t = np.linspace(-1.0, 5.0, 601)
    d, drift, bend = quintic(1.0, 4.5, t, 3.5)
    assert (d[t <= 0.0] == 1.0).all()
    assert (d[t >= 3.5] == 4.5).all()
    np.testing.assert_allclose(np.gradient(d, t)[1:-1], drift[1:-1], atol=0.01)
    np.testing.assert_allclose(np.gradient(drift, t)[2:-2], bend[2:-2], atol=0.06)


def test_a_lane_locates_objects_along_itself(network: RoadNetwork) -> None:
    ego = EgoState(300.0, RIGHT, 0.0, 25.0)
    lanes = Lanes([Setup(network, ego, (900.0, RIGHT), 4.7, 1.9, 0.04, 0)])
    assert (lanes.d[0], lanes.turn[0]) == (pytest.approx(0.0, abs=1e-6), pytest.approx(0.0, abs=1e-9))
    seen = Perceived(
        0.0, ego, np.array(["far", "left", "back"]), np.array(["car"] * 3),
        np.array([250.0, 40.0, -30.0]), np.array([0.0, 3.5, 0.0]), np.array([0.0, 0.1, 0.0]),
        np.array([20.0, 20.0, 30.0]), np.full(3, 4.0), np.full(3, 2.0),
    )  # fmt: skip
    batch = batch_of_one(seen, np.arange(3))
    found = lanes.locate(batch)
    assert found.key.tolist() == [[2, 1, -1]]
    assert np.isnan(found.s[0, 2])
    np.testing.assert_allclose((found.s[0, 1], found.d[0, 1]), (40.0, 3.5), atol=1e-6)
    np.testing.assert_allclose(
        (found.v_s[0, 1], found.v_d[0, 1]), (20.0 * math.cos(0.1), 20.0 * math.sin(0.1)), atol=1e-6
    )
    np.testing.assert_allclose((found.half_length[0, :2], found.half_width[0, :2]), [[2.0, 2.0], [1.0, 1.0]])
    assert lanes.locate(batch, behind=0.0).key.tolist() == [[1, -1, -1]]
    assert in_corridor(found.d, found, 0.95).tolist() == [[True, False, False]]
    assert in_corridor(found.d, found, 0.95, offset=2.0).tolist() == [[False, True, False]]


def test_functions_drive_the_whole_test_track(network: RoadNetwork) -> None:
    """Straight, clothoids, arc and widening of road 2, and what road 1 goes on into."""
    for road, lane in (("2", -1), ("1", -2)):
        s = network.roads[road].length - 300.0 if road == "1" else 20.0
        x, y = network.to_xy(road, lane, np.array([s]), np.array([0.0]))
        heading = float(network.lane_heading(road, lane, np.array([s]))[0])
        state = Kinematic().settle(EgoState(float(x[0]), float(y[0]), heading, 20.0))
        function = ConstantVelocity()
        function.reset(Setup(network, state, (0.0, 0.0), 4.7, 1.9, 0.04, 0))
        worst = 0.0
        none = np.array([], dtype=float)
        for k in range(round(25.0 / 0.04)):
            seen = Perceived(0.04 * k, state.ego, none.astype(str), none.astype(str), *[none] * 6)
            answer = function.step(seen)
            worst = max(worst, abs(float(function.lanes.d[0])))
            state = Kinematic().step(state, answer.acceleration, answer.curvature, 0.04)
        assert worst < 0.3, (road, worst)
