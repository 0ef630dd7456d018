"""The dynamic single-track model ("ST" of the CommonRoad vehicle models)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from resim.simulation.vehicles.kinematic import Kinematic
from resim.simulation.vehicles.model import BMW_320I, Vehicle, VehicleState, actuate

if TYPE_CHECKING:
    from resim.simulation.function.interface import EgoState


class SingleTrack:
    """Dynamic single-track model with linear tyres and load transfer; kinematic below 5 m/s."""

    name = "single-track"
    slow = 5.0  # m/s

    def __init__(self, vehicle: Vehicle = BMW_320I) -> None:
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
