"""What the tables of a verification are made of: badges, numbers with their signs, ranges over seeds, rows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

Entry = Mapping[str, Any]
"""What verification.json holds of a recording, or a part of it."""

NONE = "–"

LOOKS: Mapping[str, str] = {
    "verified": "pass", "not verified": "fail", "undecided": "invalid", "invalid": "invalid", "error": "failed",
    "same": "none", "changed": "changed", "better": "pass", "worse": "fail",
}  # fmt: skip
"""The look of each verdict's badge (page.css)."""


def anchor(name: str) -> str:
    """Give the id of a recording's part of the page."""
    return f"r-{name}"


def link(name: str) -> str:
    """Give a link to a recording's part of the page."""
    return f'<a href="#{escape(anchor(name))}">{escape(name)}</a>'


def badge(verdict: str) -> str:
    """Give a verdict as a badge."""
    return f'<span class="badge {LOOKS[verdict]}">{escape(verdict)}</span>'


def filters(counts: Mapping[str, int]) -> str:
    """Give a badge a verdict with its count; pressed, it leaves that verdict's recordings only."""
    buttons = "".join(
        f'<button class="badge {LOOKS[verdict]}" data-verdict="{verdict}" aria-pressed="false">'
        f"{count} {verdict}</button>"
        for verdict, count in counts.items()
        if count
    )
    return f'<p class="filters">{buttons} <i>press one to see these only</i></p>'


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
    return f"{middle}{space} <i>({low} to {high})</i>"


def counted(words: Sequence[str]) -> str:
    """Give each of the words (HTML) with how many runs it is of, the most frequent first; just it, if it is of all."""
    counts = Counter(words).most_common()
    return "; ".join(f"{word} ({n} of {len(words)})" if n < len(words) else word for word, n in counts)


def share(found: Entry) -> str:
    """Give a share of the seeds with its interval."""
    between = f"[{found['low']:.2f}, {found['high']:.2f}]"
    return f"{found['count']} of {found['of']} <i>{between}</i>"


def row(cells: Iterable[str], verdict: str = "") -> str:
    """Give a table's row of cells that are HTML; the first is its head. verdict: to filter by.

    Cells are not closed, as HTML allows: a suite of a hundred recordings has many.
    """
    about = f' data-verdict="{verdict}"' if verdict else ""
    return f"<tr{about}><th>{'<td>'.join(cells)}"


def rows_table(head: Iterable[str], rows: Iterable[str], css: str = "") -> str:
    """Give a table of finished rows in a box in which it scrolls sideways."""
    top = "".join(f"<th>{cell}" for cell in head)
    body = "\n".join(rows)
    look = f' class="{css}"' if css else ""
    return f'<div class="wide"><table{look}><thead><tr>{top}</thead>\n<tbody>{body}</tbody></table></div>'


def bullets(texts: Iterable[str]) -> str:
    """Give texts as a list, escaped."""
    items = "".join(f"<li>{escape(text)}</li>" for text in texts)
    return f"<ul>{items}</ul>" if items else ""
