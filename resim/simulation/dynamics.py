"""Vehicle models: how the EGO moves on an acceleration and a curvature.

Both are single-track models behind the same actuators: first-order lags, and limits of jerk, acceleration,
steering rate and lateral acceleration. Parameters are those of vehicle 2 (BMW 320i) of the CommonRoad
vehicle models (Althoff, Würsching: CommonRoad: Vehicle Models, 2020), whose equations of the kinematic
("KS") and the dynamic single-track model ("ST") these are, with the box centre as the reference point.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from resim.core.errors import ResimError
from resim.simulation.function.interface import EgoState


@dataclass(frozen=True)
class Vehicle:
    """A vehicle's size, axles, mass and actuators."""

    front: float = 1.1562  # m, box centre (and centre of mass) to front axle
    rear: float = 1.4227  # m, box centre to rear axle
    mass: float = 1093.3  # kg
    yaw_inertia: float = 1791.6  # kg m²
    centre_height: float = 0.6137  # m, of the centre of mass
    cornering: float = 20.89  # 1/rad, tyre stiffness over vertical load, front and rear
    friction: float = 1.0489
    max_acceleration: float = 4.0  # m/s²
    max_braking: float = 9.0  # m/s²
    max_jerk: float = 40.0  # m/s³
    max_lateral: float = 7.0  # m/s²
    max_steering: float = 1.066  # rad
    max_steering_rate: float = 0.4  # rad/s
    acceleration_lag: float = 0.15  # s
    steering_lag: float = 0.08  # s

    @property
    def wheelbase(self) -> float:
        """Distance between the axles [m]."""
        return self.front + self.rear


class VehicleState(NamedTuple):
    """An EGO's state as `EgoState` has it, and what its model needs besides: steering angle, and slip angle at the
    centre [rad].
    """

    x: float
    y: float
    heading: float
    v: float
    a: float = 0.0
    yaw_rate: float = 0.0
    steering: float = 0.0
    slip: float = 0.0

    @property
    def ego(self) -> EgoState:
        """The EGO's state."""
        return EgoState(*self[:6])


class VehicleModel(Protocol):
    """Moves a vehicle. name: of the model, as `--vehicle` takes it."""

    name: str
    vehicle: Vehicle

    def settle(self, state: EgoState) -> VehicleState:
        """Give the model's state in which it moves on as `state` says."""

    def step(self, state: VehicleState, acceleration: float, curvature: float, dt: float) -> VehicleState:
        """Give the state dt [s] later under a constant command: acceleration [m/s²], curvature [1/m]."""


def actuate(
    vehicle: Vehicle, state: VehicleState, acceleration: float, curvature: float, dt: float
) -> tuple[float, float]:
    """Give acceleration [m/s²] and steering angle [rad] after dt [s] of lag and limits."""
    a = state.a + _limited(
        (_limited(acceleration, -vehicle.max_braking, vehicle.max_acceleration) - state.a)
        * (1.0 - math.exp(-dt / vehicle.acceleration_lag)),
        -vehicle.max_jerk * dt,
        vehicle.max_jerk * dt,
    )
    if state.v * state.v * abs(curvature) > vehicle.max_lateral:
        curvature = math.copysign(vehicle.max_lateral / (state.v * state.v), curvature)
    wanted = _limited(math.atan(vehicle.wheelbase * curvature), -vehicle.max_steering, vehicle.max_steering)
    most = vehicle.max_steering_rate * dt
    change = (wanted - state.steering) * (1.0 - math.exp(-dt / vehicle.steering_lag))
    return a, state.steering + _limited(change, -most, most)


def _limited(value: float, low: float, high: float) -> float:
    return low if value < low else high if value > high else value


class Kinematic:
    """Kinematic single-track model: no tyre slip; speed and heading are those of the rear axle."""

    name = "kinematic"

    def __init__(self, vehicle: Vehicle = Vehicle()) -> None:
        self.vehicle = vehicle

    def settle(self, state: EgoState) -> VehicleState:
        """Give the state with the steering angle that the yaw rate asks for, 0 below 0.5 m/s."""
        car = self.vehicle
        steering = math.atan(car.wheelbase * state.yaw_rate / state.v) if abs(state.v) > 0.5 else 0.0
        steering = min(max(steering, -car.max_steering), car.max_steering)
        yaw_rate = state.v * math.tan(steering) / car.wheelbase
        return VehicleState(state.x, state.y, state.heading, state.v, state.a, yaw_rate, steering)

    def step(self, state: VehicleState, acceleration: float, curvature: float, dt: float) -> VehicleState:
        """Move the rear axle along an arc, with the mean speed and steering angle of the step.

        Braking ends at standstill; a vehicle that rolls backwards does not get faster by it.
        """
        car = self.vehicle
        a, steering = actuate(car, state, acceleration, curvature, dt)
        v = max(min(state.v, 0.0), state.v + 0.5 * (state.a + a) * dt)  # brakes stop it, and hold it
        if v <= 0.0:
            a = max(a, 0.0)
        path, wheelbase, rear = 0.5 * (state.v + v) * dt, car.wheelbase, car.rear
        bend = math.tan(0.5 * (state.steering + steering)) / wheelbase
        heading = state.heading + path * bend
        middle = 0.5 * (state.heading + heading)
        x = state.x + path * math.cos(middle) + rear * (math.cos(heading) - math.cos(state.heading))
        y = state.y + path * math.sin(middle) + rear * (math.sin(heading) - math.sin(state.heading))
        yaw_rate = v * math.tan(steering) / wheelbase
        return VehicleState(x, y, heading, v, a, yaw_rate, steering)


class SingleTrack:
    """Dynamic single-track model with linear tyres and load transfer; kinematic below 5 m/s."""

    name = "single-track"
    slow = 5.0  # m/s

    def __init__(self, vehicle: Vehicle = Vehicle()) -> None:
        self.vehicle = vehicle
        self._kinematic = Kinematic(vehicle)

    def settle(self, state: EgoState) -> VehicleState:
        """Give the steady state of the yaw rate: slip and yaw acceleration at rest."""
        settled = self._kinematic.settle(state)
        if state.v < self.slow:
            return settled
        car, turn = self.vehicle, state.yaw_rate / state.v
        tyre = state.v * state.yaw_rate / (car.friction * car.cornering * 9.81)  # the same at both axles
        slip = car.rear * turn - tyre
        return settled._replace(steering=car.wheelbase * turn, slip=slip, yaw_rate=state.yaw_rate)

    def step(self, state: VehicleState, acceleration: float, curvature: float, dt: float) -> VehicleState:
        """Integrate with the classical Runge-Kutta method over at most 10 ms at a time."""
        if state.v < self.slow:
            return self._kinematic.step(state, acceleration, curvature, dt)
        a, steering = actuate(self.vehicle, state, acceleration, curvature, dt)
        pieces = max(1, math.ceil(dt / 0.01))
        q: tuple[float, ...] = (state.x, state.y, state.heading, state.v, state.slip, state.yaw_rate)
        for i in range(pieces):
            part = (i + 0.5) / pieces
            q = self._runge_kutta(
                q,
                state.a + part * (a - state.a),
                state.steering + part * (steering - state.steering),
                dt / pieces,
            )
        x, y, heading, v, slip, yaw_rate = q
        return VehicleState(x, y, heading, max(v, 0.0), a, yaw_rate, steering, slip)

    def _runge_kutta(self, q: tuple[float, ...], a: float, steering: float, h: float) -> tuple[float, ...]:
        k1 = self._rates(q, a, steering)
        k2 = self._rates(tuple(s + 0.5 * h * r for s, r in zip(q, k1, strict=True)), a, steering)
        k3 = self._rates(tuple(s + 0.5 * h * r for s, r in zip(q, k2, strict=True)), a, steering)
        k4 = self._rates(tuple(s + h * r for s, r in zip(q, k3, strict=True)), a, steering)
        return tuple(
            s + h / 6.0 * (r1 + 2.0 * r2 + 2.0 * r3 + r4)
            for s, r1, r2, r3, r4 in zip(q, k1, k2, k3, k4, strict=True)
        )

    def _rates(self, q: tuple[float, ...], a: float, steering: float) -> tuple[float, ...]:
        """Right-hand side of the single-track model (CommonRoad: Vehicle Models, Eq. of "ST")."""
        _, _, heading, v, slip, yaw_rate = q
        car = self.vehicle
        front = car.cornering * (9.81 * car.rear - a * car.centre_height) / car.wheelbase
        rear = car.cornering * (9.81 * car.front + a * car.centre_height) / car.wheelbase
        front_slip = steering - slip - car.front * yaw_rate / v
        rear_slip = -slip + car.rear * yaw_rate / v
        turn = (
            car.friction
            * car.mass
            / car.yaw_inertia
            * (car.front * front * front_slip - car.rear * rear * rear_slip)
        )
        slide = car.friction / v * (front * front_slip + rear * rear_slip) - yaw_rate
        course = heading + slip
        return v * math.cos(course), v * math.sin(course), yaw_rate, a, slide, turn


VEHICLES: Mapping[str, Callable[[], VehicleModel]] = {m.name: m for m in (Kinematic, SingleTrack)}
"""What `--vehicle` takes."""


def vehicle_model(name: str) -> VehicleModel:
    """Give the vehicle model of this name. Raises ResimError where there is none."""
    if name not in VEHICLES:
        raise ResimError(f"there is no vehicle model {name!r}; there are: {', '.join(VEHICLES)}")
    return VEHICLES[name]()
