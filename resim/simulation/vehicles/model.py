"""What a vehicle model is: it moves the EGO on an acceleration and a curvature.

The models that ship are single-track models behind the same actuators: first-order lags, and limits of jerk,
acceleration, steering rate and lateral acceleration. Parameters are those of vehicle 2 (BMW 320i) of the CommonRoad
vehicle models (Althoff, Würsching: CommonRoad: Vehicle Models, 2020), whose equations they are, with the box centre as
the reference point.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, Protocol

if TYPE_CHECKING:
    from resim.core.geometry import Floats
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

    @cached_property
    def numbers(self) -> tuple[float, ...]:
        """All fields, as `resim.simulation.vehicles.kernel` takes them."""
        return astuple(self)


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
    """Moves vehicles. name: of the model, as `--vehicle` takes it. Made without arguments, or of another vehicle.

    A model has `step`, for one vehicle, or `advance`, for many at once; the one gives the other. Of a model that
    inherits one and has the other, what it has itself counts.
    """

    name: str
    vehicle: Vehicle

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "step" in vars(cls) and "advance" not in vars(cls):
            cls.advance = VehicleModel.advance  # type: ignore[method-assign]

    def settle(self, state: EgoState) -> VehicleState:
        """Give the model's state in which it moves on as `state` says."""

    def advance(self, states: Floats, commands: Floats, dt: float) -> None:
        """Move B vehicles by dt [s], in place: states (B, 8) as `VehicleState` has them, under constant commands
        (B, 2): acceleration [m/s²], curvature [1/m].
        """
        for state, (acceleration, curvature) in zip(states, commands.tolist(), strict=True):
            state[:] = self.step(VehicleState(*state.tolist()), acceleration, curvature, dt)

    def step(self, state: VehicleState, acceleration: float, curvature: float, dt: float) -> VehicleState:
        """Give the state of one vehicle dt [s] later under a constant command."""
        import numpy as np  # which the command line's help spares

        own = (vars(kind).get("advance") for kind in type(self).__mro__)
        advance = next(method for method in own if method not in (None, VehicleModel.advance))
        states = np.array([state])
        advance(self, states, np.array([[acceleration, curvature]]), dt)
        return VehicleState(*states[0].tolist())
