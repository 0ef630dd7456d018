"""What release.json says, as dataclasses: their fields are those of the file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from resim.core.spec import EXACT, NumberOrNan
from resim.space.limits import Per, ReleaseLimits
from resim.space.statistics.rates import IntervalEstimate
from resim.space.test_plan import PlannedTest

MARK = "release.json"
ReleaseVerdict = Literal["good", "bad", "not shown"]
"""`good`: all limits are met with their confidence; `bad`: a limit is exceeded with it; else `not shown`."""


@dataclass(frozen=True)
class ReleaseCheck:
    """One thing that a release asks for.

    Attributes:
        name: What.
        value: What was found; NaN where nothing is known.
        low: Lower limit of it, NaN of what is counted and has none.
        high: Upper limit of it, NaN where there is none; for a share that must be large, the lower one decides.
        limit: What is asked for.
        met: Whether it is, with the confidence.
        exceeded: Whether the contrary is shown.
        missing_hours: h more that have to be driven at least until it can be met, even if nothing new comes and nothing
            happens; 0 where hours are not what is missing; NaN where nothing can be told.
        source: Where the limit is from.
    """

    name: str
    value: NumberOrNan
    low: NumberOrNan
    high: NumberOrNan
    limit: float
    met: bool
    exceeded: bool
    missing_hours: NumberOrNan
    source: str


@dataclass(frozen=True)
class AccidentBudget:
    """Accidents by hour or kilometre, by what they are of.

    Attributes:
        per: Hour or kilometre.
        known: Of clusters whose risk is known: estimate and limits.
        thin: Upper limit of those with too few members that count, or uncalibrated risk: each scenario an accident.
        unseen: Upper limit of kinds not seen: each scenario an accident.
        high: Upper limit of all; NaN where something happened in no scenario.
        limit: What is asked for; NaN where nothing is.
    """

    per: Per
    known: IntervalEstimate
    thin: NumberOrNan
    unseen: NumberOrNan
    high: NumberOrNan
    limit: NumberOrNan


@dataclass(frozen=True)
class ForbiddingCluster:
    """A cluster that forbids the release.

    Attributes:
        cluster: Its name.
        bucket: Of it.
        medoid: Its test case.
        share: Its share of what comes.
        risk: Upper limit of the risk of a scenario of it.
        accidents: Its part of the accidents by hour, at that limit.
        why: `risk` where it is known and too high, else what is missing.
    """

    cluster: str
    bucket: str
    medoid: str
    share: float
    risk: float
    accidents: NumberOrNan
    why: str


@dataclass(frozen=True)
class RemainingDomain:
    """The ODD without the clusters that forbid the release.

    Attributes:
        clusters: Clusters that are left.
        share: Their share of what was driven through, with its interval.
        enough: Whether all limits are met without the others, and none happened in no scenario.
        high: Upper limit of accidents an hour in it; NaN where something happened in no scenario.
    """

    clusters: int
    share: IntervalEstimate
    enough: bool
    high: NumberOrNan


@dataclass(frozen=True)
class ReleaseReport:
    """A decision about a release, as release.json says it."""

    __pydantic_config__ = EXACT

    versions: Mapping[str, str]
    files: Mapping[str, str]
    space: str
    cover: str
    limits_hash: str
    limits: ReleaseLimits
    label: str
    build: str
    perception: str
    verdict: ReleaseVerdict
    statement: str
    checks: tuple[ReleaseCheck, ...]
    budgets: tuple[AccidentBudget, ...]
    forbidding: tuple[ForbiddingCluster, ...]
    remaining: RemainingDomain
    plan: tuple[PlannedTest, ...]
    notes: tuple[str, ...]
