"""What a file of criteria says: requirements on measures, and a user's own measures."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from resim.core import faults, remedies
from resim.core.clock import TICK
from resim.core.errors import InputError
from resim.core.files import parse_toml
from resim.core.geometry import Bools, Floats
from resim.core.spec import ModuleAndName
from resim.metrics.kinds import MeasureKind, WorstEnd

EXAMPLE = remedies.CRITERIA
SAME = 1e-9
"""Units of a measure that make no difference."""


class Criterion(BaseModel):
    """A requirement: a measure must not be below or above a limit for `duration` [s] or longer.

    measure: its name. beyond: the limit of its magnitude, in either direction. start, end: the part of the drive [s
    from its start] that counts. weight: for weighted sums by the user. source: where the threshold comes from.
    """

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)

    name: str = Field(min_length=1)
    measure: str = Field(min_length=1)
    below: float | None = Field(default=None, strict=True)
    above: float | None = Field(default=None, strict=True)
    beyond: float | None = Field(default=None, ge=0.0, strict=True)
    duration: float = Field(default=0.0, ge=0.0, strict=True)
    start: float = Field(default=0.0, ge=0.0, strict=True)
    end: float | None = Field(default=None, gt=0.0, strict=True)
    weight: float = Field(default=1.0, ge=0.0, strict=True)
    source: str = ""

    @model_validator(mode="after")
    def _one_limit(self) -> Criterion:
        if [self.below, self.above, self.beyond].count(None) != 2:
            raise ValueError("expected one of below, above and beyond")
        if self.end is not None and self.end <= self.start:
            raise ValueError("end: expected more than start")
        return self

    @property
    def side(self) -> Literal["below", "above", "beyond"]:
        """On which side of the limit it is broken."""
        return "below" if self.below is not None else "above" if self.above is not None else "beyond"

    @property
    def limit(self) -> float:
        """The limit, in the unit of the measure."""
        return float(getattr(self, self.side))

    def worsens(self, worst: WorstEnd) -> bool:
        """Say whether it is broken towards the worse end of a measure: only there is the worst known that can be."""
        return worst == "both" or (self.side == "below") == (worst == "low")

    def badness(self, value: Floats) -> Floats:
        """Give values so that larger is worse and more than 0 breaks the limit; NaN stays NaN."""
        if self.side == "below":
            return np.asarray(self.limit - value)
        return np.asarray((value if self.side == "above" else np.abs(value)) - self.limit)

    def within(self, t: Floats) -> Bools:
        """Say which of the scenes at t (S,) [s] lie in the part of the drive that counts.

        A scene stands for the time until the next one: a part that begins between two has the one before, as what is
        found in it may be of the part.
        """
        if self.start == 0.0 and self.end is None:
            return np.ones(len(t), dtype=bool)
        end = math.inf if self.end is None else t[0] + self.end
        until = np.append(t[1:], t[-1] + 4.0 * TICK)
        return np.asarray((until > t[0] + self.start + TICK) & (t <= end + TICK))

    def extent(self, t: Floats) -> float:
        """Give how long [s] the part that counts is, of a drive with scenes at t (S,) [s]."""
        end = t[-1] if self.end is None else min(t[-1], t[0] + self.end)
        return float(end - t[0] - self.start)

    def lasts(self, times: Floats, t: Floats) -> Bools:
        """Say whether a limit can have been broken for the duration; times: of `longest`, below 0 for never.

        Broken in k successive scenes and kept in those around it was broken for more than k - 1 and less than k + 1
        steps; `longest` says k. What may have lasted for the duration counts as if it had: PASS is never wrong.
        """
        ever: Bools = np.asarray(times >= 0.0)
        if not ever.any():
            return ever
        surely, maybe = times >= self.duration - TICK, times + step_of(t) > self.duration + TICK
        return np.asarray(ever & (surely | maybe))


class OwnMeasure(BaseModel):
    """A user's own measure: `function` is "module:name", the module's file beside the file of criteria.

    The function takes a Drive and its RoadNetwork and gives an array (S,) of the EGO or (S, K) of it and each object,
    in `unit`, NaN where it is not defined. worst: which end is the worse one.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str = Field(min_length=1)
    function: ModuleAndName
    unit: str = Field(min_length=1)
    kind: MeasureKind = "quantitative"
    worst: WorstEnd = "high"


class CriteriaFile(BaseModel):
    """What a criteria file says."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str = Field(min_length=1)
    files: tuple[str, ...] = ()
    measure: tuple[OwnMeasure, ...] = ()
    criterion: tuple[Criterion, ...] = Field(min_length=1)


def parse_criteria(raw: bytes, path: Path) -> CriteriaFile:
    """Give what the bytes of the file at `path` say. Raises InputError naming every fault."""
    said = parse_toml(raw, path, EXAMPLE)
    if "objectification" in said:
        raise InputError(
            path, "there is no table [[objectification]]", "Write [[measure]]: it has the same fields."
        )
    try:
        return CriteriaFile.model_validate(said)
    except ValidationError as e:
        raise InputError(path, faults.describe(e.errors(), CriteriaFile), EXAMPLE) from e


def step_of(t: Floats) -> float:
    """Give the time [s] between scenes; 0 for one alone."""
    steps = np.sort(np.diff(t))
    middle = steps[(len(steps) - 1) // 2 : len(steps) // 2 + 1]
    return float(middle.sum() / len(middle)) if len(steps) else 0.0  # np.median takes ten times as long
