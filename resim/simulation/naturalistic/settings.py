"""What traffic is like: demand, drivers, vehicles and lane changes, as a TOML file says it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from resim.core.distribution import RandomNumber, constant
from resim.core.spec import Strict, read_strict
from resim.simulation.reactive.settings import ReactiveSettings
from resim.simulation.vehicles.kinematic import Kinematic

REMEDY = "scenarios/traffic/motorway.toml is one."
Share = Annotated[float, Field(strict=True, ge=0.0, le=1.0)]
Flow = Annotated[float, Field(strict=True, ge=0.0, le=3000.0)]


class DemandSettings(Strict):
    """How many vehicles come, and where they go.

    Attributes:
        per_lane: Vehicles an hour on each lane that comes from outside of the map.
        ramp: Vehicles an hour on each ramp that comes from outside (lanes of type onRamp, entry and the like).
        exit_share: Share of the vehicles that leave where a way leads to a ramp.
        truck_share: Share of trucks.
        warm_up: Time [s] before the recording, in which the map fills.
    """

    per_lane: Flow = 900.0
    ramp: Flow = 300.0
    exit_share: Share = 0.12
    truck_share: Share = 0.2
    warm_up: Annotated[float, Field(strict=True, ge=0.0, le=3600.0)] = 180.0


class PopulationSettings(Strict):
    """Drivers and vehicles of a kind, each drawn on its own; the driver is SUMO's IDM (Treiber et al. 2000).

    Attributes:
        length: m.
        width: m.
        speed_factor: Desired speed over the speed limit.
        top_speed: Largest speed [m/s].
        time_gap: s.
        standstill: Gap when it stands [m].
        acceleration: m/s².
        deceleration: Comfortable braking [m/s²].
        speed_gain: How eagerly it changes lane to be faster (SUMO's lcSpeedGain).
        keep_right: How eagerly it changes back to the right (SUMO's lcKeepRight).
        assertive: What gaps that SUMO asks for ahead and behind are divided by before it changes lane (lcAssertive).
        decides: Time [s] between its decisions (actionStepLength), in steps of 0.2 s.
    """

    length: RandomNumber
    width: RandomNumber
    speed_factor: RandomNumber
    top_speed: RandomNumber
    time_gap: RandomNumber
    standstill: RandomNumber = RandomNumber(mean=2.5, sd=0.5, min=1.5, max=4.0)
    acceleration: RandomNumber
    deceleration: RandomNumber
    speed_gain: RandomNumber = constant(1.0)
    keep_right: RandomNumber = constant(1.0)
    assertive: RandomNumber = constant(1.0)
    decides: RandomNumber = constant(0.2)


class NaturalisticLaneChange(Strict):
    """How vehicles change lane.

    Attributes:
        duration: s, from the first lateral motion to the last.
    """

    duration: RandomNumber = RandomNumber(kind="lognormal", mean=5.3, sd=1.2, min=3.0, max=8.0)


class TrafficEgoSettings(Strict):
    """The EGO of each recording: of its kind the vehicle that is there longest; the recording lasts as long as that.

    Attributes:
        build: Build file of an AD function that drives it, as seen from this file; none: SUMO's driver does.
        perception: Perception model (JSON) by which it sees the others, likewise; none: as they are.
        sight: How far [m] it sees; the errors of a model grow without end beyond what it was trained on.
        around: Who never comes so near to it [m] is not in the recording.
        kind: What it is.
        vehicle: Vehicle model by which it moves where a function drives it.
        reactive: How the others react to it where a function drives it.
    """

    build: str | None = None
    perception: str | None = None
    sight: Annotated[float, Field(strict=True, gt=0.0, le=1000.0)] = 150.0
    around: Annotated[float, Field(strict=True, gt=0.0, le=10_000.0)] = 400.0
    kind: Literal["car", "truck"] = "car"
    vehicle: str = Kinematic.name
    reactive: ReactiveSettings = ReactiveSettings()

    @model_validator(mode="after")
    def _decided_by_resim(self) -> TrafficEgoSettings:
        if self.reactive.drivers == "sumo":
            raise ValueError('reactive.drivers: functions drive without SUMO here; take drivers = "resim"')
        return self


class NaturalisticSettings(Strict):
    """Naturalistic traffic.

    Attributes:
        demand: Who comes.
        car: Cars.
        truck: Trucks.
        lane_change: Lane changes.
        recording: Length of one recording [s]; a longer drive is cut into several.
        ego: Who drives and what is sensed, if anything is.
    """

    demand: DemandSettings = DemandSettings()
    car: PopulationSettings
    truck: PopulationSettings
    lane_change: NaturalisticLaneChange = NaturalisticLaneChange()
    recording: Annotated[float, Field(strict=True, ge=10.0, le=900.0)] = 120.0
    ego: TrafficEgoSettings = TrafficEgoSettings()


def read_naturalistic(path: Path) -> NaturalisticSettings:
    """Read the settings. Raises InputError naming every fault."""
    return read_strict(path, NaturalisticSettings, REMEDY)
