"""What a vehicle model is: it moves the EGO on an acceleration and a curvature.

The models that ship are single-track models behind the same actuators: first-order lags, and limits of jerk,
acceleration, steering rate and lateral acceleration. Parameters are those of vehicle 2 (BMW 320i) of the CommonRoad
vehicle models (Althoff, Würsching: CommonRoad: Vehicle Models, 2020), whose equations they are, with the box centre as
the reference point.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

if TYPE_CHECKING:
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


BMW_320I = Vehicle()
"""The vehicle that the models move where nobody says another."""


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
        from resim.simulation.function.interface import (
            EgoState,  # loads numpy, which the command line's help spares
        )

        return EgoState(*self[:6])


class VehicleModel(Protocol):
    """Moves a vehicle. name: of the model, as `--vehicle` takes it. Made without arguments, or of another vehicle."""

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
