"""How a result shows itself in a notebook: what it is, a small figure, tables; no script, nothing from elsewhere."""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from resim.report.document import text
from resim.report.markup import Markup, html, join
from resim.report.tables import table

MOST_ROWS = 60


def notebook_html(title: str, figure: Markup, tables: Mapping[str, pd.DataFrame]) -> str:
    """Give a notebook's view of a result; all that is text is escaped. Tables that are empty are left out."""
    shown = [html("<h4>{}</h4>{}", name, _table(frame)) for name, frame in tables.items() if len(frame)]
    css = Markup(text("resim.report", "notebook.css"))  # noqa: S704  a file of the package
    return html("<style>{}</style><div class=resim><p>{}</p>{}{}</div>", css, title, figure, join(shown))


def _table(frame: pd.DataFrame) -> Markup:
    named = frame.reset_index() if frame.index.name else frame
    rows = [[_cell(value) for value in row] for row in named.head(MOST_ROWS).itertuples(index=False)]
    more = len(named) - MOST_ROWS
    note = html("<p>... and {} more rows</p>", more) if more > 0 else Markup()
    return table(list(map(str, named.columns)), rows) + note


def _cell(value: object) -> str:
    if isinstance(value, float):
        return "" if value != value else f"{value:.4g}"
    return "" if value is None else str(value)
