"""The dynamic single-track model ("ST" of the CommonRoad vehicle models)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from resim.simulation.vehicles.kinematic import Kinematic
from resim.simulation.vehicles.model import BMW_320I, Vehicle, VehicleModel, VehicleState

if TYPE_CHECKING:
    from resim.core.geometry import Floats
    from resim.simulation.function.interface import EgoState


class SingleTrack(VehicleModel):
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

    def advance(self, states: Floats, commands: Floats, dt: float) -> None:
        """Integrate with the classical Runge-Kutta method over at most 10 ms at a time."""
        # compiled: numba is imported where it is used only
        from resim.simulation.vehicles import kernel

        kernel.single_track(states, commands, dt, self.vehicle.numbers, self.slow)
