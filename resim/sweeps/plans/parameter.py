"""A parameter that is swept: which values it takes."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, StrictFloat, model_validator

from resim.core.geometry import Floats
from resim.core.spec import TextPattern

_NAME = TextPattern(
    r"^(perception|build|function|variation)(\.\w+)+$",
    "a name that begins with perception., function., build. or variation., such as perception.latency.speed",
)


FARTHEST = 30.0
"""Standard deviations outside of its range from which on a mean is a mistake."""


class SweepParameter(BaseModel):
    """A parameter that is swept: its range, or the values that it takes, in its own unit.

    name: of a perception model ("perception.latency.speed"), a build ("build.cycle_time") or an AD function
    ("function.threat_time"), or which variation ("variation.number", "variation.c1"). steps: values of a grid, evenly
    from low to high; of a normal distribution evenly in probability. mean, std: of a normal distribution, cut off at
    low and high, where it is not uniform. base: the value
    that the others are varied at, one at a time; the middle, if not given. width: how exactly an adaptive plan finds
    where the outcome changes.
    """

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)

    name: Annotated[str, _NAME]
    low: StrictFloat | None = None
    high: StrictFloat | None = None
    values: tuple[StrictFloat, ...] = ()
    steps: int = Field(strict=True, default=5, ge=2, le=10_000)
    mean: StrictFloat | None = None
    std: float | None = Field(strict=True, default=None, gt=0.0)
    base: StrictFloat | None = None
    width: float | None = Field(strict=True, default=None, gt=0.0)

    @model_validator(mode="after")
    def _whole(self) -> SweepParameter:
        if bool(self.values) == (self.low is not None and self.high is not None):
            raise ValueError("expected low and high, or values")
        if (self.low is None) != (self.high is None):
            raise ValueError("expected low and high, both")
        if self.low is not None and self.high is not None and not self.low < self.high:
            raise ValueError(f"low {self.low:g} is not below high {self.high:g}")
        if self.low is not None and self.high is not None and math.isinf(self.high - self.low):
            raise ValueError(
                f"from low {self.low:g} to high {self.high:g} is too large for a floating-point number"
            )
        if (self.mean is None) != (self.std is None):
            raise ValueError("expected mean and std, both")
        if self.mean is not None and self.std is not None and self.low is not None and self.high is not None:
            nearest = min(max(self.mean, self.low), self.high)
            if abs(nearest - self.mean) > FARTHEST * self.std:
                raise ValueError(f"mean {self.mean:g} is more than {FARTHEST:g} std outside of low and high")
        if self.values and self.mean is not None:
            raise ValueError("values have no mean and std")
        if len(set(self.values)) < len(self.values):
            raise ValueError("values: one is a duplicate")
        return self

    @property
    def level_count(self) -> int:
        """How many values `levels` gives."""
        return len(self.values) or self.steps

    def levels(self) -> Floats:
        """Give the values of a grid, or one at a time."""
        if self.values:
            return np.array(self.values)
        k = np.arange(self.steps)
        if self.mean is None:  # multiplied first: whole numbers stay whole
            return np.asarray(
                float(self.low or 0.0) + (float(self.high or 0.0) - float(self.low or 0.0)) * k / k[-1]
            )
        return self.at(k / k[-1])

    def middle(self) -> float:
        """Give the value at which the others are varied."""
        return float(self.at(np.array([0.5]))[0]) if self.base is None else self.base

    def share(self, x: Floats) -> Floats:
        """Give the share (N,) of the distribution that lies below values x (N,): the inverse of `at`.

        Of values that are listed, the middle of each one's share.
        """
        if self.values:
            place = np.argmin(np.abs(np.asarray(x)[:, None] - np.sort(self.values)), axis=1)
            return np.asarray((place + 0.5) / len(self.values))
        low, high = float(self.low or 0.0), float(self.high or 0.0)
        if self.mean is None or self.std is None:
            return np.clip((x - low) / (high - low), 0.0, 1.0)
        from scipy.special import ndtr  # slow to load, and seldom needed

        z, ends, turned = self._normal(x, low, high)
        first, last = ndtr(ends)
        below: Floats = (ndtr(z) - first) / (last - first)
        return np.clip(1.0 - below if turned else below, 0.0, 1.0)

    def at(self, share: Floats) -> Floats:
        """Give the values below which a share (N,) in [0, 1] of the distribution lies."""
        if self.values:
            taken: Floats = np.sort(self.values).take((share * len(self.values)).astype(int), mode="clip")
            return taken
        low, high = float(self.low or 0.0), float(self.high or 0.0)
        if self.mean is None or self.std is None:
            return np.asarray(low + share * (high - low))
        from scipy.special import ndtr, ndtri

        _, ends, turned = self._normal(np.zeros(0), low, high)
        first, last = ndtr(ends)
        z: Floats = ndtri(first + (1.0 - share if turned else share) * (last - first))
        return np.clip(self.mean + self.std * (-z if turned else z), low, high)

    def _normal(self, x: Floats, low: float, high: float) -> tuple[Floats, Floats, bool]:
        """Values (N,), low and high as those of a standard normal, and whether turned, to where its digits are."""
        mean, std = float(self.mean or 0.0), float(self.std or 1.0)
        z, ends = (x - mean) / std, (np.array([low, high]) - mean) / std
        turned = bool(ends.sum() > 0.0)
        return (-z, -ends[::-1], True) if turned else (z, ends, False)
