from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from resim.simulation.function.interface import EgoState
from resim.simulation.vehicles.kinematic import Kinematic
from resim.simulation.vehicles.model import Vehicle, VehicleModel, VehicleState
from resim.simulation.vehicles.single_track import SingleTrack

REFERENCE = Path(__file__).with_name("single_track_reference.csv")
IDEAL = Vehicle(
    acceleration_lag=1e-9, steering_lag=1e-9, max_jerk=1e9, max_steering_rate=1e9, max_lateral=1e9
)
MODELS: list[Callable[[], VehicleModel]] = [Kinematic, SingleTrack]


def drive(
    model: VehicleModel, state: VehicleState, a: float, curvature: float, seconds: float
) -> list[VehicleState]:
    out = [state]
    for _ in range(round(seconds / 0.04)):
        out.append(model.step(out[-1], a, curvature, 0.04))
    return out


def start(v: float = 20.0, curvature: float = 0.0, a: float = 0.0, heading: float = 0.7) -> EgoState:
    return EgoState(100.0, -50.0, heading, v, a, v * curvature)


@pytest.mark.parametrize("curvature", [0.02, -0.01])
def test_the_kinematic_model_runs_round_a_circle(curvature: float) -> None:
    model = Kinematic(Vehicle(max_lateral=20.0))
    states = drive(model, model.settle(start(15.0, curvature)), 0.0, curvature, 20.0)
    car, heading0 = model.vehicle, 0.7
    rear = np.array(
        [[s.x - car.rear * math.cos(s.heading), s.y - car.rear * math.sin(s.heading)] for s in states]
    )
    centre = rear[0] + np.array([-math.sin(heading0), math.cos(heading0)]) / curvature
    radius = np.hypot(*(rear - centre).T)
    np.testing.assert_allclose(radius, 1.0 / abs(curvature), atol=2e-3)  # chords of 0.6 m
    turned = np.array([s.heading for s in states]) - heading0
    np.testing.assert_allclose(turned, 15.0 * 0.04 * np.arange(len(states)) * curvature, atol=1e-9)
    assert all(s.v == 15.0 for s in states)


def test_the_kinematic_model_keeps_straight_on() -> None:
    model = Kinematic()
    end = drive(model, model.settle(start()), 0.0, 0.0, 5.0)[-1]
    np.testing.assert_allclose((end.x, end.y), (100.0 + 100.0 * math.cos(0.7), -50.0 + 100.0 * math.sin(0.7)))


@pytest.mark.parametrize("make", MODELS)
@pytest.mark.parametrize("curvature", [0.0, 0.004, -0.01])
def test_a_settled_vehicle_goes_on_in_its_curve(make: Callable[[], VehicleModel], curvature: float) -> None:
    model = make()
    settled = model.settle(start(20.0, curvature, a=0.0))
    assert (settled.x, settled.y, settled.heading, settled.v) == (100.0, -50.0, 0.7, 20.0)
    states = drive(model, settled, 0.0, curvature, 4.0)
    rates = np.array([s.yaw_rate for s in states])
    np.testing.assert_allclose(rates, 20.0 * curvature, atol=2e-4)
    slips = np.array([s.slip for s in states])
    np.testing.assert_allclose(slips, slips[0], atol=2e-4)


@pytest.mark.parametrize("make", MODELS)
def test_settling_keeps_the_acceleration(make: Callable[[], VehicleModel]) -> None:
    model = make()
    states = drive(model, model.settle(start(20.0, a=-3.0)), -3.0, 0.0, 1.0)
    np.testing.assert_allclose([s.a for s in states], -3.0)
    assert states[-1].v == pytest.approx(17.0, abs=1e-9)


@pytest.mark.parametrize("make", MODELS)
def test_a_vehicle_brakes_to_a_stop_and_stays(make: Callable[[], VehicleModel]) -> None:
    model = make()
    states = drive(model, model.settle(start(12.0)), -6.0, 0.0, 5.0)
    way = math.hypot(states[-1].x - 100.0, states[-1].y + 50.0)
    assert way == pytest.approx(12.0**2 / 12.0 + 12.0 * 0.15, abs=0.2)  # the lag costs 0.15 s
    assert all(s.v >= 0.0 for s in states)
    assert (states[-1].v, states[-1].a) == (0.0, 0.0)
    assert (states[-1].x, states[-1].y) == (states[-2].x, states[-2].y)
    gone = drive(model, states[-1], 1.0, 0.0, 2.0)
    assert gone[-1].v == pytest.approx(2.0 - 0.15, abs=0.03)


def test_actuators_follow_with_their_lags() -> None:
    car = Vehicle(max_jerk=1e9, max_steering_rate=1e9)
    state = VehicleState(0.0, 0.0, 0.0, 10.0)
    model = Kinematic(car)
    assert model.step(state, 2.0, 0.01, car.acceleration_lag).a == pytest.approx(2.0 * (1.0 - math.exp(-1.0)))
    steering = model.step(state, 2.0, 0.01, car.steering_lag).steering
    assert steering == pytest.approx(math.atan(car.wheelbase * 0.01) * (1.0 - math.exp(-1.0)))


@pytest.mark.parametrize(("wanted", "reached"), [(50.0, 4.0), (-50.0, -9.0)])
def test_acceleration_is_limited(wanted: float, reached: float) -> None:
    model = Kinematic()
    states = drive(model, model.settle(start(40.0)), wanted, 0.0, 3.0)
    steps = np.diff([s.a for s in states])
    assert states[-1].a == pytest.approx(reached, abs=1e-3)
    assert np.abs([s.a for s in states]).max() <= abs(reached)
    assert np.abs(steps).max() <= 40.0 * 0.04 + 1e-12


def test_steering_is_limited_in_angle_rate_and_lateral_acceleration() -> None:
    model = Kinematic()
    slow = drive(model, model.settle(start(2.0)), 0.0, 10.0, 5.0)
    assert max(s.steering for s in slow) <= model.vehicle.max_steering + 1e-12
    assert slow[-1].steering == pytest.approx(model.vehicle.max_steering, abs=1e-3)
    assert np.abs(np.diff([s.steering for s in slow])).max() <= 0.4 * 0.04 + 1e-12
    fast = drive(model, model.settle(start(30.0)), 0.0, -0.5, 3.0)
    assert fast[-1].v * fast[-1].yaw_rate == pytest.approx(-7.0, abs=1e-3)


def test_the_single_track_model_is_that_of_commonroad() -> None:
    """Over 8 s of slalom with speed changes, against stored numbers (see the head of the file)."""
    table = np.genfromtxt(REFERENCE, delimiter=",", names=True, skip_header=4)
    model, dt = SingleTrack(IDEAL), 0.01
    state, states = VehicleState(0.0, 0.0, 0.3, 25.0), []
    for k in range(801):
        if k % 40 == 0:
            states.append(state)
        t = dt * (k + 1)
        steering = 0.03 * math.sin(0.9 * t) * min(t, 1.0)
        a = 1.5 * math.sin(0.7 * t) - min(t / 2.0, 1.0)
        state = model.step(state, a, math.tan(steering) / IDEAL.wheelbase, dt)
    assert len(table) == len(states) == 21
    assert np.ptp(table["y"]) > 20.0
    for name, near in (
        ("x", 0.01),
        ("y", 0.01),
        ("heading", 1e-4),
        ("v", 1e-4),
        ("yaw_rate", 1e-4),
        ("slip", 1e-4),
    ):
        np.testing.assert_allclose([getattr(s, name) for s in states], table[name], atol=near, err_msg=name)


def test_the_step_hardly_matters_to_the_single_track_model() -> None:
    model = SingleTrack()

    def end(dt: float) -> VehicleState:
        state = model.settle(start(25.0))
        for k in range(round(4.0 / dt)):
            state = model.step(state, -1.0, 0.003 * math.sin(k * dt // 1.0), dt)
        return state

    one, two = end(0.04), end(0.005)
    assert math.hypot(one.x - two.x, one.y - two.y) < 0.1


def test_the_single_track_model_slows_through_its_switch_to_the_kinematic_one() -> None:
    model = SingleTrack()
    states = drive(model, model.settle(start(10.0, 0.02)), -2.0, 0.02, 6.0)
    way = np.hypot(np.diff([s.x for s in states]), np.diff([s.y for s in states]))
    v = np.array([s.v for s in states])
    np.testing.assert_allclose(way, 0.02 * (v[1:] + v[:-1]), atol=2e-3)
    again = drive(model, states[-1], 2.0, 0.02, 6.0)
    way = np.hypot(np.diff([s.x for s in again]), np.diff([s.y for s in again]))
    v = np.array([s.v for s in again])
    np.testing.assert_allclose(way, 0.02 * (v[1:] + v[:-1]), atol=2e-3)
    turn = np.diff([s.yaw_rate for s in again])
    assert np.abs(turn).max() < 0.05


class Weak(SingleTrack):
    """Has a `step` of its own, which counts for many vehicles, too."""

    def step(self, state: VehicleState, acceleration: float, curvature: float, dt: float) -> VehicleState:
        return super().step(state, 0.5 * acceleration, curvature, dt)


def test_many_vehicles_move_as_each_of_them_does() -> None:
    for model in (Kinematic(), SingleTrack(), Weak()):
        states = [model.settle(start(v, 0.01)) for v in (0.0, 3.0, 4.99, 5.0, 33.0)]
        commands = np.array([[2.0, 0.02], [-9.0, 0.1], [1.0, -0.02], [-3.0, 0.0], [5.0, 0.5]])
        together = np.array(states)
        for _ in range(20):
            model.advance(together, commands, 0.04)
            states = [model.step(s, *c, 0.04) for s, c in zip(states, commands.tolist(), strict=True)]
        assert together.tobytes() == np.array(states).tobytes()
