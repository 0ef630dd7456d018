"""May the function be released? The sentence of Wagner 2021, 6.3.1 with its numbers, or what forbids it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from resim.core.provenance import versions
from resim.core.spelling import counted
from resim.space.draws import scenario_draws
from resim.space.expected import (
    AccidentTerms,
    RiskLimit,
    held_out_missing,
    unseen_of,
)
from resim.space.limits import Per, ReleaseLimits
from resim.space.missing import hours_for_accidents, hours_for_kinds
from resim.space.model import Space
from resim.space.release_case import ReleaseCase, release_case
from resim.space.release_report import (
    AccidentBudget,
    ForbiddingCluster,
    ReleaseCheck,
    ReleaseReport,
    ReleaseVerdict,
    RemainingDomain,
)
from resim.space.risk import CoverReport
from resim.space.statistics.rates import LEAST_ALIKE, LEAST_DRIVES, IntervalEstimate, share, spread_by, worth
from resim.space.test_plan import PlannedCluster, PlannedTest, test_plan

SENTENCE = (
    "The AD function is tested against a set of scenarios we trust to represent the entirety of scenarios within the "
    "ODD at enough confidence, and the overall risk across these scenarios is low enough to release the function with "
    "enough confidence."
)
IN_NO_SCENARIO = "mine what is in no scenario or of no known kind: the limit holds without it"
"""What comes before any proposal, where there is such."""


def decide(
    space: Space, cover: CoverReport | None, limits: ReleaseLimits, hashes: Mapping[str, str]
) -> ReleaseReport:
    """Decide about a release. hashes: of `space`, `cover` and `limits`; "" for none."""
    case = release_case(space, cover, limits)
    terms = {per: case.accidents(per) for per in case.driven}
    checks = release_checks(case, terms)
    verdict = verdict_of(checks, case.believed, case.unknown)
    seen = all(one.met for one in checks if not one.name.startswith("accidents"))
    forbidding, remaining = _odd(space, case, verdict, seen=seen)
    return ReleaseReport(
        versions(), {}, hashes["space"], hashes["cover"], hashes["limits"], limits,
        "" if cover is None else cover.label, "" if cover is None else cover.build,
        "" if cover is None else cover.perception, verdict, _statement(case, verdict, checks), checks,
        tuple(_budget(per, found, case) for per, found in terms.items()), forbidding, remaining, _plan(space, case),
        (_how(space, cover), *_notes(space, case, cover)),
    )  # fmt: skip


def _plan(space: Space, case: ReleaseCase) -> tuple[PlannedTest, ...]:
    """What to do next; where something happened in no scenario, it comes first."""
    asked = case.driven["hour"], case.limits
    kinds = space.rows.assign(draw=scenario_draws(space.rows)).groupby("cluster")
    drives, count, medoids = kinds["draw"].nunique(), kinds.size(), _medoids(space)
    clusters = [
        PlannedCluster(
            name, medoids[name], int(drives[name]),
            sum(one.others for one in case.risks[name].draws) if name in case.risks else int(count[name]),
            held_out_missing(case.risks[name], case.calibration) if name in case.risks else 0,
        )
        for name in case.names
    ]  # fmt: skip
    exposed, seen = case.exposed_over("hour")
    plan = test_plan(clusters, exposed, case.risk, asked, seen)
    if not case.unknown:
        return plan
    return tuple(replace(one, first="; ".join(filter(None, (IN_NO_SCENARIO, one.first)))) for one in plan)


def release_checks(case: ReleaseCase, terms: Mapping[Per, AccidentTerms]) -> tuple[ReleaseCheck, ...]:
    """Give what is asked for, and whether it is met."""
    limits = case.limits
    unseen = unseen_of(case.seen, 2.0 * limits.confidence - 1.0)
    seen = ReleaseCheck(
        "the next scenario is of a kind that was seen", 1.0 - unseen.value, 1.0 - unseen.high, 1.0 - unseen.low,
        limits.least_seen, bool(1.0 - unseen.high >= limits.least_seen), bool(1.0 - unseen.low < limits.least_seen),
        hours_for_kinds(case.seen, 1.0 - limits.least_seen, limits.confidence, case.driven["hour"]),
        limits.least_seen_source,
    )  # fmt: skip
    out = [seen]
    for one in limits.limit:
        found = terms[one.per]
        high = np.inf if case.unknown else found.high
        out.append(
            ReleaseCheck(
                f"accidents by {one.per}", found.value, found.low, _finite(high), one.accidents,
                bool(high <= one.accidents), bool(found.low > one.accidents),
                hours_for_accidents(
                    case.seen, one.accidents, (1.0 - limits.confidence) / 3.0, case.driven[one.per], case.driven["hour"]
                ),
                one.source,
            )
        )  # fmt: skip
    return (*out, *_drives_checks(case))


def _drives_checks(case: ReleaseCase) -> Iterator[ReleaseCheck]:
    """Whether limits of rates can be believed, even if few drives have most of what comes, or most of the time."""

    def enough(name: str, drives: float, least: float, growth: float, why: str) -> ReleaseCheck:
        more = max((least / drives) ** growth - 1.0, 0.0) * case.driven["hour"] if drives else math.nan
        return ReleaseCheck(
            name, drives, math.nan, math.nan, least, drives >= least, False, more,
            f"our choice: with fewer, limits of rates hold too seldom where {why}",
        )  # fmt: skip

    counted = float(len(np.unique(case.exposed.drive)))
    many = "one drive in ten has most of what comes"
    yield enough("drives in which scenarios come", counted, float(LEAST_DRIVES), 1.0, many)
    alike = float(np.min([worth(one) for one in case.lengths.values()]))  # NaN where one is
    long = "few drives are much longer than others"
    yield enough("drives of like length that they are worth", alike, LEAST_ALIKE, 0.5, long)


def verdict_of(checks: Sequence[ReleaseCheck], believed: bool, unknown: Sequence[str] = ()) -> ReleaseVerdict:
    """Give the verdict: a limit on accidents that is shown to be exceeded is `bad`, whatever else is not known.

    unknown: what happened and is in no scenario; with anything of it nothing is good.
    """
    if any(one.exceeded for one in checks if one.name.startswith("accidents")) and believed:
        return "bad"
    return "good" if believed and not unknown and all(one.met for one in checks) else "not shown"


def _budget(per: Per, found: AccidentTerms, case: ReleaseCase) -> AccidentBudget:
    limits, high = case.limits, np.inf if case.unknown else found.high
    limit = min((one.accidents for one in limits.limit if one.per == per), default=np.nan)
    known = IntervalEstimate(found.value, found.low, _finite(found.known), limits.confidence)
    if np.isnan(found.value):
        known = IntervalEstimate(np.nan, np.nan, np.nan, limits.confidence)
    return AccidentBudget(per, known, _finite(found.thin), _finite(found.unseen), _finite(high), limit)


def _finite(value: float) -> float:
    return value if np.isfinite(value) else np.nan


def _odd(
    space: Space, case: ReleaseCase, verdict: ReleaseVerdict, *, seen: bool
) -> tuple[tuple[ForbiddingCluster, ...], RemainingDomain]:
    """The clusters that forbid the release, those with most accidents first, and what is left without them.

    seen: whether enough of the kinds were seen, in enough drives of like length.
    """
    risk = case.risk
    count = np.bincount(case.exposed.kind, minlength=case.exposed.clusters)
    weight = count * np.array([one.high for one in risk])
    order = sorted(range(len(case.names)), key=lambda k: (-weight[k], case.names[k]))
    most = 0
    if verdict != "good":
        low, most = 0, len(order)
        while low < most:  # the fewest that must go; with none left nothing but the unseen is
            middle = (low + most) // 2
            low, most = (low, middle) if _fits(case, order[:middle]) else (middle + 1, most)
    out = order[:most]
    hours, total = case.driven["hour"], float(count.sum())
    buckets = dict(zip(space.rows["cluster"], space.rows["bucket"], strict=True))
    medoids = _medoids(space)
    forbidding = tuple(
        ForbiddingCluster(
            case.names[k], str(buckets[case.names[k]]), medoids[case.names[k]], count[k] / total, risk[k].high,
            weight[k] / hours if hours > 0.0 else np.nan, _why(case, k, risk[k]),
        )
        for k in out
    )  # fmt: skip
    left = total - float(count[out].sum())
    high = case.accidents("hour", out).high
    enough = _fits(case, out) and seen and not case.unknown  # what is in no cluster goes with none
    spread = spread_by(case.exposed.drive)
    kept = RemainingDomain(
        len(order) - len(out),
        share(left / spread, total / spread),
        enough,
        math.nan if case.unknown else _finite(high),
    )
    return forbidding, kept


def _fits(case: ReleaseCase, left_out: Sequence[int]) -> bool:
    """Whether all limits on accidents are met without some clusters."""
    return bool(all(case.accidents(one.per, left_out).high <= one.accidents for one in case.limits.limit))


def _why(case: ReleaseCase, k: int, risk: RiskLimit) -> str:
    one = case.risks.get(case.names[k])
    if risk.known:
        return "risk"
    if one is None or not one.drives:
        reasons = "" if one is None or not one.why else f": {next(iter(one.why))}"
        return f"no member counts{reasons}"
    if one.drives < case.limits.least_drives:
        some = counted(one.drives, "drive")
        return f"members count in {some}, at least {case.limits.least_drives} are needed"
    told = []
    if one.missing:
        told.append(
            f"{counted(one.missing, 'scenario')} of it {'was' if one.missing == 1 else 'were'} not simulated"
        )
    if more := held_out_missing(one, case.calibration):
        told.append(f"{more} more drives with such a risk have to be held out at least")
    return f"its risk is not calibrated{': ' if told else ''}{'; '.join(told)}"


def _medoids(space: Space) -> dict[str, str]:
    rows = space.rows[space.rows["medoid"]]
    return dict(zip(rows["cluster"].astype(str), rows["scenario"].astype(str), strict=True))


def _statement(case: ReleaseCase, verdict: ReleaseVerdict, checks: Sequence[ReleaseCheck]) -> str:
    if verdict != "good":
        open_checks = [one for one in checks if not one.met]
        told = "; ".join(f"{one.name}: {_found(one)}, asked for {one.limit:.3g}" for one in open_checks)
        calibrated = "" if case.believed else "predicted risk is not calibrated against held-out drives"
        why = "; ".join(part for part in (told, calibrated, *case.unknown) if part)
        return f"The function may not be released: {why}."
    seen, *accidents, _, _ = checks
    numbers = ", ".join(f"at most {one.high:.3g} {one.name} (limit {one.limit:.3g})" for one in accidents)
    return (
        f"{SENTENCE} With {100.0 * case.limits.confidence:g} % confidence: {len(case.names)} kinds of scenarios, of "
        f"which the next one is with at least {100.0 * seen.low:.3g} %; {numbers}. {_resolution(case)}"
    )


def _resolution(case: ReleaseCase) -> str:
    """What held-out drives do not tell: that they do not contradict predictions makes these no more exact."""
    bins = () if case.calibration is None else case.calibration.bins
    largest = max((one.collided.high for one in bins), default=1.0)
    return (
        f"Predicted risk is not contradicted by {sum(one.drives for one in bins)} held-out drives, which would show "
        f"one that is larger only above {largest:.2g} a scenario."
    )


def _found(one: ReleaseCheck) -> str:
    """What was found where it is not enough, and how many hours are missing at least."""
    missing = f" ({one.missing_hours:.3g} h more are needed at least)" if one.missing_hours > 0.0 else ""
    if one.name.startswith("accidents"):
        return (f"at most {one.high:.3g}" if np.isfinite(one.high) else "not known") + missing
    return (f"{one.value:.4g}" if math.isnan(one.low) else f"at least {one.low:.3g}") + missing


def _how(space: Space, cover: CoverReport | None) -> str:
    """By which settings there are kinds, and members of them: others give another verdict."""
    how = space.settings
    counts = "" if cover is None else f"; members count up to {cover.within:g} from a verified drive"
    return f"kinds are by {how.bucket}, {how.linkage} linkage and the threshold {how.threshold}{counts}"


def _notes(space: Space, case: ReleaseCase, cover: CoverReport | None) -> list[str]:
    out = [] if cover is None else list(cover.notes)
    if cover is None:
        out.append(
            "no simulated drive covers the space: every scenario counts as an accident (`resim space cover`)"
        )
    elif cover.calibration is None:
        out.append("there are no held-out drives: predicted risk is not calibrated, and is not believed")
    elif cover.calibration.verdict != "calibrated":
        out.append(f"predicted risk is not calibrated: {cover.calibration.verdict}")
    else:
        out.append(_resolution(case))
    if cover is not None and not any(one.driven_by.get(cover.build) for one in space.sources):
        out.append(
            "rates are of others' drives: that this build meets the same scenarios as often is not shown"
        )
    if any(not value > 0.0 for value in case.driven.values()):
        out.append("nobody says how long was driven: there are no rates")
    return out
