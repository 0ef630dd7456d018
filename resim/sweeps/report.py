"""What report.json says of a sweep, as dataclasses: their fields are those of the file.

Numbers have six digits, those of a boundary twelve; None stands for a number that does not exist.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import MISSING, Field, PlainSerializer, PlainValidator, WithJsonSchema

from resim.core.schema import SweepReportSchema
from resim.core.spec import EXACT, exactly, json_schema, to_json
from resim.sweeps.boundary import BoundaryReport
from resim.sweeps.manifest import SweepInputs
from resim.sweeps.statistics.boundary import Crossing
from resim.sweeps.statistics.requirement import Requirement

Numbers = tuple[float | None, ...]
NumberRows = tuple[Numbers, ...]


@dataclass(frozen=True)
class SweptParameter:
    """A parameter, and the ends of its range in its unit."""

    name: str
    label: str
    unit: str
    low: float
    high: float


@dataclass(frozen=True)
class ConstantOutcome:
    """An outcome that is the same in all runs; value: None where no run has any. share: whether it is one."""

    name: str
    label: str
    unit: str
    share: bool
    value: float | None


@dataclass(frozen=True)
class ResponseCurve:
    """How an outcome's mean answers to a parameter: by levels, each from low to high end (binned) or one value.

    mean, low, high: of the outcome, with its 95 % interval. points, runs: how many each is of.
    """

    at: Numbers
    start: Annotated[Numbers, Field(alias="from")]
    to: Numbers
    binned: bool
    mean: Numbers
    low: Numbers
    high: Numbers
    points: tuple[int, ...]
    runs: tuple[int, ...]


@dataclass(frozen=True)
class SobolIndex:
    """A parameter's shares of the variance, alone and together with others, with 95 % intervals."""

    first: float | None
    first_interval: Numbers
    total: float | None
    total_interval: Numbers


@dataclass(frozen=True)
class SobolIndices:
    """Sobol indices by parameter; the rest as in `Sensitivity`. In the file, parameters stand beside the rest."""

    __pydantic_config__ = EXACT

    parameters: Mapping[str, SobolIndex]
    noise: float | None
    unexplained: float | None
    method: str
    q2: float | None
    degree: int | None


_REST = ("noise", "unexplained", "method", "q2", "degree")


def _flat(found: SobolIndices) -> dict[str, Any]:
    told = to_json(found)
    return {**told.pop("parameters"), **told}


def _unflat(told: Any) -> SobolIndices:
    """Inverse of `_flat`. Raises ValueError for what is none."""
    try:
        rest = {name: told[name] for name in _REST}
        each = {name: one for name, one in told.items() if name not in _REST}
        return exactly({"parameters": each, **rest}, SobolIndices)
    except (KeyError, TypeError, AttributeError) as e:
        raise ValueError(str(e)) from e


def _flat_schema() -> dict[str, Any]:
    rest = json_schema(SobolIndices)["properties"]
    return {
        "type": "object",
        "properties": {name: rest[name] for name in _REST},
        "required": [*_REST],
        "additionalProperties": json_schema(SobolIndex),
    }


SobolInFile = Annotated[
    SobolIndices, PlainValidator(_unflat), PlainSerializer(_flat), WithJsonSchema(_flat_schema())
]


@dataclass(frozen=True)
class Influence:
    """Which parameters an outcome answers to, the most influential first.

    range: how far the mean reaches over each parameter, in the outcome's unit. sobol: None where it is not known.
    """

    ranking: tuple[str, ...]
    range: Mapping[str, float | None]
    sobol: SobolInFile | None


@dataclass(frozen=True)
class RequirementEntry(Requirement):
    """A requirement; binned: whether its levels are bins of what was drawn."""

    binned: bool = False


@dataclass(frozen=True)
class MapEntry:
    """The share of runs that are good over parameters a and b: rows (b) of columns (a), with its 95 % interval.

    Of drawn points both are of the smoothed share, the mean of the true one over the kernel.
    others: parameters that vary, too. width: of the kernel, as a share of the ranges, None on a grid. boundaries: by
    the share that they are of.
    """

    a: str
    b: str
    others: tuple[str, ...]
    at_a: Numbers
    at_b: Numbers
    width: float | None
    share: NumberRows
    low: NumberRows
    high: NumberRows
    boundaries: Mapping[str, tuple[Crossing, ...]]


@dataclass(frozen=True, kw_only=True)
class VaryingOutcome:
    """An outcome that varies: a share of good runs, with requirements and map, or a value.

    without: how many points have no value. responses, requirements: by parameter. limit: what its criterion asks for.
    """

    name: str
    label: str
    unit: str
    share: bool
    mean: float | None
    without: int
    responses: Mapping[str, ResponseCurve]
    sensitivity: Influence
    requirements: Mapping[str, tuple[RequirementEntry, ...]] | MISSING = MISSING
    map: MapEntry | MISSING | None = MISSING
    limit: str | None


@dataclass(frozen=True)
class WorstRun:
    """One of the worst runs: what was varied, what came of it, and the command that repeats it."""

    run: int
    point: int
    seed: int
    parameters: Mapping[str, float | None]
    end: str
    failure: str | None
    decision: str | None
    collision: bool | None
    risk: float | None
    failing: tuple[str, ...]
    command: str


def variation_notes(found: SweepReport) -> tuple[str, ...]:
    """Say how many runs are of variations that no verification legitimises, if there are variations."""
    if found.variations is MISSING:
        return ()
    total, inside = sum(found.variations.values()), found.variations.get("inside", 0)
    if inside == total:
        return (f"all {total} runs are of variations within the verified range of their origin",)
    told = ", ".join(f"{n} {level}" for level, n in found.variations.items())
    return (
        f"{total - inside} of {total} runs are not legitimised by a verified range of their origin ({told})",
    )


def traffic_notes(found: SweepReport) -> tuple[str, ...]:
    """Say in how many runs traffic left its traces, if it could."""
    if found.handed_over is MISSING:
        return ()
    return (
        f"traffic reacts: in {found.handed_over} of {found.runs} runs objects were handed over to drivers",
    )


@dataclass(frozen=True)
class RunCounts:
    """What came of the runs of one recording and build: how many, and how many of them pass, collide, ...

    failures, decisions: counts by reason and by decision, the most frequent first.
    """

    runs: int
    points: int
    seeds: int
    failed: int
    failures: Mapping[str, int]
    passed: int
    collisions: int
    same_decision: int
    decisions: Mapping[str, int]
    largest_risk: float | None


@dataclass(frozen=True)
class _OfBuild:
    recording: str
    build: str


@dataclass(frozen=True, kw_only=True)
class SweepSection(RunCounts, _OfBuild):
    """One recording and build; of an adaptive plan its boundary, else how its outcomes vary."""

    constant: tuple[ConstantOutcome, ...]
    boundary: BoundaryReport | MISSING = MISSING
    outcomes: tuple[VaryingOutcome, ...] | MISSING = MISSING
    worst: tuple[WorstRun, ...]

    def varying(self) -> tuple[VaryingOutcome, ...]:
        """Give the outcomes that vary; none of an adaptive plan, whose points say nothing of the ranges."""
        return () if self.outcomes is MISSING else self.outcomes


@dataclass(frozen=True, kw_only=True)
class SweepReport:
    """What a sweep found; inputs: as its manifest has them. confidence, demanded: of plans that do not grow.

    repeated_in_sumo: how many runs of the engine "direct" were; one that is not the same there ends the sweep.
    unpinned: what the code under test asked that its hash does not know. handed_over: in how many runs traffic that
    reacts left its traces. variations: how many runs are of variations with which trust.
    """

    __pydantic_config__ = EXACT

    schema: SweepReportSchema
    name: str
    plan: str
    versions: Mapping[str, str]
    inputs: SweepInputs
    confidence: float | MISSING = MISSING
    demanded: float | MISSING = MISSING
    runs: int
    failed: int
    repeated_in_sumo: int | MISSING = MISSING
    unpinned: tuple[str, ...] = ()
    handed_over: int | MISSING = MISSING
    variations: Mapping[str, int] | MISSING = MISSING
    parameters: tuple[SweptParameter, ...]
    sections: tuple[SweepSection, ...]
