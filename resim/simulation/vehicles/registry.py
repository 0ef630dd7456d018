"""Every vehicle model: a line each, in the order of the help."""

# ruff: noqa: F401, I001  # the order is that of the help, and all are used

from __future__ import annotations

from collections.abc import Callable, Mapping
from inspect import isclass
from typing import Any

from resim.core.errors import ResimError
from resim.core.spelling import unknown
from resim.simulation.vehicles.model import VehicleModel
from resim.simulation.vehicles.kinematic import Kinematic
from resim.simulation.vehicles.single_track import SingleTrack

_CLASSES: list[Any] = [value for value in vars().values() if isclass(value)]
VEHICLES: Mapping[str, Callable[[], VehicleModel]] = {of.name: of for of in _CLASSES if hasattr(of, "name")}
"""All that are imported above: what `--vehicle` takes."""


def vehicle_model(name: str) -> VehicleModel:
    """Give the vehicle model of this name. Raises ResimError where there is none."""
    if name not in VEHICLES:
        raise ResimError(unknown("vehicle model", name, VEHICLES))
    return VEHICLES[name]()
