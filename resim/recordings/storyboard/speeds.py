"""Speed over time as SpeedActions say it, and the way that it makes, both exact.

Source: ASAM OpenSCENARIO XML 1.3, "SpeedAction", "DynamicsShape". With x = (t - t0) / T in 0..1 and the change dv:
linear v0 + dv x; cubic v0 + dv (3 x² - 2 x³); sinusoidal v0 + dv (1 - cos(pi x)) / 2. A rate is the largest one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from resim.core.geometry import Floats
from resim.recordings.storyboard.document import ScenarioElement

STEEPEST: Mapping[str, float] = {"linear": 1.0, "cubic": 1.5, "sinusoidal": 0.5 * math.pi}
"""The largest slope of each shape, in changes of speed over its time."""
MOST = 300.0
"""Largest speed [m/s]."""


@dataclass(frozen=True)
class SpeedChange:
    """What a SpeedAction does.

    Attributes:
        target: m/s.
        shape: "step", or of STEEPEST.
        dimension: "time" or "rate".
        value: s or m/s².
    """

    target: float
    shape: str
    dimension: str
    value: float


@dataclass(frozen=True)
class _Ramp:
    begin: float
    v0: float
    v1: float
    lasts: float
    shape: str

    def speed(self, t: Floats) -> Floats:
        x = self._x(t)
        part = {"linear": x, "cubic": x * x * (3.0 - 2.0 * x), "sinusoidal": 0.5 - 0.5 * np.cos(np.pi * x)}
        return self.v0 + (self.v1 - self.v0) * part[self.shape]

    def way(self, t: Floats) -> Floats:
        """m since its begin at t (T,) [s]."""
        x = self._x(t)
        whole = {
            "linear": 0.5 * x * x, "cubic": x**3 * (1.0 - 0.5 * x),
            "sinusoidal": 0.5 * x - np.sin(np.pi * x) / (2.0 * np.pi),
        }  # fmt: skip
        change = self.lasts * (self.v0 * x + (self.v1 - self.v0) * whole[self.shape])
        return change + self.v1 * np.maximum(t - self.begin - self.lasts, 0.0)

    def _x(self, t: Floats) -> Floats:
        since = np.maximum(t - self.begin, 0.0)
        return np.minimum(since / self.lasts, 1.0) if self.lasts > 0.0 else np.ones_like(since)


class SpeedCourse:
    """Speed over time from 0 s on: at first 0, then as it is changed, each time from what it is by then."""

    def __init__(self) -> None:
        self._ramps = [_Ramp(0.0, 0.0, 0.0, 0.0, "linear")]

    def change(self, t: float, to: SpeedChange) -> None:
        """Change the speed from t [s] on; t is not before that of the change before."""
        now = float(self._ramps[-1].speed(np.array([t]))[0])
        lasts, shape = 0.0, to.shape
        if shape == "step":
            shape = "linear"
        elif to.dimension == "time":
            lasts = to.value
        else:
            lasts = STEEPEST[shape] * abs(to.target - now) / to.value
        self._ramps.append(_Ramp(t, now, to.target, lasts, shape))

    def keep(self, t: float) -> None:
        """Keep the speed from t [s] on as it is there."""
        now = float(self._ramps[-1].speed(np.array([t]))[0])
        self.change(t, SpeedChange(now, "step", "time", 0.0))

    def speed(self, t: Floats) -> Floats:
        """Give the speed (T,) [m/s] at t (T,) [s]."""
        out = np.zeros(len(t))
        for ramp in self._ramps:
            out = np.where(t >= ramp.begin, ramp.speed(t), out)
        return out

    def way(self, t: Floats) -> Floats:
        """Give the way (T,) [m] from 0 s to t (T,) [s]."""
        out = np.zeros(len(t))
        for ramp, after in zip(self._ramps, [*self._ramps[1:], None], strict=True):
            until = t if after is None else np.minimum(t, after.begin)
            out = out + np.where(t >= ramp.begin, ramp.way(until), 0.0)
        return out


def speed_change(action: ScenarioElement, speeds: Mapping[str, float]) -> SpeedChange:
    """Give what a SpeedAction does.

    speeds: Of entities [m/s] at that moment, where they are known, by their names.

    Raises:
        InputError: Its speed depends on an entity that is not among these or on the way driven, or is none.
    """
    target = action.needed("SpeedActionTarget").only()
    how = action.needed("SpeedActionDynamics")
    shape, dimension = how.text("dynamicsShape"), how.text("dynamicsDimension")
    speed, value = _target_speed(target, speeds), how.number("value")
    if not 0.0 <= speed <= MOST:
        raise target.refused(f"makes {speed:g} m/s, expected 0 to {MOST:g}")
    if shape == "step":
        return SpeedChange(speed, shape, "time", 0.0)
    if shape not in STEEPEST or dimension not in ("time", "rate"):
        known = f"step, or {', '.join(STEEPEST)} over time or rate"
        raise how.refused(f"is {shape} over {dimension}, expected {known}")
    if value < 0.0 or (value == 0.0 and dimension == "rate"):
        raise how.refused(f"value is {value:g}, expected more than 0")
    return SpeedChange(speed, shape, dimension, value)


def _target_speed(target: ScenarioElement, speeds: Mapping[str, float]) -> float:
    """The speed [m/s] that is asked for."""
    if target.tag == "AbsoluteTargetSpeed":
        return target.number("value")
    other = speeds.get(target.text("entityRef"))
    kind = target.text("speedTargetValueType")
    if other is None or kind not in ("delta", "factor") or target.flag("continuous"):
        raise target.refused("is not read: it depends on another entity", "Give AbsoluteTargetSpeed.")
    value = target.number("value")
    return other + value if kind == "delta" else other * value
