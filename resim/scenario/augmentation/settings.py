"""What an augmentation changes, and by how much: a TOML file of distributions."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from resim.core.distribution import RandomNumber
from resim.core.spec import Strict, read_strict
from resim.core.tracks import ObjectKind

REMEDY = "scenarios/augment/kaefer.toml is one."
Positive = Annotated[float, Field(strict=True, gt=0.0)]
NotNegative = Annotated[float, Field(strict=True, ge=0.0)]
Share = Annotated[float, Field(strict=True, ge=0.0, le=1.0)]


Spacing = Annotated[float, Field(strict=True, ge=0.05, le=1000.0)]
Smoothing = Annotated[float, Field(strict=True, gt=0.0, le=1000.0)]
Weight = Annotated[float, Field(strict=True, gt=0.0, le=1e6)]


class PathNoise(Strict):
    """How paths vary (Kaefer 2022, 4.5.3.1, steps 1 to 3).

    Attributes:
        offset: Of a whole path, to its left [m].
        noise: Of each way point, to its left [m], before it is smoothed.
        spacing: Way [m] between way points.
        smoothing: Standard deviation [m of the way] of the Gaussian that smooths the noise.
    """

    offset: RandomNumber = RandomNumber(mean=0.0, sd=0.2, min=-0.5, max=0.5)
    noise: RandomNumber = RandomNumber(mean=0.0, sd=0.2)
    spacing: Spacing = 5.0
    smoothing: Smoothing = 15.0


class SpeedNoise(Strict):
    """How speeds vary (step 4).

    Attributes:
        noise: Of each of its moments [m/s], before it is smoothed; less below 2 m/s, so that who stands stays.
        spacing: Time [s] between those moments.
        smoothing: Standard deviation [s] of the Gaussian that smooths the noise.
    """

    noise: RandomNumber = RandomNumber(mean=0.0, sd=1.0)
    spacing: Spacing = 0.4
    smoothing: Smoothing = 1.5


class VehicleType(Strict):
    """A type of vehicle that may take an object's place.

    Attributes:
        name: What it is called.
        kind: Kind of object.
        length: m.
        width: m.
        top_speed: m/s; it is not drawn for who drives faster.
        acceleration: m/s²; it is not drawn for who accelerates harder.
        weight: How often it is drawn, beside the others.
    """

    name: Annotated[str, Field(min_length=1)]
    kind: ObjectKind
    length: Positive
    width: Positive
    top_speed: Positive
    acceleration: Positive
    weight: Weight = 1.0


class Weather(Strict):
    """Weather in OpenSCENARIO's terms.

    Attributes:
        cloud_state: CloudState of OpenSCENARIO.
        precipitation: PrecipitationType of OpenSCENARIO.
        intensity: Of the precipitation [mm/h].
        visual_range: Of the fog [m].
        weight: How often it is drawn, beside the others.
    """

    cloud_state: Literal["free", "cloudy", "overcast", "rainy", "skyOff"] = "free"
    precipitation: Literal["dry", "rain", "snow"] = "dry"
    intensity: NotNegative = 0.0
    visual_range: Positive = 100_000.0
    weight: Weight = 1.0

    @model_validator(mode="after")
    def _agrees(self) -> Weather:
        if (self.precipitation == "dry") != (self.intensity == 0.0):
            raise ValueError("intensity: expected 0 where it is dry, and more where it is not")
        return self


class AugmentationSettings(Strict):
    """An augmentation.

    Attributes:
        path: How paths vary; none where it is left out.
        speed: How speeds vary; none where it is left out.
        ego: Whether the EGO's path and speed vary too.
        change_type: Share of the vehicles that may get another type.
        type: Types of vehicles.
        colors: Whether colours are drawn, each of red, green and blue from 0 to 255.
        day: First and last moment between which the time of day is drawn; none where it is left out.
        weather: Weathers of which one is drawn; none where it is left out.
    """

    path: PathNoise | None = None
    speed: SpeedNoise | None = None
    ego: bool = True
    change_type: Share = 0.0
    type: tuple[VehicleType, ...] = ()
    colors: bool = False
    day: tuple[datetime, datetime] | None = None
    weather: tuple[Weather, ...] = ()

    @model_validator(mode="after")
    def _in_order(self) -> AugmentationSettings:
        if self.day is not None and self.day[0] > self.day[1]:
            raise ValueError("day: expected the earlier moment first")
        if self.change_type > 0.0 and not self.type:
            raise ValueError("type: expected types of vehicles, as change_type is above 0")
        return self


def read_augmentation(path: Path) -> AugmentationSettings:
    """Read the settings. Raises InputError naming every fault."""
    return read_strict(path, AugmentationSettings, REMEDY)
