"""Numbers of a space in words."""

from __future__ import annotations

import math

from resim.report.markup import Markup, html
from resim.space.statistics.rates import IntervalEstimate


def number(value: float, digits: int = 3) -> str:
    """Give a number with so many significant digits, a dash for none."""
    return "–" if not math.isfinite(value) else f"{value:.{digits}g}"


def interval(one: IntervalEstimate, scale: float = 1.0, unit: str = "") -> str:
    """Give `0.12 (0.05 to 0.31)`; scale: what numbers are multiplied by."""
    if math.isnan(one.value) and math.isnan(one.low):
        return "–"
    told = f"{number(one.value * scale)} ({number(one.low * scale)} to {number(one.high * scale)})"
    return f"{told} {unit}".rstrip()


def section(title: str, body: Markup) -> Markup:
    """Give a section of a page."""
    return html("<section><h2>{}</h2>\n{}</section>", title, body)


def percent(one: IntervalEstimate) -> str:
    """Give a share in percent with its interval."""
    return interval(one, 100.0, "%")
