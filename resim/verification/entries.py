"""What verification.json says of one recording, as dataclasses: their fields are those of the file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Generic, Literal, TypeVar

from pydantic import MISSING, Field

from resim.resimulation.drive_outcome import KpiOutcome, Rms
from resim.verification.blame import Blamed, Function
from resim.verification.cause import Cause
from resim.verification.compare import Equality, SimulatedSource, VerificationVerdict
from resim.verification.paired import RunPair
from resim.verification.share import SeedShare
from resim.verification.tolerance import Excess
from resim.verification.validity_interval import ValidityInterval

MODEL: SimulatedSource = "rGT+M"
BuildVerdict = Literal["same", "changed", "better", "worse", "error"]

T = TypeVar("T")


@dataclass(frozen=True)
class PerDrive(Generic[T]):
    """Something of the measured drive and of each re-simulation that there is; over_seeds: with a perception model."""

    GT: T
    SD: T | MISSING = MISSING
    rGT: T | MISSING = MISSING
    rSD: T | MISSING = MISSING
    over_seeds: Annotated[tuple[T, ...] | MISSING, Field(alias="rGT+M")] = MISSING

    def each(self) -> dict[str, tuple[T, ...]]:
        """Give it by drive, one for each run."""
        single = {"GT": self.GT, "SD": self.SD, "rGT": self.rGT, "rSD": self.rSD}
        found: dict[str, tuple[T, ...]] = {s: (one,) for s, one in single.items() if one is not MISSING}
        return found if self.over_seeds is MISSING else {**found, MODEL: self.over_seeds}


@dataclass(frozen=True)
class ComparedRun:
    """A re-simulation beside the measured drive; fields as in `DriveComparison`. failure: None where there is none."""

    verdict: VerificationVerdict
    same_decision: bool
    reaction_difference: float | None
    t: float | None
    differences: tuple[str, ...]
    beyond: tuple[Excess, ...]
    failure: str | None


@dataclass(frozen=True)
class _VerdictWithCause:
    verdict: VerificationVerdict
    cause: Cause | None


@dataclass(frozen=True)
class SingleRun(ComparedRun, _VerdictWithCause):
    """What the one re-simulation of a way gave, and why it is not as measured."""


@dataclass(frozen=True)
class _OfSeed:
    seed: int


@dataclass(frozen=True)
class SeedRun(ComparedRun, _OfSeed):
    """A re-simulation with a perception model; end: how it ended, errors: of the EGO in the pipeline."""

    end: str
    errors: Mapping[str, float | None] | None


@dataclass(frozen=True)
class SeedRuns(_VerdictWithCause):
    """What the re-simulations with a perception model gave.

    agreement: more than this share of them is demanded to agree; share: that does. needed: how many seeds would tell
    where that is undecided. same_decision: share of those that make the measured decision and end as the drive does.
    """

    agreement: float
    share: SeedShare
    needed: int | None
    same_decision: SeedShare
    seeds: tuple[SeedRun, ...]


WayRuns = SingleRun | SeedRuns


@dataclass(frozen=True)
class KpiEntry:
    """The KPI of one drive: its outcome, worst value, when [s], because of which object, and why."""

    verdict: KpiOutcome
    value: float | None
    t: float | None
    object: str
    reason: str


@dataclass(frozen=True, kw_only=True)
class KpiComparison:
    """A criterion's KPIs by drive, None for a run that ended before there was anything to judge.

    difference: of the worst value from the measured one, in `unit`, over seeds the median. equal: whether they are as
    measured, over seeds the share of them.
    """

    unit: str
    weight: float
    difference: Mapping[SimulatedSource, float | None]
    GT: KpiEntry
    SD: KpiEntry | MISSING | None = MISSING
    rGT: KpiEntry | MISSING | None = MISSING
    rSD: KpiEntry | MISSING | None = MISSING
    equal: Mapping[SimulatedSource, Equality | SeedShare]
    over_seeds: Annotated[tuple[KpiEntry | None, ...] | MISSING, Field(alias="rGT+M")] = MISSING

    def single(self) -> dict[str, KpiEntry | None]:
        """Give the KPIs by drive, of those without a perception model that are there."""
        found = {"GT": self.GT, "SD": self.SD, "rGT": self.rGT, "rSD": self.rSD}
        return {source: kpi for source, kpi in found.items() if kpi is not MISSING}


@dataclass(frozen=True)
class OpenLoopEntry:
    """Function and vehicle model along the measured drive: the fields of `OpenLoopFinding`, and all in a sentence."""

    error: Mapping[str, float | None]
    beyond: tuple[Excess, ...]
    t: float | None
    function: Function
    planned_otherwise: float | None
    blamed: Blamed | None
    text: str


@dataclass(frozen=True)
class RecordingSource:
    """A recording: its name, folder as seen from verification.json, and hash, None where it could not be read."""

    name: str
    folder: str
    hash: str | None


@dataclass(frozen=True)
class FailedRecording(RecordingSource):
    """A recording without a result, and why; crashed: whether a process died of it, else the input was wrong."""

    verdict: Literal["error"]
    error: str
    crashed: bool
    reports: tuple[str, ...] = ()


@dataclass(frozen=True)
class VerifiedContent:
    """What the verification of a recording gave, measured against simulated, wherever the recording lies.

    way: what the verdict is judged by. error: why the function failed, None where it did not. reaction: first braking
    [s]. errors: root mean squares by step. recorded: the run that showed the function what was recorded as perceived.
    cases: hashes of what was simulated.
    """

    verdict: VerificationVerdict
    way: SimulatedSource
    error: str | None
    cause: Cause | None
    ways: Mapping[SimulatedSource, WayRuns]
    kpis: Mapping[str, KpiComparison]
    decision: PerDrive[tuple[str, ...]]
    reaction: PerDrive[float | None]
    reaction_spread: float | None
    risk: PerDrive[float | None]
    comfort: PerDrive[Mapping[str, float | None]]
    errors: Rms
    recorded: ComparedRun | None
    driven: OpenLoopEntry | None
    cases: Mapping[str, str]
    validity: tuple[ValidityInterval, ...]
    findings: tuple[str, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class VerifiedRecording(VerifiedContent, RecordingSource):
    """A recording and what its verification gave, its pages as seen from verification.json.

    reports: of its re-simulation. drive: the page that plays it, None where there is none.
    """

    reports: tuple[str, ...] = ()
    drive: str | None = None

    @property
    def judged(self) -> WayRuns:
        """The runs that the verdict is judged by."""
        return self.ways[self.way]

    @property
    def seeds(self) -> tuple[SeedRun, ...]:
        """The runs with a perception model."""
        return () if (found := self.ways.get(MODEL)) is None else seeds_of(found)


def runs_of(way: WayRuns) -> tuple[ComparedRun, ...]:
    """Give the runs of a way: one, or one a seed."""
    return way.seeds if isinstance(way, SeedRuns) else (way,)


def seeds_of(way: WayRuns) -> tuple[SeedRun, ...]:
    """Give the runs of a way that has seeds."""
    return way.seeds if isinstance(way, SeedRuns) else ()


@dataclass(frozen=True)
class ReactionsOfBuilds:
    """First braking [s] with the older build and with the newer one, in each run."""

    before: tuple[float | None, ...]
    now: tuple[float | None, ...]


@dataclass(frozen=True)
class ComparedContent:
    """What two builds gave on a recording, wherever it lies; t, differences and weight_lost are of the worst run."""

    verdict: BuildVerdict
    t: float | None
    differences: tuple[str, ...]
    error: str | None
    findings: tuple[str, ...]
    weight_lost: float
    reaction: ReactionsOfBuilds
    cases: Mapping[str, Mapping[str, str]]
    pairs: tuple[RunPair, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class ComparedRecording(ComparedContent, RecordingSource):
    """A recording, driven by two builds, its pages as seen from verification.json.

    reports: of its re-simulations. drive: the page that plays both, None where there is none.
    """

    reports: tuple[str, ...] = ()
    drive: str | None = None
