"""What a sweep found, in sentences: for the page and the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

Entry = Mapping[str, Any]
"""A part of report.json."""

KEEPS = {
    "verdict": "every criterion is passed",
    "same_decision": "the EGO decides as measured",
    "collision": "the EGO collides with nothing",
}


def keeps(outcome: Entry) -> str:
    """Say what a run does that is good by an outcome."""
    limit = f": {outcome['limit']}" if outcome.get("limit") else ""
    return KEEPS.get(outcome["name"], f"“{outcome['label']}” is passed{limit}")


def axis_title(parameter: Entry) -> str:
    """Give a parameter's label with its unit."""
    return f"{parameter['label']} [{parameter['unit']}]" if parameter["unit"] else str(parameter["label"])


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


def overview_line(section: Entry) -> str:
    """Say what came of the runs of a section."""
    failed = f", {section['failed']} failed" if section["failed"] else ""
    risk = "" if section["largest_risk"] is None else f"; largest risk {percent(section['largest_risk'])}"
    return (
        f"{section['runs']} runs{failed}: {section['passed']} pass every criterion, {section['collisions']} collide, "
        f"{section['same_decision']} decide as measured{risk}"
    )


def requirement_lines(
    section: Entry, parameters: Sequence[Entry], demanded: float
) -> Iterator[tuple[str, list[str]]]:
    """Give of each outcome what is good by it, and a sentence or more for each parameter; of criteria that vary."""
    by_name = {p["name"]: p for p in parameters}
    none = "no value swept keeps it, it holds in no run"
    if section["failed"]:
        none += f"; {section['failed']} runs failed, which keep nothing"
    for o in section["constant"]:
        if o["name"] in KEEPS:
            yield keeps(o), ["holds in every run" if o["value"] == 1.0 else none]
    for outcome in section["outcomes"]:
        if outcome["share"]:
            lines = [
                line
                for name, found in outcome["requirements"].items()
                for line in _lines(found, by_name[name], demanded)
            ]
            yield keeps(outcome), lines


def _lines(found: Sequence[Entry], parameter: Entry, demanded: float) -> Iterator[str]:
    """Sentences for one parameter: its limits; else that it holds everywhere, that nothing can be told, or nowhere."""
    label, unit = parameter["label"], parameter["unit"]
    limits = [r for r in found if r["found"] == "limit"]
    if any(r["found"] == "whole" for r in found):
        whole = next(r for r in found if r["found"] == "whole")
        span = f"{quantity(parameter['low'], unit)} to {quantity(parameter['high'], unit)}"
        yield f"{label}: holds in the whole range swept, {span} ({percent(whole['share'])} of {whole['runs']} runs)"
    elif limits:
        yield from (_limit(r, parameter, demanded) for r in limits)
    elif any(r["found"] == "unclear" for r in found):
        yield f"{label}: no limit can be told: too few runs, or values that differ by no more than chance"
    else:
        yield f"{label}: no value swept keeps it in {percent(demanded)} of runs"


def _limit(r: Entry, parameter: Entry, demanded: float) -> str:
    unit = parameter["unit"]

    def bound(end: str) -> str:
        between = ", ".join("none" if v is None else plain(v) for v in r[f"{end}_interval"])
        return f"{quantity(r[end], unit)} [{between}]"

    if r["low"] is None:
        where = f"up to {bound('high')}"
    elif r["high"] is None:
        where = f"from {bound('low')} on"
    else:
        where = f"from {bound('low')} to {bound('high')}"
    ends = [end for end in ("low", "high") if r[end] is not None]
    if r["binned"]:
        at = "".join(f"; {percent(r[f'{end}_share'])} in the bin of drawn values at this end" for end in ends)
    else:
        at = "".join(f"; {percent(r[f'{end}_share'])} at {quantity(r[end], unit)} alone" for end in ends)
        at += f"; the next value swept is {' and '.join(quantity(r[f'next_{end}'], unit) for end in ends)}"
    return (
        f"{parameter['label']} {where} keeps it in {percent(demanded)} of runs ({percent(r['share'])} of {r['runs']} "
        f"do{at})"
    )
