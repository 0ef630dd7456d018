"""Criteria: requirements over measures, from a TOML file, and the verdict of each on a drive."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from resim.assess.criticality import Measure, State
from resim.core.errors import InputError
from resim.core.files import read_file
from resim.core.geometry import Bools, Floats

Outcome = Literal["PASS", "FAIL", "INVALID"]


class Criterion(BaseModel):
    """A requirement: `measure` must not be below or above a limit for longer than `duration` [s].

    start, end: the part of the drive [s from its start] that counts. weight: for whoever sums up. source: where
    the threshold comes from.
    """

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)

    name: str = Field(min_length=1)
    measure: str = Field(min_length=1)
    below: float | None = None
    above: float | None = None
    duration: float = Field(default=0.0, ge=0.0)
    start: float = Field(default=0.0, ge=0.0)
    end: float | None = Field(default=None, gt=0.0)
    weight: float = Field(default=1.0, ge=0.0)
    source: str = ""

    @model_validator(mode="after")
    def _one_limit(self) -> Criterion:
        if (self.below is None) == (self.above is None):
            raise ValueError("expected one of below and above")
        return self

    @property
    def limit(self) -> float:
        """The limit, in the unit of the measure."""
        return self.below if self.below is not None else float(self.above or 0.0)

    def violated(self, value: Floats) -> Bools:
        """Say where values break the limit; NaN does not."""
        return np.asarray(value < self.limit if self.below is not None else value > self.limit)


class Criteria(BaseModel):
    """A file of criteria."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: str = Field(min_length=1)
    criterion: tuple[Criterion, ...] = Field(min_length=1)


@dataclass(frozen=True)
class Verdict:
    """The outcome of one criterion: worst value, limit, unit, when [s], which object, and why.

    value and t are None where nothing was measured; object is "" for the EGO itself or the whole scene.
    """

    criterion: str
    outcome: Outcome
    value: float | None
    limit: float
    unit: str
    t: float | None
    object: str
    weight: float
    reason: str


def read_criteria(path: Path, known: Sequence[str]) -> Criteria:
    """Read a TOML file of criteria over `known` measures. Raises InputError naming every fault."""
    try:
        text = read_file(path, "Check the path of the criteria").decode("utf-8")
        criteria = Criteria.model_validate(tomllib.loads(text))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as e:
        raise InputError(path, f"is not TOML ({e})", "See scenarios/criteria/highway.toml.") from e
    except ValidationError as e:
        problems = "; ".join(f"{'.'.join(map(str, p['loc']))}: {p['msg']}" for p in e.errors())
        raise InputError(path, problems, "See scenarios/criteria/highway.toml.") from e
    names = [c.name for c in criteria.criterion]
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(path, f"the criterion {twice[0]!r} stands twice", "Give each its own name.")
    if strange := [c.measure for c in criteria.criterion if c.measure not in known]:
        raise InputError(path, f"there is no measure {strange[0]!r}", f"Measures: {', '.join(known)}.")
    return criteria


def judge(
    criterion: Criterion, measure: Measure, t: Floats, ids: Sequence[str], present: Bools | None = None
) -> Verdict:
    """Judge a measure (S,) of the EGO, or (S, K) of it and objects `ids`, over the scenes at t (S,) s.

    present: (S, K) where an object is there; elsewhere nothing has to be computed. FAIL where the limit is broken
    for longer than the duration. INVALID, never PASS, where a value that should be there was not computed, or the
    measure has no meaning anywhere.
    """
    columns = measure.value.reshape(len(t), -1)
    states = measure.state.reshape(len(t), -1)
    own = columns.shape == (len(t), 1) and measure.value.ndim == 1
    names = [""] if own else list(ids)
    counts = np.ones(states.shape, dtype=bool) if present is None or own else present
    within = (t >= t[0] + criterion.start) & (
        t <= (math.inf if criterion.end is None else t[0] + criterion.end)
    )
    counts = counts & within[:, None]
    values = np.where(counts, columns, np.nan)
    lost = counts & (states == State.NOT_COMPUTED)
    meant = counts & (states != State.NOT_DEFINED) & ~lost
    worst = _worst(values, low=criterion.below is not None)
    value, when, whom = (None, None, "") if worst is None else (
        float(values[worst]), float(t[worst[0]]), names[worst[1]]
    )  # fmt: skip
    broken = [
        k
        for k in range(values.shape[1])
        if _longest(criterion.violated(values[:, k]), t) >= criterion.duration
    ]
    outcome: Outcome = "PASS"
    reason = "kept" if value is not None else "no conflict"
    if broken:
        outcome = "FAIL"
        longest = max(_longest(criterion.violated(values[:, k]), t) for k in broken)
        side = "below" if criterion.below is not None else "above"
        reason = f"{side} {amount(criterion.limit, measure.unit)} for {longest:.1f} s"
    elif lost.any():
        outcome, reason = (
            "INVALID",
            f"not computed in {int(lost.any(axis=1).sum())} of {int(within.sum())} scenes",
        )
    elif not meant.any() and counts.any():
        outcome, reason = "INVALID", "not defined anywhere in the drive"
    elif not within.any():
        outcome, reason = "INVALID", "the drive has no scene in this part"
    return Verdict(
        criterion.name, outcome, value, criterion.limit, measure.unit, when, whom, criterion.weight, reason
    )


def amount(value: float, unit: str) -> str:
    """Give a value with its unit; "beyond any" where it has no bound."""
    if not math.isfinite(value):
        return "beyond any"
    return f"{value:.3g}" if unit == "1" else f"{value:.3g} {unit}"


def overall(verdicts: Mapping[str, Verdict]) -> Outcome:
    """Give FAIL where one fails, else INVALID where one is, else PASS."""
    outcomes = {v.outcome for v in verdicts.values()}
    return "FAIL" if "FAIL" in outcomes else "INVALID" if "INVALID" in outcomes else "PASS"


def _worst(values: Floats, *, low: bool) -> tuple[int, int] | None:
    if not np.isfinite(values).any() and not np.isinf(values).any():
        return None
    flat = np.nanargmin(values) if low else np.nanargmax(values)
    scene, k = np.unravel_index(int(flat), values.shape)
    return int(scene), int(k)


def _longest(broken: Bools, t: Floats) -> float:
    """The longest time [s] that the limit is broken without a break, each scene for its time step; -1 for never."""
    if not broken.any():
        return -1.0
    step = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], broken, [False]]).astype(np.int8)))
    return float((t[edges[1::2] - 1] - t[edges[::2]]).max()) + step
