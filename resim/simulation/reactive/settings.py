"""When traffic is handed over to drivers, and what drivers are like of whom nothing is known: a TOML file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from resim.core.errors import InputError
from resim.core.spec import Strict, read_strict

REMEDY = "docs/formats/traffic.md shows one."
Positive = Annotated[float, Field(strict=True, gt=0.0, le=100.0)]
NotNegative = Annotated[float, Field(strict=True, ge=0.0, le=100.0)]


class DriverSettings(Strict):
    """A driver of a kind, by the Intelligent Driver Model (Treiber et al. 2000), where its recording does not tell.

    Attributes:
        time_gap: Time gap [s] that it keeps.
        standstill: Gap [m] that it leaves when it stands.
        acceleration: Largest acceleration [m/s²].
        deceleration: Comfortable braking [m/s²].
        reaction: Reaction time [s]; after the first one, braking harder than is comfortable comes without it.
    """

    time_gap: Positive = 1.2
    standstill: Positive = 2.0
    acceleration: Positive = 1.4
    deceleration: Positive = 2.0
    reaction: NotNegative = 0.4


class HandOverSettings(Strict):
    """When an object leaves its trace, and when it is back.

    Attributes:
        harder: By how much more [m/s²] its driver would brake at least than in the measured drive, and than on its
            trace; and by a fifth of it.
        hardest: Hardest braking [m/s²] of a driver.
        catch_up: Acceleration [m/s²] by which a driver may go faster than its trace, to catch up with it.
    """

    harder: Positive = 1.0
    hardest: Positive = 8.0
    catch_up: Positive = 0.5


class LaneChangeSettings(Strict):
    """When an object that was handed over changes lanes, by MOBIL (Kesting, Treiber, Helbing 2007), and how.

    Attributes:
        possible: Whether it changes lanes at all, but where it did when measured.
        sides: To which sides of its measured way.
        politeness: What others gain or lose by it [m/s²] counts so many times as much as what it gains itself.
        threshold: What it has to gain [m/s²].
        bias: What it has to gain more [m/s²] to leave its measured lane, and less to come back.
        safe: Braking [m/s²] beyond which neither it nor who is behind it in the other lane has to brake for it.
        duration: How long [s] a change takes (mean of passenger cars, Toledo and Zohar 2007).
        shortest: How long [s] it takes at least, where only a shorter one than usual is safe.
        every: How often [s] its driver looks.
        pause: How long [s] after a change it stays in its lane.
        lasting: How long [s] the other lane goes on at its speed after the change, at least.
    """

    possible: bool = Field(strict=True, default=True)
    sides: Literal["both", "left", "right"] = "both"
    politeness: NotNegative = 0.2
    threshold: Positive = 0.1
    bias: NotNegative = 0.3
    safe: Positive = 4.0
    duration: Positive = 4.6
    shortest: Positive = 3.0
    every: Positive = 0.5
    pause: NotNegative = 3.0
    lasting: NotNegative = 5.0


class ReactiveSettings(Strict):
    """Traffic that reacts. `car` is also for vans, `truck` for buses and trailers, `bicycle` for motorcycles.

    Attributes:
        hand_over: When objects are handed over.
        lane_change: When they change lanes, once handed over.
        calibrated: Whether drivers are fitted to what the object did in the recording.
        drivers: Who decides for them: resim's Intelligent Driver Model and MOBIL, in every engine to the same byte; or
            SUMO's own models (carFollowModel IDM, laneChangeModel LC2013), in the engine "sumo" only.
        car: Driver of a car.
        truck: Driver of a truck.
        bicycle: Driver of a bicycle.
    """

    hand_over: HandOverSettings = HandOverSettings()
    lane_change: LaneChangeSettings = LaneChangeSettings()
    calibrated: bool = Field(strict=True, default=True)
    drivers: Literal["resim", "sumo"] = "resim"
    car: DriverSettings = DriverSettings()
    truck: DriverSettings = DriverSettings(time_gap=1.6, acceleration=0.8)
    bicycle: DriverSettings = DriverSettings(time_gap=1.0, standstill=1.0, acceleration=1.0)

    def of(self, kind: str) -> DriverSettings | None:
        """Give the driver of a kind; None for who has none: pedestrians stay on their traces."""
        if kind in ("truck", "bus", "trailer"):
            return self.truck
        if kind in ("bicycle", "motorcycle"):
            return self.bicycle
        return None if kind == "pedestrian" else self.car


TrafficName = Literal["traces", "reactive"]
"""How traffic objects move: on their traces, whatever the EGO does, or so as they react to it."""


class WithTraffic(Strict):
    """A file that says how traffic moves.

    Attributes:
        traffic: On its traces, or reactive.
        reactive: How it reacts.
    """

    traffic: TrafficName = "traces"
    reactive: ReactiveSettings = ReactiveSettings()

    @model_validator(mode="after")
    def _reacts(self) -> WithTraffic:
        if self.traffic == "traces" and self.reactive != ReactiveSettings():
            raise ValueError(
                'reactive: says how traffic reacts that stays on its traces; set traffic = "reactive"'
            )
        return self

    @property
    def reacts(self) -> ReactiveSettings | None:
        """How traffic reacts; None where it stays on its traces."""
        return self.reactive if self.traffic == "reactive" else None


def traffic_of(name: str) -> ReactiveSettings | None:
    """Give what is meant by `traces`, `reactive` or the path of a TOML file. Raises InputError naming every fault."""
    if name == "traces":
        return None
    if name == "reactive":
        return ReactiveSettings()
    if not name.endswith(".toml"):
        raise InputError(
            "--traffic", f"{name!r} is no way for traffic to move", "Say traces, reactive, or a .toml file."
        )
    return read_strict(Path(name), ReactiveSettings, REMEDY)


def traffic_toml(settings: ReactiveSettings) -> str:
    """Give the TOML file of which `traffic_of` gives these settings."""
    told = settings.model_dump()
    tables = {name: part for name, part in told.items() if isinstance(part, dict)}
    lines = [f"{name} = {json.dumps(value)}" for name, value in told.items() if name not in tables]
    for name, part in tables.items():
        lines += ["", f"[{name}]", *(f"{key} = {json.dumps(value)}" for key, value in part.items())]
    return "\n".join(lines) + "\n"
