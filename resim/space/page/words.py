"""Numbers of a space in words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from resim.report.document import document
from resim.report.markup import Markup, html, join
from resim.space.statistics.rates import IntervalEstimate

LEAST = 1e-15
"""Numbers that are told as 0 below."""


def number(value: float, digits: int = 3) -> str:
    """Give a number with so many significant digits, a dash for none."""
    if not math.isfinite(value):
        return "–"
    return "0" if abs(value) < LEAST else f"{value:.{digits}g}"


def interval(one: IntervalEstimate, scale: float = 1.0, unit: str = "") -> str:
    """Give `0.12 (0.05 to 0.31)`; scale: what numbers are multiplied by."""
    if math.isnan(one.value) and math.isnan(one.low):
        return "–"
    low, high = number(one.low * scale), number(one.high * scale)
    told = (
        f"{number(one.value * scale)} ({f'at least {low}' if math.isnan(one.high) else f'{low} to {high}'})"
    )
    return f"{told} {unit}".rstrip()


def section(title: str, body: Markup) -> Markup:
    """Give a section of a page."""
    return html("<section><h2>{}</h2>\n{}</section>", title, body)


def percent(one: IntervalEstimate) -> str:
    """Give a share in percent with its interval."""
    return interval(one, 100.0, "%")


def header(kind: str, title: str, facts: Sequence[tuple[str, str]], notes: Sequence[str]) -> Markup:
    """Give the head of a page: what it is, facts, and notes."""
    listed = join(html("<div><dt>{}</dt><dd>{}</dd></div>", name, value) for name, value in facts)
    items = join(html("<li>{}</li>", note) for note in notes)
    told = html('<div class="warnings"><b>Note</b><ul>{}</ul></div>', items) if notes else ""
    return html(
        '<header><p class="kind">{}</p><h1>{}</h1><dl class="facts">{}</dl>{}</header>',
        kind,
        title,
        listed,
        told,
    )


def write_page(parts: Sequence[Markup], title: str, file: Path) -> None:
    """Write a page of parts."""
    body = html("<main>\n{}</main>", join(parts, "\n"))
    beside = file.with_name(f".{file.name}")
    beside.write_text(document(title, body), encoding="utf-8", newline="\n")
    beside.replace(file)
