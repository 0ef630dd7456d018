"""The kinematic single-track model ("KS" of the CommonRoad vehicle models)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from resim.simulation.vehicles.model import BMW_320I, Vehicle, VehicleState, actuate

if TYPE_CHECKING:
    from resim.simulation.function.interface import EgoState


class Kinematic:
    """Kinematic single-track model: no tyre slip; speed and heading are those of the rear axle."""

    name = "kinematic"

    def __init__(self, vehicle: Vehicle = BMW_320I) -> None:
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
