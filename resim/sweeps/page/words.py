"""What a sweep found, in sentences: for the page and the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from pydantic import MISSING

from resim.sweeps.boundary import BoundaryReport
from resim.sweeps.outcomes.registry import OUTCOMES
from resim.sweeps.report import (
    ConstantOutcome,
    RequirementEntry,
    RunCounts,
    SweepReport,
    SweepSection,
    SweptParameter,
    VaryingOutcome,
)
from resim.sweeps.statistics.requirement import Bounds
from resim.sweeps.varied import NUMBER

KEEPS = {outcome.column: outcome.keeps for outcome in OUTCOMES if outcome.good is not None}


def keeps(outcome: ConstantOutcome | VaryingOutcome | BoundaryReport, limit: str | None = None) -> str:
    """Say what a run does that is good by an outcome. limit: what its criterion asks for, where that is to be told."""
    return KEEPS.get(outcome.name, f"“{outcome.label}” is passed{f': {limit}' if limit else ''}")


def axis_title(parameter: SweptParameter) -> str:
    """Give a parameter's label with its unit."""
    return f"{parameter.label} [{parameter.unit}]" if parameter.unit else parameter.label


def plain(value: float) -> str:
    """Give a number with a true minus sign."""
    return f"{value:.4g}".replace("-", "−")


def quantity(value: float | None, unit: str) -> str:
    """Give a value with its unit; a word where there is none."""
    if value is None:
        return "none"
    return f"{plain(value)} {unit}".strip()


def percent(share: float) -> str:
    """Give a share in per cent; 100 % and 0 % only where it is all or none."""
    text = f"{100.0 * share:.3g}"
    if text in ("100", "0") and share not in (0.0, 1.0):
        return "more than 99.9 %" if text == "100" else "less than 0.1 %"
    return f"{text} %"


def overview_line(section: RunCounts) -> str:
    """Say what came of the runs of a section."""
    failed = f", {section.failed} failed" if section.failed else ""
    risk = "" if section.largest_risk is None else f"; largest risk {plain(section.largest_risk)}"
    return (
        f"{section.runs} runs{failed}: {section.passed} pass every criterion, {section.collisions} collide, "
        f"{section.same_decision} make the measured decision{risk}"
    )


def engine_line(found: SweepReport) -> str:
    """Say what simulated the runs."""
    if found.repeated_in_sumo is MISSING:
        return "SUMO"
    if not found.repeated_in_sumo:
        return "direct, without a simulator; no run was repeated in SUMO"
    return (
        f"direct, without a simulator; {found.repeated_in_sumo} of {found.runs} runs repeated in SUMO, "
        "the same to the byte"
    )


def demanded_of(found: SweepReport) -> float:
    """Give the share of runs that requirements ask for; 1 where the plan lets none be told."""
    return 1.0 if found.demanded is MISSING else found.demanded


def requirement_lines(
    section: SweepSection, parameters: Sequence[SweptParameter], demanded: float, notes: Sequence[str] = ()
) -> Iterator[tuple[str, list[str]]]:
    """Give of each outcome what is good by it, and a sentence or more for each parameter; of criteria that vary.

    notes: what is to be said with each.
    """
    by_name = {p.name: p for p in parameters}
    none = "never met in this sweep"
    if section.failed:
        none += f"; {section.failed} runs failed, which count as not met"
    for o in section.constant:
        if o.name in KEEPS:
            yield keeps(o), ["met in every run" if o.value == 1.0 else none, *notes]
    for outcome in section.varying():
        if outcome.requirements is not MISSING:
            lines = [
                line
                for name, found in outcome.requirements.items()
                for line in ([] if name == NUMBER else _lines(found, by_name[name], demanded))
            ]
            if NUMBER in outcome.requirements:
                lines.insert(0, f"met in {percent(outcome.mean or 0.0)} of all runs over the variations")
            yield keeps(outcome, outcome.limit), [*lines, *notes]


def _lines(found: Sequence[RequirementEntry], parameter: SweptParameter, demanded: float) -> Iterator[str]:
    """Sentences for one parameter: what is shown; else that it holds everywhere, that nothing is shown, or nowhere."""
    label, unit = parameter.label, parameter.unit
    limits = [r for r in found if r.found == "limit"]
    if any(r.found == "whole" for r in found):
        whole = next(r for r in found if r.found == "whole")
        span = f"{quantity(parameter.low, unit)} to {quantity(parameter.high, unit)}"
        yield f"{label}: met in the whole swept range, {span} ({_share(whole)})"
    elif limits:
        yield from (_limit(r, parameter, demanded) for r in limits)
    elif any(r.found == "unclear" for r in found):
        yield from (_unclear(r, parameter, demanded) for r in found if r.found == "unclear")
    else:
        yield f"{label}: no swept value meets it in {percent(demanded)} of runs"


def _share(r: RequirementEntry) -> str:
    if r.share is None or r.least is None:
        return "none"
    return f"{percent(r.share)} of {r.runs} runs, at least {percent(r.least)} at 95 % confidence"


def _span(bounds: Bounds | None, unit: str) -> str:
    if bounds is None:
        return "nowhere"
    low, high = bounds
    if low is None and high is None:
        return "the whole swept range"
    if low is None:
        return f"up to {quantity(high, unit)}"
    if high is None:
        return f"from {quantity(low, unit)} on"
    return f"at {quantity(low, unit)}" if low == high else f"from {plain(low)} to {quantity(high, unit)}"


def _unclear(r: RequirementEntry, parameter: SweptParameter, demanded: float) -> str:
    label, unit = parameter.label, parameter.unit
    if r.bounds is not None:
        told = f"shown {_span(r.bounds, unit)} ({_share(r)}), but its values differ no more than by chance"
        return f"{label}: no limit can be given; {told}"
    if r.estimate is None:
        return f"{label}: unclear, too few runs to show where it is met in {percent(demanded)} of them"
    return f"{label}: unclear, too few runs to show it; estimate: {_span(r.estimate, unit)} ({_share(r)})"


def _limit(r: RequirementEntry, parameter: SweptParameter, demanded: float) -> str:
    unit, none = parameter.unit, (None, None)
    each = zip(r.bounds or none, r.at or none, r.beyond or none, strict=True)
    ends = [(end, share, after) for end, share, after in each if end is not None and share is not None]
    if r.binned:
        at = "".join(f"; {percent(share)} in the bin of drawn values at this end" for _, share, _ in ends)
    else:
        at = "".join(f"; {percent(share)} at {quantity(end, unit)} alone" for end, share, _ in ends)
        at += f"; the next swept value is {' and '.join(quantity(after, unit) for _, _, after in ends)}"
    return (
        f"{parameter.label} {_span(r.bounds, unit)} meets it in {percent(demanded)} of runs ({_share(r)}{at}; "
        f"estimate: {_span(r.estimate, unit)}; possible: {_span(r.possible, unit)})"
    )
