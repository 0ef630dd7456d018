"""Units that a mapping may name, each with what makes SI of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import numpy as np

LengthUnit = Literal["m", "cm", "mm", "km", "ft"]
PlaceUnit = Literal["m", "cm", "mm", "km", "ft", "deg", "rad", "1e-7 deg"]
AngleUnit = Literal["rad", "deg", "mrad"]
SpeedUnit = Literal["m/s", "km/h", "mph", "kn", "ft/s", "cm/s"]
YawRateUnit = Literal["rad/s", "deg/s"]
AccelerationUnit = Literal["m/s2", "g"]
ShareUnit = Literal["1", "%"]
TimeUnit = Literal["s", "ms", "us", "ns", "frames", "iso"]

LENGTHS: Mapping[str, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "km": 1000.0, "ft": 0.3048}
DEGREES: Mapping[str, float] = {"deg": 1.0, "rad": 180.0 / np.pi, "1e-7 deg": 1e-7}
"""Of latitude and longitude, to degrees."""
SPEEDS: Mapping[str, float] = {
    "m/s": 1.0,
    "km/h": 1.0 / 3.6,
    "mph": 0.44704,
    "kn": 1852.0 / 3600.0,
    "ft/s": 0.3048,
    "cm/s": 0.01,
}
TIMES: Mapping[str, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
FACTORS: Mapping[str, float] = {
    **LENGTHS,
    **SPEEDS,
    **{"rad": 1.0, "deg": np.pi / 180.0, "mrad": 1e-3, "rad/s": 1.0, "deg/s": np.pi / 180.0},
    **{"m/s2": 1.0, "g": 9.80665, "1": 1.0, "%": 0.01},
}
"""What a number is multiplied by, by its unit: m, m/s, rad, rad/s, m/s², 1. Latitudes have DEGREES, times TIMES."""
