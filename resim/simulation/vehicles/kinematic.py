"""The kinematic single-track model ("KS" of the CommonRoad vehicle models)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from resim.simulation.vehicles.model import BMW_320I, Vehicle, VehicleModel, VehicleState

if TYPE_CHECKING:
    from resim.core.geometry import Floats
    from resim.simulation.function.interface import EgoState


class Kinematic(VehicleModel):
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

    def advance(self, states: Floats, commands: Floats, dt: float) -> None:
        """Move the rear axles along arcs, with the mean speed and steering angle of the step.

        Braking ends at standstill; a vehicle that rolls backwards does not get faster by it.
        """
        # compiled: numba is imported where it is used only
        from resim.simulation.vehicles import kernel

        kernel.kinematic(states, commands, dt, self.vehicle.numbers)
