"""What `resim vary` changes, by how much, and what no variation may do: a TOML file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Field

from resim.core.spec import Strict, read_strict
from resim.scenario.augmentation.settings import VehicleType, Weather
from resim.variations.swept import BOX, WIDEST

EXAMPLE = "docs/formats/variation.md has one."
Positive = Annotated[float, Field(strict=True, gt=0.0)]


class MotionLimits(Strict):
    """What no varied object does, except where the original does so as well (our choice: beyond it, tyres slide).

    Attributes:
        acceleration: m/s², along its heading.
        braking: m/s².
        lateral: m/s², speed times yaw rate.
        yaw_rate: rad/s.
        backwards: m/s, speed at which it may roll backwards.
    """

    acceleration: Positive = 5.0
    braking: Positive = 9.0
    lateral: Positive = 7.0
    yaw_rate: Positive = 1.0
    backwards: Positive = 0.1


class VariationSettings(Strict):
    """How a drive is varied.

    Attributes:
        box: Share of each component's range by which it is varied to either side.
        vehicle: Types of which one may take a varied object's place; its own size is one of them.
        weather: Weathers of which one may take the drive's place; its own is one of them.
        overlap: Whether a varied object may overlap another one.
        limits: What it may not do.
    """

    box: Annotated[float, Field(strict=True, gt=0.0, le=WIDEST)] = BOX
    vehicle: tuple[VehicleType, ...] = ()
    weather: tuple[Weather, ...] = ()
    overlap: bool = False
    limits: MotionLimits = MotionLimits()


@dataclass(frozen=True)
class WhatVaries:
    """What of a drive is varied.

    Attributes:
        objects: Ids of the objects; none for the most critical one.
        labels: Which of their maneuvers; none for all that there is a kernel of.
        accept: Codes of findings in the drive to continue despite.
    """

    objects: tuple[str, ...] = ()
    labels: tuple[str, ...] = ()
    accept: tuple[str, ...] = ()


def read_variation_settings(path: Path) -> VariationSettings:
    """Read the settings. Raises InputError naming every fault."""
    return read_strict(path, VariationSettings, EXAMPLE)
