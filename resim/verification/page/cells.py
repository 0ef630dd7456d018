"""What the tables of a verification are made of: badges, numbers with their signs, ranges over seeds, rows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from resim.report.markup import Markup, html, join
from resim.verification.share import SeedShare

NONE = "–"

LOOKS: Mapping[str, str] = {
    "verified": "pass", "not verified": "fail", "undecided": "invalid", "invalid": "invalid", "error": "failed",
    "same": "none", "changed": "changed", "better": "pass", "worse": "fail",
}  # fmt: skip
"""The look of each verdict's badge (page.css)."""


def anchor(name: str) -> str:
    """Give the id of a recording's part of the page."""
    return f"r-{name}"


def link(name: str) -> Markup:
    """Give a link to a recording's part of the page."""
    return html('<a href="#{}">{}</a>', anchor(name), name)


def badge(verdict: str) -> Markup:
    """Give a verdict as a badge."""
    return html('<span class="badge {}">{}</span>', LOOKS[verdict], verdict)


def filters(counts: Mapping[str, int]) -> Markup:
    """Give a badge a verdict with its count; pressed, it leaves that verdict's recordings only."""
    buttons = join(
        html(
            '<button class="badge {LOOKS}" data-verdict="{verdict}" aria-pressed="false">'
            "{count} {verdict}</button>",
            LOOKS=LOOKS[verdict],
            verdict=verdict,
            count=count,
        )
        for verdict, count in counts.items()
        if count
    )
    return html('<p class="filters">{} <i>press one to see these only</i></p>', buttons)


def minus(text: str) -> str:
    """Give a number's text with a true minus sign."""
    return text.replace("-", "−")


def signed(value: float, digits: int) -> str:
    """Give a difference with its sign, none where it rounds to zero."""
    text = f"{value:+.{digits}f}"
    return text[1:] if float(text) == 0.0 else minus(text)


def second(t: float | None) -> str:
    """Give a time [s]."""
    return NONE if t is None else f"{t:.1f} s"


def spread(values: Sequence[float | None], digits: int, unit: str, sign: bool = True) -> str:
    """Give the one value there is, or the median and the range of those that are known."""
    known = np.array([v for v in values if v is not None], dtype=float)
    if not len(known):
        return NONE

    def told(value: float) -> str:
        return signed(value, digits) if sign else minus(f"{value:.{digits}f}")

    low, middle, high = (told(float(v)) for v in np.quantile(known, [0.0, 0.5, 1.0]))
    space = f" {unit}" if unit else ""
    if low == high:
        return f"{middle}{space}"
    return html("{}{} <i>({} to {})</i>", middle, space, low, high)


def share(found: SeedShare) -> Markup:
    """Give a share of the seeds with its interval."""
    between = f"[{found.low:.2f}, {found.high:.2f}]"
    return html("{} of {} <i>{}</i>", found.count, found.of, between)


def row(cells: Iterable[str], verdict: str = "") -> Markup:
    """Give a table's row of cells; the first is its head. verdict: to filter by.

    Cells are not closed, as HTML allows: a suite of a hundred recordings has many.
    """
    about = html(' data-verdict="{}"', verdict) if verdict else ""
    return html("<tr{}><th>{}", about, join(cells, Markup("<td>")))


def rows_table(head: Iterable[str], rows: Iterable[Markup], css: str = "") -> Markup:
    """Give a table of finished rows in a box in which it scrolls sideways."""
    top = join(html("<th>{}", cell) for cell in head)
    body = join(rows, "\n")
    look = html(' class="{}"', css) if css else ""
    return html(
        '<div class="wide"><table{}><thead><tr>{}</thead>\n<tbody>{}</tbody></table></div>', look, top, body
    )


def bullets(texts: Iterable[str]) -> Markup:
    """Give texts as a list."""
    items = join(html("<li>{}</li>", text) for text in texts)
    return html("<ul>{}</ul>", items) if items else Markup()
