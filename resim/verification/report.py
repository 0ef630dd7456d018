"""What verification.json says, as dataclasses: their fields are those of the file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag

from resim.core.schema import VerificationSchema
from resim.core.spec import EXACT
from resim.verification.compare import VerificationVerdict
from resim.verification.entries import BuildVerdict, ComparedRecording, FailedRecording, VerifiedRecording
from resim.verification.inputs import VerificationRequest
from resim.verification.paired import Difference

VERDICTS: tuple[VerificationVerdict, ...] = ("verified", "not verified", "undecided", "invalid", "error")
CHANGES: tuple[BuildVerdict, ...] = ("same", "changed", "better", "worse", "error")


def _kind(found: Any) -> str:
    """What kind of a recording's result it is, in memory or in the file."""

    def has(name: str) -> bool:
        return name in found if isinstance(found, Mapping) else hasattr(found, name)

    return "verified" if has("way") else "compared" if has("pairs") else "failed"


RecordingResult = Annotated[
    Annotated[VerifiedRecording, Tag("verified")]
    | Annotated[ComparedRecording, Tag("compared")]
    | Annotated[FailedRecording, Tag("failed")],
    Discriminator(_kind),
]


@dataclass(frozen=True)
class VerificationSummary:
    """How many recordings have which verdict and cause, those to look at, the worst first, and whether all is good."""

    verified: int
    not_verified: Annotated[int, Field(alias="not verified")]
    undecided: int
    invalid: int
    error: int
    causes: Mapping[str, int]
    worst: tuple[str, ...]
    good: bool

    def counts(self) -> dict[str, int]:
        """Give how many recordings have which verdict."""
        every = (self.verified, self.not_verified, self.undecided, self.invalid, self.error)
        return dict(zip(VERDICTS, every, strict=True))


@dataclass(frozen=True)
class LimitCheck:
    """What was found, and the most that it may be, None for any."""

    value: int | float | None
    limit: int | float | None
    kept: bool


@dataclass(frozen=True)
class ComparisonSummary:
    """How many recordings the newer build is the same, better or worse on, and whether the suite's limits are met.

    limits: by the fields of `RegressionLimits`. gained: KPIs in all runs. risk, comfort: mean differences.
    """

    same: int
    changed: int
    better: int
    worse: int
    error: int
    gained: int
    limits: Mapping[str, LimitCheck]
    risk: Difference | None
    comfort: Mapping[str, Difference | None]
    worst: tuple[str, ...]
    good: bool

    def counts(self) -> dict[str, int]:
        """Give how many recordings have which verdict."""
        every = (self.same, self.changed, self.better, self.worse, self.error)
        return dict(zip(CHANGES, every, strict=True))


def _compares_builds(found: Any) -> str:
    limits = "limits" in found if isinstance(found, Mapping) else hasattr(found, "limits")
    return "builds" if limits else "measured"


Summary = Annotated[
    Annotated[VerificationSummary, Tag("measured")] | Annotated[ComparisonSummary, Tag("builds")],
    Discriminator(_compares_builds),
]


@dataclass(frozen=True)
class VerificationReport:
    """What verification.json says: what was asked for, by which versions, and what each recording gave."""

    __pydantic_config__ = EXACT

    schema: VerificationSchema
    versions: Mapping[str, str]
    inputs: VerificationRequest
    summary: Summary
    recordings: Annotated[tuple[RecordingResult, ...], Field(min_length=1)]
